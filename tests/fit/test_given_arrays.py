"""Arrays given to fits: what is wrong is named, and batches may be empty."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fit.fit_status import FitStatus
from fit.implicit.fit import fit_implicit
from fit.implicit.mean_errors import errors_left
from fit.implicit.query import implicit_distance, implicit_slopes, implicit_values
from fit.implicit.volume import implicit_volume
from fit.option_checks import checked_array
from fit.plane import fit_plane
from fit.prepare import prepare
from fit.revolution.fit import fit_revolution
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import superquadric
from fit.superquadric.uncertainty import superquadric_uncertainty

pytestmark = pytest.mark.usefixtures("unchecked")
TOUCHES = np.random.default_rng(2).normal(size=(2, 24, 3)) * [0.02, 0.03, 0.05]
FITS = pytest.mark.parametrize("fit", [fit_plane, fit_revolution, fit_superquadric, fit_implicit])


@pytest.mark.parametrize("value", ["abc", [[0.0], [0.0, 1.0]], {"x": 1}])
def test_what_is_no_array_is_named(value: Any) -> None:
    with pytest.raises(ValueError, match="points: is no array of numbers"):
        checked_array("points", value, (None, 3))


@FITS
def test_a_batch_without_sets_or_without_slots_is_fitted(fit: Callable) -> None:
    assert len(fit(TOUCHES[:0]).status) == 0
    empty = fit(TOUCHES[:, :0])
    assert (empty.status == FitStatus.too_few_points).all()
    assert all(np.isfinite(value).all() for value in vars(empty).values())


@pytest.mark.parametrize(("fits", "queries"), [(0, 5), (0, 0), (2, 0)])
def test_free_forms_may_be_none_and_asked_at_no_points(fits: int, queries: int) -> None:
    """They have a distance and a gradient at each query, of which there are none."""
    found, at = fit_implicit(TOUCHES[:fits]), np.zeros((fits, queries, 3))
    assert implicit_values(found, at).shape == (fits, queries)
    values, (distance, gradient) = implicit_distance(found, at), implicit_slopes(found, at)
    assert values.distance_m.shape == values.std_m.shape == distance.shape == (fits, queries)
    assert values.gradient.shape == gradient.shape == (fits, queries, 3)
    left = errors_left(found, lambda points, rows: np.ones((*points.shape[:2], 4)), at)
    assert left.shape == (fits, queries, 4)


def test_no_free_forms_have_no_volumes() -> None:
    found = implicit_volume(fit_implicit(TOUCHES[:0]), [])
    assert found.interval_m3().shape == (0, 2)
    assert found.surface_m.shape == (0, *found.surface_std_m.shape[1:], 3)


@pytest.mark.parametrize(("wrong", "said"), [
    ({"free_points": np.zeros(3)}, r"free_points: shape \(3,\), should be \(2, any, 3\)"),
    ({"free_points": np.zeros((2, 4, 3)), "free_radius": np.ones(3)},
     r"free_radius: shape \(3,\), should be one number or \(2, 4\)"),
    ({"mean": lambda points, rows: 0.0}, r"mean: shape \(\), should be \(2, ")])
def test_evidence_of_free_forms_is_named(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        fit_implicit(TOUCHES, **wrong)


@pytest.mark.parametrize("ask", [implicit_values, implicit_distance])
def test_queries_of_a_wrong_shape_are_named(ask: Callable) -> None:
    """Also three points for three fits, which would spread."""
    found = fit_implicit(np.zeros((3, 8, 3)))
    with pytest.raises(ValueError, match=r"queries_m: shape \(3, 3\), should be \(3, any, 3\)"):
        ask(found, TOUCHES[0, :3])


@pytest.mark.parametrize(("wrong", "said"), [
    ({"points": TOUCHES[0]}, r"points: shape \(24, 3\), should be \(2, any, 3\)"),
    ({"points": TOUCHES[:1]}, r"points: shape \(1, 24, 3\)"),
    ({"mask": np.ones(24, bool)}, r"mask: shape \(24,\), should be \(2, 24\)"),
    ({"covariance": np.eye(3)}, r"covariance: shape \(3, 3\), should be \(2, 24, 3, 3\)"),
    ({"shared_m": np.zeros((2, 24))}, r"shared_m: shape \(2, 24\), should be \(2, 24, any\)"),
    ({"shared_m": np.full((2, 24, 1), np.nan)},
     r"shared_m: \[nan\] at touch 0 of fit 0, should be finite"),
    ({"table_sigma_m": 0.0, "table_z": 0.0}, "table_sigma_m: 0.0, should be a finite number, ab"),
    ({"table_sigma_m": np.nan}, "table_sigma_m: nan, should be"),
    ({"sigma_floor_m": -1e-3}, "sigma_floor_m: -0.001, should be a finite number, 0 or more")])
def test_touches_of_an_uncertainty_are_named(wrong: dict[str, Any], said: str) -> None:
    bodies = superquadric(np.tile([0.02, 0.03, 0.05], (2, 1)), [0.5, 0.8])
    with pytest.raises(ValueError, match=said):
        superquadric_uncertainty(bodies, **{"points": TOUCHES, **wrong})


def test_a_shared_error_that_is_no_number_spares_the_other_fits() -> None:
    bodies = superquadric(np.tile([0.02, 0.03, 0.05], (2, 1)), [0.5, 0.8])

    def shifts(normal: np.ndarray) -> np.ndarray:
        return np.where(np.arange(2)[:, None, None] == 1, np.nan, 1e-4 * normal)

    found = superquadric_uncertainty(bodies, TOUCHES, shared_m=shifts)
    alone = superquadric_uncertainty(bodies, TOUCHES, shared_m=lambda normal: 1e-4 * normal)
    assert np.isnan(found.covariance[1]).any()
    assert np.array_equal(found.covariance[0], alone.covariance[0])


@pytest.mark.parametrize("fit", [fit_superquadric, fit_implicit])
@pytest.mark.parametrize("given", [{"free_radius": 0.01}, {"free_mask": np.ones((2, 3), bool)}])
def test_balls_without_places_are_refused(fit: Callable, given: dict[str, Any]) -> None:
    """They were passed over: the body was fitted as if no free space were known."""
    with pytest.raises(ValueError, match=r"free_.*: given without free_points, should "):
        fit(TOUCHES, **given)


@pytest.mark.parametrize("fit", [fit_superquadric, fit_implicit])
@pytest.mark.parametrize("radius", [-0.01, np.nan, np.inf])
def test_a_radius_of_all_balls_is_a_length(fit: Callable, radius: float) -> None:
    """Without a word the balls were points, let the body in, or did not count."""
    with pytest.raises(ValueError, match=r"free_radius: .*, should be a finite number, 0 or more"):
        fit(TOUCHES, free_points=np.zeros((2, 1, 3)), free_radius=radius)


def test_a_ball_of_negative_radius_does_not_count() -> None:
    found = prepare(TOUCHES, None, free_points=np.zeros((2, 2, 3)),
                    free_radius=np.array([[0.01, -0.01]] * 2)).free
    assert found is not None
    assert (found[:, 3] > 0.0).sum(1).tolist() == [1, 1]


def test_a_middle_is_one() -> None:
    with pytest.raises(ValueError, match="middle: tuple, should be a Middle"):
        fit_revolution(TOUCHES, middle=(np.zeros((2, 3)), np.ones(2)))  # type: ignore[arg-type]
