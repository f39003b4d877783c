"""Moments in closed form, against sums over grids; what a description must not depend on."""

import numpy as np
import pytest

from fit.superquadric.geometry import (
    Superquadric,
    superquadric_inside_outside,
    superquadric_volume,
)
from fit.superquadric.moments import (
    DESCRIPTION,
    description_covariance,
    superquadric_description,
    superquadric_moment,
)
from fit.superquadric.slopes import displaced

ROOT = np.sqrt(0.5)


def bodies(n: int, seed: int = 0) -> Superquadric:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 4))
    return Superquadric(rng.uniform(0.02, 0.06, (n, 3)), rng.uniform(0.15, 1.6, (n, 2)),
                        rng.normal(0, 0.1, (n, 3)) + [0, 0, 0.4],
                        q / np.linalg.norm(q, axis=1, keepdims=True),
                        rng.uniform(-0.8, 0.8, (n, 2)), np.zeros((n, 2)))


def test_the_moment_of_order_nought_is_the_volume() -> None:
    body = bodies(50)
    assert np.allclose(superquadric_moment(body, 0, 0, 0), superquadric_volume(body), rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_descriptions_agree_with_sums_over_points_inside(seed: int) -> None:
    body = bodies(1, seed)
    line = (np.arange(120) + 0.5) / 120 * 0.3 - 0.15
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(1, -1, 3)
    points = points + body.position_m[:, None]
    inside = points[0][superquadric_inside_outside(body, points)[0] < 1]
    arm = inside - inside.mean(axis=0)
    w, z = arm[:, 0] + 1j * arm[:, 1], arm[:, 2]
    spread, height = (np.abs(w) ** 2).mean(), z.std()
    long = abs((w**2).mean())
    expected = [np.log(len(inside) * (line[1] - line[0]) ** 3) / 3, np.log(inside[:, 2].mean()),
                np.log(height), np.log(np.sqrt(spread**2 - long**2) / 2) / 2, long / spread,
                (z * np.abs(w) ** 2).mean() / (height * spread),
                abs((z * w**2).mean()) / (height * spread), abs((w**4).mean()) / spread**2,
                (z**4).mean() / height**4]
    assert np.allclose(superquadric_description(body)[0], expected, atol=0.01)


def test_neither_names_of_axes_nor_place_nor_turn_matter() -> None:
    upright = Superquadric(*(np.array([v], float) for v in (
        [0.03, 0.04, 0.06], [0.2, 0.9], [0.4, 0.1, 0.06], [0, 0, 0, 1], [0.3, -0.2], [0, 0])))
    turned = upright._replace(position_m=upright.position_m + [[0.2, -0.3, 0.0]],
                              quaternion_xyzw=np.array([[0, 0, np.sin(0.4), np.cos(0.4)]]))
    # x and y exchanged by a quarter turn; z reversed, by half a turn about x.
    swapped = upright._replace(size_m=upright.size_m[:, [1, 0, 2]], taper=upright.taper[:, [1, 0]],
                               quaternion_xyzw=np.array([[0, 0, ROOT, ROOT]]))
    reversed_ = upright._replace(taper=-upright.taper,
                                 quaternion_xyzw=np.array([[1.0, 0, 0, 0]]))
    plain = superquadric_description(upright)
    for other in (turned, swapped, reversed_):
        assert np.allclose(superquadric_description(other), plain, atol=1e-9)
    # A box is the same whichever of its axes is called z.
    box = upright._replace(exponents=np.array([[0.4, 0.4]]), taper=np.zeros((1, 2)))
    lying = box._replace(size_m=box.size_m[:, [2, 1, 0]],
                         quaternion_xyzw=np.array([[0, ROOT, 0, ROOT]]))
    assert np.allclose(superquadric_description(lying), superquadric_description(box), atol=1e-9)


def test_covariance_is_that_of_small_displacements() -> None:
    body = bodies(1, 4)
    rng = np.random.default_rng(5)
    root = rng.normal(size=(15, 15)) * 3e-4
    draws = rng.normal(size=(4000, 15)) @ root.T
    draws[:, 13:] = 0.0
    many = Superquadric(*(np.repeat(field, len(draws), axis=0) for field in body))
    drawn = superquadric_description(displaced(many, draws))
    cov = root @ root.T
    cov[13:] = cov[:, 13:] = 0.0
    found = description_covariance(body, cov[None])[0]
    assert found.shape == (len(DESCRIPTION), len(DESCRIPTION))
    assert np.allclose(found, np.cov(drawn.T), atol=0.1 * np.sqrt(
        np.outer(np.diag(found), np.diag(found))))
