"""Rests of rubbing fingers by Newton's method, beside those by passes with friction lagged."""

import numpy as np
import pytest
import warp as wp
from closings import HAND, body_of, poses_about

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.core.dtypes import real, transform, vec4
from warpgrasp.core.kernel_launch import launch
from warpgrasp.finger.energy import largest_magnitude
from warpgrasp.geometry.body import scene_of
from warpgrasp.geometry.scene import Scene, body_is_convex
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.mechanism.utah_mit_hand import hand_links, hand_of
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.parameters import ContactTable
from warpgrasp.rubbing.balance import finger_balance
from warpgrasp.rubbing.friction_step import lagged_rest, next_rubbed, start_rubbed

FINGER = 1
SAME_RAD = 1e-4
"""Limits of friction lagged are found within a millinewton, which a soft joint shows."""
LEVEL_NM = 3e-5
WANTED_NM = 0.3
"""No threshold in use lets a joint bear more."""


@wp.kernel(enable_backward=False)
def _both_kernel(
    first: int, scene: Scene, hand: Hand, base: wp.array[transform], command: wp.array[vec4],
    q: wp.array2d[vec4], lagged: wp.array2d[vec4], level: wp.array2d[real],
    pressed: wp.array2d[int],
):
    i = wp.tid() + first
    samples = wp.where(body_is_convex(scene, 0), 0, LINK_SAMPLES)
    now = start_rubbed(hand, base[i], command[0])
    for s in range(1, command.shape[0]):
        was = now
        now = next_rubbed(scene, 0, hand, base[i], command[s], was, samples)
        by = lagged_rest(scene, 0, hand, base[i], command[s], was, now.grip, samples)
        at = finger_balance(scene, 0, hand, base[i], command[s], now.rest.q, now.rest, now.grip,
                            now.grip, 0, 0)
        q[i, s] = now.rest.q
        lagged[i, s] = by.rest.q
        level[i, s] = largest_magnitude(at.rest.gradient)
        pressed[i, s] = now.pressed


def both(name: str, path: str, friction: float, count: int = 16) -> dict[str, np.ndarray]:
    """Rests of a finger at every command of a path, from each rest to the next by both ways."""
    body = body_of(name)
    poses = poses_about(body, count, 6)
    commands = closing_commands(CLOSING_PATHS[path])[FINGER, ::2]
    points, _ = hand_links(HAND, poses, np.zeros((len(poses), 4, 4)))
    base = np.concatenate([points[:, FINGER, 0], poses[:, 3:]], 1)
    shape = len(poses), len(commands)
    out = {name: wp.zeros(shape, dtype=dtype, device="cpu") for name, dtype in (
        ("q", vec4), ("lagged", vec4), ("level", real), ("pressed", int))}
    launch(_both_kernel, {"row": len(poses)}, {
        "base": "row", "command": "step", **dict.fromkeys(out, "row step")}, {
        "scene": scene_of([body], "cpu"), "hand": hand_of(HAND, ContactTable(friction=friction)),
        "base": wp.array(base, dtype=transform, device="cpu"),
        "command": wp.array(commands, dtype=vec4, device="cpu"), **out}, device="cpu")
    return {name: values.numpy() for name, values in out.items()} | {"command": commands[None]}


@pytest.mark.parametrize("friction", [0.2, 1.0])
@pytest.mark.parametrize("name", [
    "block", pytest.param("capsule", marks=pytest.mark.slow),
    pytest.param("wine_bottle", marks=pytest.mark.slow)])
def test_both_ways_come_to_the_same_rest(name: str, friction: float) -> None:
    for path in ("curl40", "base_then_curl"):
        found = both(name, path, friction)
        torque = HAND.joint_stiffness_Nm_rad * np.abs(found["command"] - found["q"])
        pressed = (found["pressed"] == 1) & (torque[..., 1:].max(-1) < WANTED_NM)
        assert pressed.sum() > 60
        balanced = pressed & (found["level"] < LEVEL_NM)
        assert balanced.sum() > 0.93 * pressed.sum()
        apart = np.abs(found["q"] - found["lagged"]).max(-1)[balanced]
        assert np.median(apart) < 2e-5
        assert (apart < SAME_RAD).mean() > 0.93
