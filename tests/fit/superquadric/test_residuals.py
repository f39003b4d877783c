"""The normal equations against differences of the residuals they belong to."""

import jax
import numpy as np
import pytest
from kept_program import call_kept

from fit.rotation import matrix_of_quaternion
from fit.superquadric.parameter_vector import Form
from fit.superquadric.residuals import FitData, normal_equations, residual_vector

PLAIN = Form(False, False, "solina", "none")
RADIAL = Form(True, False, "radial", "pseudo_huber")
BOXED = Form(True, False, "solina_box", "cauchy")
BENT = Form(True, True, "volume_distance", "cauchy")


def lane(rng: np.random.Generator) -> FitData:
    """Points with normals, free balls all around, and a table."""
    q = rng.normal(size=4)
    balls = np.concatenate([rng.normal(size=(3, 16)), np.full((1, 16), 0.3), np.ones((1, 16))])
    turn = matrix_of_quaternion(q / np.linalg.norm(q))
    normals = rng.normal(size=(3, 24))
    normals /= np.linalg.norm(normals, axis=0)
    return FitData(rng.normal(size=(3, 24)), rng.random(24), turn,
                np.float64(0.2), np.float64(0.1), np.float64(0.3), upright=np.array([0.2, 0.3]),
                plane=np.array([0.1, 0.2, -0.97, 0.6, 0.5]),
                normals=normals, normal_weight=rng.random(24), free=balls)


def equations_and_residuals(at, data: FitData, form: Form):
    """The normal equations of the first row of `at`, and the residuals of all rows."""
    return (normal_equations(at[0], data, form),
            jax.vmap(lambda theta: residual_vector(theta, data, form))(at))


@pytest.mark.parametrize("form", [
    pytest.param(PLAIN, id="plain", marks=pytest.mark.slow), pytest.param(RADIAL, id="radial"),
    pytest.param(BOXED, id="boxed", marks=pytest.mark.slow), pytest.param(BENT, id="bent")])
def test_normal_equations_are_those_of_the_residuals(form: Form) -> None:
    rng = np.random.default_rng(4)
    data = lane(rng)
    if form.bend:
        # The reach of a bent body is searched for, and in some directions only nearly found.
        data = data._replace(normals=None, normal_weight=None)
    theta = np.concatenate([np.log([0.5, 0.7, 0.9]), 0.3 * rng.normal(size=form.parameters - 3)])
    step = 1e-6
    steps = step * np.concatenate([0 * theta[None], np.eye(form.parameters),
                                   -np.eye(form.parameters)])
    found, values = call_kept(equations_and_residuals, theta + steps, data, form=form)
    r, up, down = values[0], values[1 : form.parameters + 1], values[form.parameters + 1 :]
    j = (up - down).T / (2 * step)
    assert found.cost == pytest.approx(0.5 * r @ r, rel=1e-12)
    assert np.allclose(found.gradient, j.T @ r, rtol=1e-5, atol=1e-7)
    assert np.allclose(found.matrix, j.T @ j, rtol=1e-5, atol=1e-6)
