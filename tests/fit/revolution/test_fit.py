"""Surfaces of revolution: a cone, a bottle-like contour, tilted, with strays."""

import numpy as np
import pytest

from fit.fit_status import FitStatus
from fit.revolution.fit import fit_revolution
from fit.revolution.geometry import RevolutionBody, revolution_inside, revolution_volume
from fit.revolution.record import Middle, RevolutionOptions
from fit.rotation import matrix_of_quaternion

CONTOUR = (np.array([0.0, 0.1, 0.14, 0.2]), np.array([0.035, 0.035, 0.014, 0.014]))


def bottle(n: int, count: int, noise: float, rng, strays: float = 0.0) -> np.ndarray:
    """Touches on the side of upright bottles 200 mm high at random places."""
    z = rng.uniform(0.02, 0.2, (n, count))
    radius = np.interp(z, *CONTOUR)
    turn = rng.uniform(-np.pi, np.pi, (n, count))
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=2)
    points += noise * rng.normal(size=points.shape)
    points[:, : round(strays * count)] += 0.02 * rng.normal(size=(n, round(strays * count), 3))
    return points + np.concatenate([rng.uniform(-0.1, 0.5, (n, 1, 2)), np.zeros((n, 1, 1))], axis=2)


def true_volume() -> float:
    z = np.linspace(0, 0.2, 20001)
    return float(np.trapezoid(np.pi * np.interp(z, *CONTOUR) ** 2, z))


def test_a_bottle_on_the_table() -> None:
    points = bottle(8, 80, 1e-3, np.random.default_rng(0), strays=0.1)
    found = fit_revolution(points, table_z=0.0)
    assert (found.status == FitStatus.converged).mean() > 0.8
    tilt = np.degrees(np.arccos(np.minimum(found.axis[:, 2], 1)))
    assert np.median(tilt) < 2
    assert np.median(np.abs(found.volume_m3 / true_volume() - 1)) < 0.08
    assert np.abs(found.height_m - 0.2).max() < 0.015


def test_volume_and_inside_are_those_of_the_body() -> None:
    points = bottle(2, 60, 5e-4, np.random.default_rng(1))
    found = fit_revolution(points, table_z=0.0)
    on_axis = found.position_m[:, None] + 0.5 * found.height_m[:, None, None] * found.axis[:, None]
    share = np.linspace(0.0, 1.0, found.radius_m.shape[1])
    body = RevolutionBody(found.position_m, found.axis, found.height_m[:, None] * share,
                          found.radius_m)
    assert found.volume_m3 == pytest.approx(revolution_volume(body), rel=1e-12)
    assert revolution_inside(body, on_axis).all()
    assert not revolution_inside(body, on_axis + np.array([0.2, 0, 0])).any()


def test_a_tilted_cylinder_without_a_table() -> None:
    rng = np.random.default_rng(2)
    turn = rng.uniform(-np.pi, np.pi, (4, 60))
    z = rng.uniform(0, 0.12, (4, 60))
    points = np.stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), z], axis=2)
    points += 5e-4 * rng.normal(size=points.shape)
    q = rng.normal(size=(4, 4))
    frame = matrix_of_quaternion(q / np.linalg.norm(q, axis=1, keepdims=True))
    found = fit_revolution(np.einsum("fij,fpj->fpi", frame, points))
    away = np.degrees(np.arccos(np.abs(np.einsum("fi,fi->f", found.axis, frame[:, :, 2]))))
    assert away.max() < 1.5
    assert np.abs(found.radius_m[:, 2:-2] - 0.03).max() < 1e-3
    assert (found.radius_std_m[:, 2:-2] < 1e-3).all()


def test_a_barrel_that_lies_touches_the_table_with_its_middle() -> None:
    rng = np.random.default_rng(11)
    z, turn = rng.uniform(-0.06, 0.06, (4, 60)), rng.uniform(-np.pi, np.pi, (4, 60))
    radius = 0.036 - 5.0 * z**2
    points = np.stack([z, radius * np.cos(turn), 0.036 + radius * np.sin(turn)], axis=2)
    points += 5e-4 * rng.normal(size=points.shape)
    found = fit_revolution(points, table_z=0.0)
    assert np.abs(found.axis[:, 0]).min() > 0.999
    assert found.rms_m.max() < 1e-3
    assert np.abs(found.radius_m.max(axis=1) - 0.036).max() < 1e-3


