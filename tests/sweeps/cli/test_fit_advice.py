"""What `warpgrasp fit` goes by when it says that touches, normals or a table may be wrong."""

from contextlib import nullcontext
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fit.fit_status import FitStatus
from fit.plane import fit_plane
from fit.point_sets import PointSets
from fit.revolution.record import RevolutionFit
from fit.superquadric import uncertainty
from fit.superquadric.record import SuperquadricFit
from sweeps.cli.tools.fit_advice import (
    WIDE_FACTOR,
    _open_turn_rad,
    plane_advice,
    revolution_advice,
    vague_superquadrics,
)
from sweeps.cli.tools.fit_points import BELOW_M, BELOW_SHARE, INWARD_M, _check_table, inward
from sweeps.spec.errors import StoreError


def one_set(touches_m: np.ndarray, normals: np.ndarray | None = None) -> PointSets:
    return PointSets(("a",), touches_m, np.array([len(touches_m)]), normals)


@pytest.mark.parametrize("spread", [1.0, 3.0, 5.0])
def test_the_turn_without_a_touch_is_the_rest_of_a_circle_wherever_it_lies(spread: float) -> None:
    for start in np.linspace(0.0, 6.0, 13):
        turn = start + np.linspace(0.0, spread, 40)
        arm = 0.03 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], 1)
        assert _open_turn_rad(arm) == pytest.approx(2.0 * np.pi - spread)


@pytest.mark.parametrize(("low", "high", "table_z_m", "beyond_mm", "lies"), [
    (0.02, 0.1, None, "20", False), (0.02, 0.1, 0.0, "", False), (0.02, 0.1, -0.03, "20", True),
    (0.0, 0.07, 0.0, "30", False), (0.0, 0.07, None, "30", False),
    (0.001, 0.099, None, "", False)])
def test_a_body_may_end_beyond_its_touches_at_either_end_but_on_a_table(
        low: float, high: float, table_z_m: float | None, beyond_mm: str, lies: bool) -> None:
    turn = np.linspace(0.0, 30.0, 60)
    touches = np.stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), np.linspace(low, high, 60)], 1)
    axis = np.array([[0.0, 0.0, 1.0]])
    if lies:
        touches, axis = np.roll(touches, 1, axis=1), np.roll(axis, 1, axis=1)
    values: dict[str, Any] = dict.fromkeys(field.name for field in fields(RevolutionFit))
    found = RevolutionFit(**values | {
        "position_m": np.zeros((1, 3)), "axis": axis, "rms_m": np.zeros(1),
        "height_m": np.array([0.1]), "status": np.array([FitStatus.converged])})
    said = revolution_advice(one_set(touches), found, table_z_m=table_z_m)
    assert [line.rsplit(": ", 1)[1] for line in said] == [f"a ({beyond_mm} mm)"] * bool(beyond_mm)


@pytest.mark.parametrize("rise_m", [0.0, 0.03])
def test_planes_that_touches_lie_far_off_are_told(rise_m: float) -> None:
    x, y = (v.ravel() for v in np.meshgrid(*[np.linspace(-0.05, 0.05, 9)] * 2))
    touches = np.stack([x, y, rise_m * (x / 0.05) ** 2], 1)
    said = plane_advice(one_set(touches), fit_plane(touches[None]))
    assert [("off (rms): a (" in line) for line in said] == [True] * (rise_m > 0.0)


@pytest.mark.parametrize("length", [0.1, 1.0, 50.0])
def test_normals_of_any_length_point_inwards_by_as_much(length: float) -> None:
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), -1).reshape(-1, 3) / np.sqrt(3.0)
    for deep, told in ((0.9 * INWARD_M, []), (1.1 * INWARD_M, ["a"])):
        assert inward(one_set(0.5 + deep * corners, -length * corners)) == told


@pytest.mark.parametrize(("share", "z_m", "wrong"), [
    (0.5 * BELOW_SHARE, -2 * BELOW_M, None), (2 * BELOW_SHARE, -2 * BELOW_M, "lie below it"),
    (0.5, -0.5 * BELOW_M, None), (1.0, 1.0, None), (1.0, 50.0, "lie far above it")])
def test_a_table_may_be_above_few_touches_or_by_little(
        share: float, z_m: float, wrong: str | None) -> None:
    touches = np.random.default_rng(1).uniform([0.0, 0.0, 0.02], [0.1, 0.1, 0.1], (100, 3))
    touches[:int(100 * share), 2] = z_m
    with pytest.raises(StoreError, match=wrong) if wrong else nullcontext():
        _check_table(one_set(touches), 0.0)


def test_touches_tell_little_where_the_interval_of_a_volume_is_wide(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Of spheres that are touched all around; whose fit failed is not asked about."""
    high = np.array([0.99 * WIDE_FACTOR, 1.01 * WIDE_FACTOR, 1.01 * WIDE_FACTOR])
    monkeypatch.setattr(uncertainty, "superquadric_uncertainty", lambda bodies, *_, **__:
                        SimpleNamespace(volume_interval_m3=lambda: np.stack(
                            [np.full(len(bodies), 1e-4), 1e-4 * high[:len(bodies)]], axis=1)))
    values: dict[str, Any] = dict.fromkeys((f.name for f in fields(SuperquadricFit)), np.zeros(3))
    found = SuperquadricFit(**values | {
        "size_m": np.full((3, 3), 0.03), "exponents": np.ones((3, 2)),
        "position_m": np.zeros((3, 3)), "quaternion_xyzw": np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)),
        "taper": np.zeros((3, 2)), "bend": np.zeros((3, 2)),
        "status": np.array([FitStatus.converged, FitStatus.not_converged,
                            FitStatus.too_few_points])})
    way = np.random.default_rng(2).normal(size=(3, 60, 3))
    touches = 0.03 * way / np.linalg.norm(way, axis=2, keepdims=True)
    vague = vague_superquadrics(found, touches, np.ones((3, 60), bool), None)
    assert vague.tolist() == [False, True, False]
