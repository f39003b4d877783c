"""Serial arms: the flange by Denavit-Hartenberg tables, the joints of a flange by iteration."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_file import SHIPPED_ARMS, arm_named
from warpgrasp.arms.arm_model import ArmJoint, ArmModel
from warpgrasp.arms.serial_arm import (
    arm_reach_m,
    flange_poses,
    joint_choices,
    nearest_joints,
    serial_places,
)

HALF = np.pi / 2
UR5E = ((0.1625, 0.0, HALF), (0.0, -0.425, 0.0), (0.0, -0.3922, 0.0), (0.1333, 0.0, HALF),
        (0.0997, 0.0, -HALF), (0.0996, 0.0, 0.0))
"""d, a [m] and alpha [rad] of standard Denavit-Hartenberg frames, as its maker has them."""
PANDA = ((0.0, 0.0, 0.333), (0.0, -HALF, 0.0), (0.0, HALF, 0.316), (0.0825, HALF, 0.0),
         (-0.0825, -HALF, 0.384), (0.0, HALF, 0.0), (0.088, HALF, 0.0), (0.0, 0.0, 0.107))
"""a, alpha and d of Craig's frames, as its maker has them; the last row is the flange."""


def turn_x(angle: float) -> np.ndarray:
    return _turn(Rotation.from_euler("x", angle))


def turn_z(angle: float) -> np.ndarray:
    return _turn(Rotation.from_euler("z", angle))


def shift(x: float = 0.0, z: float = 0.0) -> np.ndarray:
    found = np.eye(4)
    found[0, 3], found[2, 3] = x, z
    return found


def _turn(rotation: Rotation) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3] = rotation.as_matrix()
    return found


def flange_by_table(name: str, q: np.ndarray) -> np.ndarray:
    t = np.eye(4)
    if name == "ur5e":
        for angle, (d, a, alpha) in zip(q, UR5E, strict=True):
            t = t @ turn_z(angle) @ shift(z=d) @ shift(x=a) @ turn_x(alpha)
        return t
    for angle, (a, alpha, d) in zip([*q, 0.0], PANDA, strict=True):
        t = t @ turn_x(alpha) @ shift(x=a) @ turn_z(angle) @ shift(z=d)
    return t


def postures(model: ArmModel, count: int, seed: int = 0) -> np.ndarray:
    low, high = limits(model)
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


def limits(model: ArmModel) -> np.ndarray:
    return np.array([[j.low_rad, j.high_rad] for j in model.joints]).T


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_the_flange_is_that_of_the_makers_table(name: str) -> None:
    still = (0.0, 0.0, 0.0)
    model = replace(arm_named(name), base_xyz_m=still, base_rpy_rad=still)
    q = postures(model, 200)
    found = flange_poses(model, q)
    for angles, pose in zip(q, found, strict=True):
        wanted = flange_by_table(name, angles)
        np.testing.assert_allclose(pose[:3], wanted[:3, 3], atol=1e-12)
        np.testing.assert_allclose(Rotation.from_quat(pose[3:]).as_matrix(), wanted[:3, :3],
                                   atol=1e-12)


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_frames_on_the_host_end_at_the_kernels_flange(name: str) -> None:
    model = arm_named(name)
    q = postures(model, 20)
    ends = np.array([serial_places(model, angles)[-1] for angles in q])
    found = flange_poses(model, q)
    np.testing.assert_allclose(found[:, :3], ends[:, :3], atol=1e-12)
    assert np.allclose(np.abs((found[:, 3:] * ends[:, 3:]).sum(1)), 1.0, atol=1e-12)


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_joints_of_a_pose_take_the_flange_there(name: str) -> None:
    """Poses of postures anywhere within the limits: nearly all are found again, none beyond."""
    model = arm_named(name)
    wanted = flange_poses(model, postures(model, 1000))
    q = nearest_joints(model, wanted, np.tile(model.home_rad, (1000, 1)))
    reached = np.isfinite(q).all(1)
    assert reached.mean() > 0.99
    low, high = limits(model)
    assert ((q[reached] >= low) & (q[reached] <= high)).all()
    found = flange_poses(model, q[reached])
    np.testing.assert_allclose(found[:, :3], wanted[reached, :3], atol=1e-8)
    agree = np.abs((found[:, 3:] * wanted[reached, 3:]).sum(1))
    np.testing.assert_allclose(agree, 1.0, atol=1e-12)


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_a_small_motion_keeps_the_configuration(name: str) -> None:
    model = arm_named(name)
    q = postures(model, 300, 1)
    near = np.clip(q + np.random.default_rng(2).normal(0.0, 0.02, q.shape), *limits(model))
    found = nearest_joints(model, flange_poses(model, near), q)
    assert np.isfinite(found).all()
    assert np.quantile(np.abs(found - q).max(1), 0.98) < 0.15


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_of_the_joints_that_other_postures_come_to_the_nearest_are_taken(name: str) -> None:
    """By the joint that moves most; unless the pose is come to from where the arm is."""
    model = arm_named(name)
    last, wanted = postures(model, 400, 3), flange_poses(model, postures(model, 400, 4))
    found = nearest_joints(model, wanted, last)
    choices = joint_choices(model, wanted)[:, 1:]
    moves = np.abs(choices - last[:, None]).max(-1)
    chosen = (choices == found[:, None]).all(-1)
    several = chosen.any(1) & (np.isfinite(moves).sum(1) > 2)
    assert several.sum() > 20
    for row in np.flatnonzero(several):
        assert moves[row, chosen[row]].min() == np.nanmin(moves[row])