def test_a_monotone_contour_never_rises() -> None:
    points = bottle(3, 40, 2e-3, np.random.default_rng(3))
    found = fit_revolution(points, table_z=0.0, options=RevolutionOptions(monotone="falling"))
    assert (np.diff(found.radius_m, axis=1) < 1e-3).all()


@pytest.mark.usefixtures("unchecked")
def test_unknown_words_and_a_lone_node_are_named() -> None:
    with pytest.raises(ValueError, match="monotone: 'decreasing', should be one of none, falling"):
        RevolutionOptions(monotone="decreasing")  # pyright: ignore
    with pytest.raises(ValueError, match="loss: 'huber', should be one of none, pseudo_huber"):
        RevolutionOptions(loss="huber")  # pyright: ignore
    with pytest.raises(ValueError, match="nodes: 1, should be a whole number, 2 at least"):
        RevolutionOptions(nodes=1)


@pytest.mark.slow
def test_two_nodes_are_a_frustum() -> None:
    rng = np.random.default_rng(6)
    z, turn = rng.uniform(0, 0.1, (2, 60)), rng.uniform(-np.pi, np.pi, (2, 60))
    radius = 0.04 - 0.2 * z
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=2)
    found = fit_revolution(points, table_z=0.0, options=RevolutionOptions(nodes=2))
    assert found.radius_m == pytest.approx(np.tile([0.04, 0.02], (2, 1)), abs=1e-3)


def test_padding_changes_no_bit_and_bad_sets_have_a_status() -> None:
    points = bottle(3, 60, 1e-3, np.random.default_rng(4))
    plain = fit_revolution(points, table_z=0.0)
    padded = np.full((3, 90, 3), np.nan)
    mask = np.zeros((3, 90), bool)
    padded[:, 20:80], mask[:, 20:80] = points, True
    mask[1, 0] = True
    found = fit_revolution(padded, mask, table_z=0.0)
    assert FitStatus(found.status[1]) is FitStatus.bad_points
    for name, value in vars(plain).items():
        assert np.array_equal(getattr(found, name)[[0, 2]], value[[0, 2]]), name
    assert all(np.isfinite(value).all() for value in vars(found).values())


def test_middles_that_are_none_spoil_no_other_set() -> None:
    """Unknown where the deviation is infinite, whatever the point; one without error counts as
    nearly exact."""
    points = bottle(1, 60, 1e-3, np.random.default_rng(8)).repeat(6, axis=0)
    centre = points.mean(axis=1)
    centre[1] = np.nan
    centre[2, 0] = np.inf
    std = np.array([np.inf, np.inf, 0.01, np.nan, -0.01, 0.0])
    found = fit_revolution(points, table_z=0.0, middle=Middle(centre, std))
    assert np.flatnonzero(found.status == FitStatus.bad_points).tolist() == [2, 3, 4]
    assert all(np.isfinite(value).all() for value in vars(found).values())
    alone = fit_revolution(points[:1], table_z=0.0)
    for name, value in vars(found).items():
        np.testing.assert_array_equal(value[:2], vars(alone)[name].repeat(2, axis=0), name)
    axis = found.axis[5] / found.axis[5, 2]
    half = 0.5 * found.height_m[5] * found.axis[5, 2]
    assert np.allclose(found.position_m[5] + half * axis, [*centre[5, :2], half], atol=2e-3)


def test_middles_of_other_sets_are_refused() -> None:
    points = bottle(2, 20, 1e-3, np.random.default_rng(9))
    with pytest.raises(ValueError, match=r"middle.point_m: shape \(3, 3\), should be \(2, 3\)"):
        fit_revolution(points, middle=Middle(np.zeros((3, 3)), np.ones(3)))


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_a_cone_touched_without_error_converges(smoothing: float) -> None:
    rng = np.random.default_rng(5)
    z, turn = rng.uniform(0, 0.12, (6, 60)), rng.uniform(-np.pi, np.pi, (6, 60))
    radius = 0.04 - 0.18 * z
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=2)
    found = fit_revolution(points, table_z=0.0, options=RevolutionOptions(smoothing=smoothing))
    assert found.status.tolist() == [FitStatus.converged] * 6
    assert found.rms_m.max() < 1e-7
    share = np.linspace(0.0, 1.0, 8)
    height = found.position_m[:, 2:] + found.height_m[:, None] * share
    assert np.allclose(found.radius_m, 0.04 - 0.18 * height, atol=1e-6)
