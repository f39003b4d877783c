"""What holds for every shape: motions and scales, order of points, sets that cannot be fitted."""

from collections.abc import Callable

import numpy as np
import pytest
from quality_bodies import standing_bodies, touches, volume_iou

from fit.fit_status import FitStatus, status_names
from fit.plane import fit_plane
from fit.plane_record import PlaneFit
from fit.revolution.fit import fit_revolution
from fit.revolution.record import RevolutionFit
from fit.rotation import matrix_of_quaternion
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import superquadric, superquadric_surface
from fit.superquadric.record import SuperquadricFit

RNG = np.random.default_rng
TURN = matrix_of_quaternion(np.array([0.2, -0.1, 0.3, 0.927361849549570]))
SHIFT = np.array([0.3, -0.2, 0.5])


def blocks() -> np.ndarray:
    """Touches on four bodies, shape [4, 60, 3] in metres."""
    return touches(standing_bodies(4, RNG(3)), 60, 1e-3, RNG(4))


def cones() -> np.ndarray:
    """Touches on the sides of three cones at an angle, shape [3, 60, 3] in metres."""
    rng = RNG(5)
    z, turn = rng.uniform(0, 0.12, (3, 60)), rng.uniform(-np.pi, np.pi, (3, 60))
    radius = 0.03 + 0.1 * z
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=2)
    return (points + 5e-4 * rng.normal(size=points.shape)) @ TURN.T


def sheets() -> np.ndarray:
    """Touches on three planes, shape [3, 30, 3] in metres."""
    rng = RNG(6)
    return (rng.uniform(-1, 1, (3, 30, 3)) * [0.03, 0.02, 5e-4] + 0.1) @ TURN.T


def on_superquadric(fit: SuperquadricFit) -> np.ndarray:
    return superquadric_surface(fit, 200)[0]


def on_revolution(fit: RevolutionFit) -> np.ndarray:
    """Nodes of the contour moved out along two directions across the axis that turn with it."""
    share = np.linspace(0, 1, fit.radius_m.shape[1])[None, :, None]
    nodes = fit.position_m[:, None] + share * (fit.height_m[:, None] * fit.axis)[:, None]
    return np.concatenate([nodes, nodes + fit.radius_m[..., None] * fit.axis[:, None]], axis=1)


def on_plane(fit: PlaneFit) -> np.ndarray:
    """The foot of the plane over the middle of the touches, and a step along the normal."""
    step = fit.extent_m[:, :1] * np.cross(fit.axes[:, 0], fit.axes[:, 1])
    return np.stack([fit.centre_m, fit.centre_m + step], axis=1)


SHAPES = pytest.mark.parametrize(("fit", "points", "on"), [
    (fit_superquadric, blocks, on_superquadric), (fit_revolution, cones, on_revolution),
    (fit_plane, sheets, on_plane)], ids=["superquadric", "revolution", "plane"])


def gap(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance from a point of one cloud to the other, for bodies written another way."""
    apart = np.linalg.norm(a[:, :, None] - b[:, None], axis=3)
    return float(apart.min(axis=2).max())


@SHAPES
def test_motions_and_scales_move_the_fit_with_them(
        fit: Callable, points: Callable, on: Callable) -> None:
    here = on(fit(points()))
    assert gap(on(fit(points() @ TURN.T + SHIFT)), here @ TURN.T + SHIFT) < 1e-6
    assert gap(on(fit(2.5 * points())), 2.5 * here) < 1e-6


@SHAPES
def test_the_order_of_points_changes_nothing(
        fit: Callable, points: Callable, on: Callable) -> None:
    given = points()
    shuffled = given[:, RNG(7).permutation(given.shape[1])]
    assert np.abs(on(fit(shuffled)) - on(fit(given))).max() < 1e-9


@SHAPES
def test_sets_that_cannot_be_fitted_have_a_status_and_spoil_nobody(
        fit: Callable, points: Callable, on: Callable) -> None:
    good = points()[0]
    count = len(good)
    line = np.linspace(0, 1, count)[:, None] * [0.1, 0.05, 0.02]
    nan, infinite = good.copy(), good.copy()
    nan[7, 1], infinite[3, 2] = np.nan, np.inf
    far, farther = good.copy(), 1e200 * good
    far[5, 0] = -1e160
    twice = np.concatenate([good[: count // 2]] * 2)
    few = np.tile(good[:2], (count // 2, 1))
    sets = np.stack([good, good * [1, 1, 0], line, np.tile(good[:1], (count, 1)), nan, infinite,
                     good, twice, few, good, far, farther])
    mask = np.ones((len(sets), count), bool)
    mask[6] = False
    found = fit(sets, mask)
    names = status_names(found.status)
    solid = fit is not fit_plane
    assert names[1] == ("degenerate_plane" if solid else "converged")
    assert names[2:7] == ["degenerate_line", "degenerate_point", "bad_points", "bad_points",
                          "too_few_points"]
    assert found.status[7] in (FitStatus.converged, FitStatus.not_converged)
    assert names[8] == "degenerate_line"
    assert names[10:] == ["bad_points", "bad_points"]
    assert all(np.isfinite(value).all() for value in vars(found).values())
    alone = fit(points()[:1])
    for name, value in vars(found).items():
        assert np.array_equal(value[[0, 9]], vars(alone)[name][[0, 0]]), name


@pytest.mark.slow
def test_normals_make_up_for_few_touches() -> None:
    body = superquadric(*(np.repeat(v, 12, axis=0) for v in superquadric(
        [0.03, 0.04, 0.05], [0.2, 0.4], [0.45, 0.0, 0.05])))
    surface, normal, _ = superquadric_surface(body, 600)
    rng = RNG(8)
    pick = rng.integers(0, surface.shape[1], (12, 14, 1))
    points = np.take_along_axis(surface, pick, axis=1) + 2e-3 * rng.normal(size=(12, 14, 3))
    felt = np.take_along_axis(normal, pick, axis=1) + 0.05 * rng.normal(size=(12, 14, 3))
    known = volume_iou(body, fit_superquadric(points, normals=felt, table_z=0.0))
    blind = volume_iou(body, fit_superquadric(points, table_z=0.0))
    assert np.mean(known) > np.mean(blind) + 0.02
    assert np.mean(known > blind) > 0.7
