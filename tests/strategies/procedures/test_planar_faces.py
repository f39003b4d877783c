"""Faces of known touches: which are flat, which way they look, how well angles are told."""

import numpy as np
import pytest

from fit.fit_status import FitStatus
from strategies.procedures.lean import face_axes
from strategies.procedures.planar_faces import Face, angle_between, planes_of
from strategies.procedures.planar_record import PlanarExploration
from strategies.procedures.touches import EndReason, MissedTips, TouchTable

SIDE = np.array([0.6, -0.8, 0.0])


def face(normal: np.ndarray, wide_m: float, high_m: float, *, bow_m: float = 0.0,
         noise_m: float = 2e-4, felt: np.ndarray | None = None, seed: int = 0) -> Face:
    """The face of one world by 60 touches, `wide_m` along u and `high_m` along v, that bows along u
    by `bow_m` from its middle to its ends; pads felt the normals `felt`, or the true one."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(-0.5, 0.5, (2, 60))
    axes = face_axes(normal[None])
    along = np.stack([wide_m * u, high_m * v, noise_m * rng.normal(size=60) - 4 * bow_m * u**2], 1)
    zero = np.zeros(60, int)
    table = TouchTable(zero, zero, zero, zero, zero, [0.45, 0.1, 0.08] + along @ axes[0],
                       np.tile(normal if felt is None else felt, (60, 1)), np.zeros((60, 4)), zero,
                       np.zeros((60, 16, 16)), np.zeros((60, 7)), zero, zero)
    one = np.zeros(1)
    return planes_of(PlanarExploration(
        table, np.array([EndReason.COMPLETE]), np.zeros((1, 4), int), axes, one, one, one, one,
        MissedTips(zero[:0], np.zeros((0, 3)))))


@pytest.mark.parametrize(("wide_m", "high_m", "bow_m", "noise_m", "flat"), [
    (0.04, 0.03, 0.0, 2e-4, True), (0.04, 0.03, 0.0, 0.002, False),  # they lie off it
    (0.04, 0.03, 0.0025, 2e-4, False), (0.04, 0.03, -0.0025, 2e-4, False),  # it bows
    (0.003, 0.06, 0.0, 6e-4, False), (0.06, 0.003, 0.0, 6e-4, False),  # too narrow to tell
    (0.012, 0.06, 0.0, 6e-4, True)])
def test_a_face_is_flat_if_its_touches_are_near_a_plane_and_wide_enough_to_tell_it(
        wide_m: float, high_m: float, bow_m: float, noise_m: float, flat: bool) -> None:
    found = face(SIDE, wide_m, high_m, bow_m=bow_m, noise_m=noise_m)
    assert found.flat.tolist() == [flat]
    if abs(bow_m) > 0.0:  # h falls by the bow from the middle to the ends
        assert found.bow_m[0, 0] == pytest.approx(-bow_m, rel=0.15)


@pytest.mark.parametrize("normal", [SIDE, -SIDE, np.array([0.0, 0.0, 1.0])])
def test_normals_look_outwards_and_offsets_are_along_them(normal: np.ndarray) -> None:
    for seed in range(6):
        found = face(normal, 0.04, 0.03, seed=seed)
        assert found.normal[0] @ normal > 0.999
        assert found.offset_m[0] == pytest.approx(found.normal[0] @ [0.45, 0.1, 0.08], abs=1e-4)
        assert found.felt_normal[0] == pytest.approx(normal)


def test_a_plane_across_the_normals_felt_on_it_is_none() -> None:
    across = face(SIDE, 0.04, 0.03, felt=np.array([0.0, 0.0, 1.0]))
    assert across.fit.status.tolist() == [FitStatus.not_converged]
    assert not across.flat.any()


def test_angles_err_by_as_much_as_they_say() -> None:
    """Of two neighbours whose touches spread far along one axis and little along the other."""
    other = np.array([0.8, 0.6, 0.0])
    angle, std = np.transpose([[v[0] for v in angle_between(
        face(SIDE, 0.01, 0.06, seed=seed), face(other, 0.01, 0.06, seed=1000 + seed))]
        for seed in range(25)])
    assert angle.mean() == pytest.approx(np.pi / 2, abs=0.005)
    assert angle.std() == pytest.approx(np.median(std), rel=0.35)
