"""PUMA 560: forward and inverse kinematics undo each other; known configurations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from warpgrasp.mechanism.puma560 import (
    ALPHA_RAD,
    puma_forward_batch,
    puma_inverse_batch,
    puma_reachable_batch,
)
from warpgrasp.parameters import ArmTable

TABLE = ArmTable()


def dh_product(q: np.ndarray) -> np.ndarray:
    """An independent forward kinematics: the product of homogeneous DH matrices."""
    total = np.eye(4)
    for angle, d, a, alpha in zip(q, TABLE.d_m, TABLE.a_m, ALPHA_RAD, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        total = total @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s],
                                  [0, sa, ca, d], [0, 0, 0, 1]])
    return total


def test_forward_against_dh_matrices() -> None:
    q = np.random.default_rng(0).uniform(TABLE.limit_low_rad, TABLE.limit_high_rad, (200, 6))
    poses = puma_forward_batch(TABLE, q)
    for row, pose in zip(q, poses, strict=True):
        wanted = dh_product(row)
        assert np.allclose(pose[:3], wanted[:3, 3], atol=1e-12)
        assert np.allclose(Rotation.from_quat(pose[3:]).as_matrix(), wanted[:3, :3], atol=1e-12)


def test_all_eight_branches_reach_the_pose_and_one_is_the_original() -> None:
    q = np.random.default_rng(1).uniform(TABLE.limit_low_rad, TABLE.limit_high_rad, (2000, 6))
    pose = puma_forward_batch(TABLE, q)
    branches = puma_inverse_batch(TABLE, pose)
    assert np.isfinite(branches).all()
    again = puma_forward_batch(TABLE, branches.reshape(-1, 6)).reshape(2000, 8, 7)
    assert np.abs(again[..., :3] - pose[:, None, :3]).max() < 1e-12
    assert (1 - np.abs((again[..., 3:] * pose[:, None, 3:]).sum(-1))).max() < 1e-12
    gap = np.abs((branches - q[:, None] + np.pi) % (2 * np.pi) - np.pi).max(-1)
    assert gap.min(1).max() < 1e-9


def test_poses_are_reachable_where_a_branch_is_within_the_limits() -> None:
    rng = np.random.default_rng(2)
    count = 20_000
    poses = np.concatenate([rng.uniform([-0.9, -0.9, 0.0], [0.9, 0.9, 1.2], (count, 3)),
                            Rotation.random(count, rng=rng).as_quat()], 1)
    low = np.array(TABLE.limit_low_rad)
    with np.errstate(invalid="ignore"):
        turned = low + np.mod(puma_inverse_batch(TABLE, poses) - low, 2 * np.pi)
        some = (turned <= TABLE.limit_high_rad).all(-1).any(-1)
    assert 0.2 < some.mean() < 0.8
    assert np.array_equal(puma_reachable_batch(TABLE, poses), some)


@settings(max_examples=50)
@given(st.floats(1.3, 5.0), st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_out_of_reach_is_nan_not_garbage(far: float, azimuth: float, elevation: float) -> None:
    place = far * np.array([np.cos(azimuth) * np.cos(elevation),
                            np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    pose = np.array([[*place + [0, 0, TABLE.d_m[0]], 0, 0, 0, 1.0]])
    assert np.isnan(puma_inverse_batch(TABLE, pose)).any(-1).all()


@pytest.mark.parametrize("ask", [puma_forward_batch, puma_inverse_batch, puma_reachable_batch])
def test_joints_and_poses_are_as_many_as_an_arm_has(ask) -> None:
    """Five joints were six, the last at zero."""
    count = 6 if ask is puma_forward_batch else 7
    for wrong in (np.zeros((2, count - 1)), np.zeros((2, count + 1)), np.zeros(count)):
        with pytest.raises(ValueError, match=rf"should be \(pose, {count}\)"):
            ask(TABLE, wrong)
    assert len(ask(TABLE, np.zeros((0, count)))) == 0