def unlike_arm(seed: int) -> ArmModel:
    """Six joints of which no two axes meet, all limited to less than a turn."""
    draw = np.random.default_rng(seed)
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    joints = []
    for n, axis in enumerate((z, y, y, x, y, x)):
        length = (0.1, 0.1, 0.35) if n < 3 else (0.3, 0.1, 0.1)
        a, b, c = (float(v) for v in draw.uniform(-0.15, 1.0, 3) * length)
        joints.append(ArmJoint(f"j{n}", (a, b, c), (0.0, 0.0, 0.0), axis,
                               -float(draw.uniform(1.8, 3.1)), float(draw.uniform(1.8, 3.1)), 2.0))
    still = (0.0, 0.0, 0.0)
    return ArmModel("unlike", tuple(joints), still, still, (0.1, 0.0, 0.0), still, (0.0,) * 6)


@pytest.mark.parametrize("seed", range(3))
def test_arms_of_unlike_proportions_are_found_too(seed: int) -> None:
    """Few starts come to a pose by which the wrist's axes do not meet; all the same nearly every
    pose is found again, within the limits, and the answer before moving says the same."""
    model = unlike_arm(seed)
    wanted = flange_poses(model, postures(model, 1000))
    q = nearest_joints(model, wanted, np.tile(model.home_rad, (1000, 1)))
    reached = np.isfinite(q).all(1)
    assert reached.mean() > 0.998
    low, high = limits(model)
    assert ((q[reached] >= low) & (q[reached] <= high)).all()
    np.testing.assert_allclose(flange_poses(model, q[reached])[:, :3], wanted[reached, :3],
                               atol=1e-8)
    choices = np.isfinite(joint_choices(model, wanted)[..., 0])
    assert (np.count_nonzero(choices, axis=1) > 0).tolist() == reached.tolist()


@settings(max_examples=20)
@given(st.sampled_from(SHIPPED_ARMS), st.floats(1.01, 20.0), st.integers(0, 1000))
def test_nothing_farther_than_the_arm_is_long_is_reached(name: str, times: float, seed: int
                                                         ) -> None:
    model = arm_named(name)
    way = np.random.default_rng(seed).normal(size=3)
    first = np.array(model.base_xyz_m) + Rotation.from_euler("xyz", model.base_rpy_rad).apply(
        model.joints[0].xyz_m)
    place = first + times * arm_reach_m(model) * way / np.linalg.norm(way)
    pose = np.array([[*place, 0.0, 0.0, 0.0, 1.0]])
    assert np.isnan(nearest_joints(model, pose, np.array([model.home_rad]))).all()
    assert np.isnan(joint_choices(model, pose)).all()


def test_a_pose_that_is_no_number_is_not_reached() -> None:
    model = arm_named("panda")
    assert np.isnan(nearest_joints(model, np.full((1, 7), np.nan),
                                   np.array([model.home_rad]))).all()


def test_joints_and_poses_of_other_shapes_are_refused() -> None:
    """Joints that were not given stood at zero."""
    model = arm_named("panda")
    flange = np.array([[0.4, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match=r"q_rad: .* should be \(pose, joint 7\)"):
        flange_poses(model, np.zeros((1, 6)))
    with pytest.raises(ValueError, match=r"last_rad: .* should be \(pose 1, joint 7\)"):
        nearest_joints(model, flange, np.zeros((2, 7)))
    for ask in (lambda wrong: nearest_joints(model, wrong, np.zeros((1, 7))),
                lambda wrong: joint_choices(model, wrong)):
        with pytest.raises(ValueError, match=r"flange: .* should be \(pose, 7\)"):
            ask(flange[:, :6])
    with pytest.raises(ValueError, match="starts 0: wants 1 to"):
        joint_choices(model, flange, starts=0)
