"""What a strategy may ask of the PUMA 560 before it moves: how long a way takes, how far it gets.
"""

from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_file import arm_named, arm_text
from warpgrasp.mechanism.arm_motion_kernel import RETREAT_M
from warpgrasp.mechanism.arm_reach import (
    hand_reachable,
    nearest_reachable,
    pose_reachable,
    travel_time,
)
from warpgrasp.mechanism.puma560 import puma_inverse_batch
from warpgrasp.parameters import ArmTable, HandTable

ARM, HAND = ArmTable(), HandTable()
DOWN = Rotation.from_euler("zyz", [0.3, np.pi - 0.2, 0.5])


def angles_of(place: np.ndarray) -> list[np.ndarray]:
    """Joints within the limits that take the hand to a place, turned as `DOWN`."""
    flange = np.array([*(place - DOWN.apply([0.0, 0.0, HAND.mount_length_m])), *DOWN.as_quat()])
    found = []
    for branch in puma_inverse_batch(ARM, flange[None])[0]:
        turns = [[q + 2 * np.pi * k for k in range(-2, 3) if low <= q + 2 * np.pi * k <= high][:1]
                 for q, low, high in zip(branch, ARM.limit_low_rad, ARM.limit_high_rad,
                                         strict=True)]
        found += [np.array(q) for q in product(*turns)]
    return found


def test_a_way_takes_as_long_as_its_slowest_joint_by_the_best_configurations() -> None:
    places = np.random.default_rng(4).uniform([0.3, -0.3, 0.2], [0.6, 0.3, 0.4], (9, 3))
    poses = np.concatenate([places, np.tile(DOWN.as_quat(), (9, 1))], 1)
    wanted = [min(float((np.abs(a - b) / ARM.speed_rad_s).max())
                  for a in angles_of(start) for b in angles_of(end))
              for start, end in pairwise(places)]
    np.testing.assert_allclose(travel_time(ARM, HAND, poses[:-1], poses[1:]), wanted, atol=1e-6)
    far = poses[:1] + [3.0, 0, 0, 0, 0, 0, 0]
    assert np.isinf(travel_time(ARM, HAND, poses[:1], far)).all()


def test_a_pose_is_reached_where_the_retreat_behind_it_is_too() -> None:
    """Near the border of the reach one of both is beyond it."""
    steps = np.linspace(0.0, 1.2, 200)
    poses = np.array([[*(x * np.array([0.8, 0.0, 0.6])), *DOWN.as_quat()] for x in steps])
    behind = poses.copy()
    behind[:, :3] -= DOWN.apply([0.0, 0.0, RETREAT_M])
    own, back = (hand_reachable(ARM, HAND, each) for each in (poses, behind))
    assert (own != back).any()
    np.testing.assert_array_equal(pose_reachable(ARM, HAND, poses), own & back)


@pytest.mark.parametrize("place", [(1.6, 0.2, 0.3), (0.9, -0.9, 0.6), (0.5, 0.1, 0.25)])
def test_the_nearest_pose_is_reached_and_none_a_step_nearer(place: tuple[float, ...]) -> None:
    pose = np.array([*place, *DOWN.as_quat()])
    found = nearest_reachable(ARM, HAND, pose)
    assert found is not None
    np.testing.assert_array_equal(found[3:], pose[3:])
    assert pose_reachable(ARM, HAND, found)
    way = pose[:3] - found[:3]
    if pose_reachable(ARM, HAND, pose):
        assert way == pytest.approx(0.0, abs=1e-12)
        return
    nearer = found.copy()
    nearer[:3] += 0.01 * way / np.linalg.norm(way)
    assert not pose_reachable(ARM, HAND, nearer)


def test_a_long_arm_is_asked_as_far_as_it_reaches(tmp_path: Path) -> None:
    """Twice as long as a UR5e: places within 1.2 m of the base were searched."""
    model = arm_named("ur5e")
    twice = [replace(joint, xyz_m=tuple(2.0 * np.array(joint.xyz_m))) for joint in model.joints]
    file = tmp_path / "long.toml"
    file.write_text(arm_text(replace(model, joints=tuple(twice))))
    arm = ArmTable(kind=str(file))
    pose = np.array([2.0, 0.2, 0.5, *DOWN.as_quat()])
    found = nearest_reachable(arm, HAND, pose)
    assert found is not None
    assert pose_reachable(arm, HAND, found)
    assert np.hypot(*found[:2]) > 1.5
