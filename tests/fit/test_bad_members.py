"""A number that is none, in whatever is given of one set, changes no byte of the other sets."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fit.fit_status import FitStatus
from fit.implicit.fit import fit_implicit
from fit.implicit.known import KnownProcess, fit_known, shared_error_means
from fit.implicit.mean_errors import errors_left
from fit.implicit.mesh import implicit_meshes
from fit.implicit.query import implicit_distance, implicit_slopes, implicit_values
from fit.implicit.record import ImplicitFit, ImplicitOptions, Mean
from fit.implicit.volume import implicit_volume
from fit.plane import fit_plane
from fit.revolution.fit import fit_revolution
from fit.revolution.record import Middle, RevolutionFit
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.uncertainty import superquadric_uncertainty

pytestmark = pytest.mark.filterwarnings("ignore:(invalid value|overflow) encountered")
DRAW = np.random.default_rng(2)
HALF_M, CENTRE_M = np.array([0.02, 0.03, 0.05]), np.array([0.0, 0.0, 0.05])
WAYS = DRAW.normal(size=(3, 24, 3))
WAYS /= np.linalg.norm(WAYS, axis=2, keepdims=True)
TOUCHES = WAYS * HALF_M + CENTRE_M
NORMALS = WAYS / HALF_M / np.linalg.norm(WAYS / HALF_M, axis=2, keepdims=True)
BAD, SPARED = 1, np.array([0, 2])
NONE = [np.nan, np.inf]
FEW_ROUNDS = ImplicitOptions(least_rounds=1, rounds=1)


def ball(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - CENTRE_M, axis=2) - 0.03


def implicit(**given: Any) -> ImplicitFit:
    return fit_implicit(**given, options=FEW_ROUNDS)


def revolution(points: np.ndarray, table_z: np.ndarray, point_m: np.ndarray,
               std_m: np.ndarray) -> RevolutionFit:
    return fit_revolution(points, table_z=table_z, middle=Middle(point_m, std_m))


def known(points: np.ndarray, normals: np.ndarray, sigma_m: np.ndarray, free_points: np.ndarray,
          mean: Mean) -> ImplicitFit:
    everything = np.ones(points.shape[:2], bool)
    return fit_known(points, everything, normals, sigma_m, KnownProcess(), mean=mean,
                     free_points=free_points, free_radius=0.02,
                     free_mask=np.ones(free_points.shape[:2], bool))


def shared(points: np.ndarray, normals: np.ndarray, sigma_m: np.ndarray,
           shared_m: np.ndarray) -> np.ndarray:
    return shared_error_means(points, np.ones(points.shape[:2], bool), normals, sigma_m, shared_m,
                              KnownProcess())


SETS = {"points": TOUCHES, "normals": NORMALS}
EVIDENCE = {"covariance": np.tile(1e-6 * np.eye(3), (3, 24, 1, 1)), "table_z": np.zeros(3)}
SPACE = {"free_points": DRAW.normal(0.0, 0.1, (3, 5, 3)), "free_radius": np.full((3, 5), 0.01)}
SIGMA = {"sigma_m": np.full((3, 24), 1e-3)}
GIVEN: dict[Callable, dict[str, Any]] = {
    fit_plane: {"points": TOUCHES},
    revolution: {"points": TOUCHES, "table_z": np.zeros(3), "point_m": np.tile(CENTRE_M, (3, 1)),
                 "std_m": np.full(3, 0.01)},
    fit_superquadric: {**SETS, **EVIDENCE, **SPACE},
    implicit: {**SETS, **EVIDENCE, **SPACE, "mean": ball},
    known: {**SETS, **SIGMA, "free_points": SPACE["free_points"], "mean": ball},
    shared: {**SETS, **SIGMA, "shared_m": DRAW.normal(0.0, 1e-3, (3, 24, 2))},
}


def spoiled(value: Any, number: float) -> Any:
    """`value` with a number that is none at the first place of the bad set."""
    if callable(value):
        return lambda points, rows: np.where(
            (rows == BAD)[:, None] & (np.arange(points.shape[1]) == 0), number, value(points, rows))
    found = value.copy()
    found[(BAD, *(0,) * (value.ndim - 1))] = number
    return found


def spared(value: Any) -> Any:
    """What is given of the other sets alone."""
    return value if callable(value) else value[SPARED]


def arrays(found: Any) -> dict[str, np.ndarray]:
    return {"": found} if isinstance(found, np.ndarray) else vars(found)


@pytest.fixture(scope="module")
def alone() -> dict[Callable, dict[str, np.ndarray]]:
    """What each function makes of the other sets alone."""
    return {ask: arrays(ask(**{name: spared(value) for name, value in given.items()}))
            for ask, given in GIVEN.items()}


@pytest.mark.parametrize(("ask", "name"), [(ask, name) for ask in GIVEN for name in GIVEN[ask]])
def test_a_number_that_is_none_spares_the_other_sets(ask: Callable, name: str, alone) -> None:
    for number in NONE:
        given = GIVEN[ask] | {name: spoiled(GIVEN[ask][name], number)}
        found = arrays(ask(**given))
        for field, value in alone[ask].items():
            assert found[field][SPARED].tobytes() == value.tobytes(), (number, field)
        if "status" in found:
            assert all(np.isfinite(value).all() for value in found.values()), number


def test_a_set_without_a_mean_at_a_touch_is_bad_and_its_body_nothing() -> None:
    def mean(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.where((rows == BAD)[:, None], np.nan, ball(points, rows))

    fits = fit_implicit(TOUCHES, mean=mean)
    assert fits.status[BAD] == FitStatus.bad_points
    assert (fits.status[SPARED] == FitStatus.converged).all()
    bodies, other = implicit_meshes(fits, mean), implicit_meshes(fits, ball)
    assert [len(body.faces) > 0 for body in bodies] == [True, False, True]
    volume, known_volume = implicit_volume(fits, bodies, mean), implicit_volume(fits, other, ball)
    for one in SPARED:
        assert np.array_equal(bodies[one].vertices_m, other[one].vertices_m)
        assert volume.std_m3[one] == known_volume.std_m3[one]
    alone = fit_implicit(TOUCHES[BAD:BAD + 1], mean=lambda points, rows: np.full(
        points.shape[:2], np.nan))
    assert alone.status.tolist() == [FitStatus.bad_points]


@pytest.mark.parametrize("ask", [implicit_values, implicit_distance, implicit_slopes])
def test_queries_of_one_fit_spare_the_others(ask: Callable) -> None:
    fits = fit_implicit(TOUCHES)
    places = DRAW.normal(0.05, 0.03, (3, 9, 3))
    right = ask(fits, places, ball)
    for number in NONE:
        for wrong in (ask(fits, spoiled(places, number), ball),
                      ask(fits, places, spoiled(ball, number))):
            for one, other in zip(*(found if isinstance(found, tuple) else arrays(found).values()
                                    for found in (wrong, right)), strict=True):
                assert one[SPARED].tobytes() == other[SPARED].tobytes()


def test_errors_of_one_mean_spare_the_others() -> None:
    fits = fit_implicit(TOUCHES)

    def ones(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.full((*points.shape[:2], 1), 1e-3)

    def none(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.where((rows == BAD)[:, None, None], np.nan, ones(points, rows))

    found, right = (errors_left(fits, errors, TOUCHES) for errors in (none, ones))
    assert np.isnan(found[BAD]).all()
    assert np.array_equal(found[SPARED], right[SPARED])


@pytest.mark.parametrize("name", ["size_m", "position_m", "quaternion_xyzw", "taper", "bend"])
def test_a_start_that_is_none_spares_the_other_fits_and_its_own(name: str) -> None:
    """Also one of a number that is as good as none: its square is infinite."""
    first = fit_superquadric(TOUCHES)
    right = arrays(fit_superquadric(TOUCHES[SPARED], start=first[SPARED]))
    for number in (*NONE, 1e300):
        start = replace(first, **{name: spoiled(getattr(first, name), number)})
        found = fit_superquadric(TOUCHES, start=start)
        assert all(np.isfinite(value).all() for value in vars(found).values())
        for field, value in right.items():
            assert vars(found)[field][SPARED].tobytes() == value.tobytes()
        told = superquadric_uncertainty(start, TOUCHES).covariance[SPARED]
        assert np.array_equal(told, superquadric_uncertainty(first, TOUCHES).covariance[SPARED])
