"""Friction of fingers that are chains: rests hold by the cones, as the Utah-MIT hand's, alone."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from chain_closings import ALONE, TABLE, close, poses_above, utah_mit_twice
from reference_chain import ReferenceChain

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind, padded, true_chains
from warpgrasp.chain.chain_kernel import Chain, vec6
from warpgrasp.chain_closing.chain_path import no_chain_errors
from warpgrasp.core.dtypes import real, transform
from warpgrasp.core.kernel_launch import launch
from warpgrasp.finger.chain_energy import largest_magnitude
from warpgrasp.geometry.body import scene_of
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.rubbing.chain_balance import finger_balance, start_rubbed
from warpgrasp.rubbing.friction_step import lagged_rest, next_rubbed

UNHELD_NM = 1e-5
"""What stops a finger is 0.05."""
WANTED_NM = 0.3
"""No threshold in use lets a joint bear more."""
ROUGH = replace(ALONE, friction=0.5)


@wp.kernel(enable_backward=False)
def _both_kernel(
    first: int, scene: Scene, hands: wp.array2d[Chain], finger: int, base: wp.array[transform],
    command: wp.array[vec6], q: wp.array2d[vec6], lagged: wp.array2d[vec6],
    level: wp.array2d[real], pressed: wp.array2d[int],
):
    i = wp.tid() + first
    hand = hands[0, finger]
    now = start_rubbed(hand, base[i], command[0])
    for s in range(1, command.shape[0]):
        was = now
        now = next_rubbed(scene, 0, hand, base[i], command[s], was, LINK_SAMPLES)
        by = lagged_rest(scene, 0, hand, base[i], command[s], was, now.grip, LINK_SAMPLES)
        at = finger_balance(scene, 0, hand, base[i], command[s], now.rest.q, now.rest, now.grip,
                            now.grip, 0, 0)
        q[i, s] = now.rest.q
        lagged[i, s] = by.rest.q
        level[i, s] = largest_magnitude(at.rest.gradient)
        pressed[i, s] = now.pressed


@pytest.mark.parametrize("name", ["block", "wine_bottle"])
def test_both_ways_come_to_the_same_rest(name: str) -> None:
    """By Newton's method, and by passes with friction lagged."""
    hand, finger = chain_of(hand_of_kind("allegro")), 1
    commands = chain_commands(hand, "curl40")[finger, ::2]
    poses = poses_above(48)
    shape = len(poses), len(commands)
    out = {name: wp.zeros(shape, dtype=dtype, device="cpu") for name, dtype in (
        ("q", vec6), ("lagged", vec6), ("level", real), ("pressed", int))}
    launch(_both_kernel, {"row": len(poses)}, {
        "hands": "1 finger", "base": "row", "command": "step", **dict.fromkeys(out, "row step")}, {
        "scene": scene_of([body_from_name(name)], "cpu"), "finger": finger,
        "hands": true_chains(hand, TABLE, ROUGH, no_chain_errors(hand), "cpu"),
        "base": wp.array(poses, dtype=transform, device="cpu"),
        "command": wp.array(padded(commands), dtype=vec6, device="cpu"), **out}, device="cpu")
    found = {name: values.numpy() for name, values in out.items()}
    stiffness = hand.model.fingers[finger].joints[0].stiffness_Nm_rad
    torque = stiffness * np.abs(padded(commands) - found["q"]).max(-1)
    clear = found["pressed"][:, 1:2] == 0  # the open hand does not press
    pressed = clear & (found["pressed"] == 1) & (torque < WANTED_NM)
    assert pressed.sum() > 60
    balanced = pressed & (found["level"] < 3e-5)
    assert balanced.sum() > 0.93 * pressed.sum()
    apart = np.abs(found["q"] - found["lagged"]).max(-1)[balanced]
    assert np.median(apart) < 2e-5
    assert (apart < 1e-4).mean() > 0.93


@pytest.mark.parametrize("kind", [
    "barrett", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("allegro", "leap"))])
def test_a_rest_needs_no_force_outside_the_cone(kind: str) -> None:
    hand, rested = chain_of(hand_of_kind(kind)), 0
    poses = poses_above(16, seed=3)
    for name, path in (("block", "curl40"), ("large_cylinder", "base_then_curl")):
        commands = chain_commands(hand, path)
        felt, truth = close(hand, name, poses, commands, contact=ROUGH)
        for i, f in np.argwhere((truth.link[:, 0, 0] >= 0) & (felt.step[:, 0, 0] > 5))[:12]:
            drives = len(hand.drives[f])
            energy = ReferenceChain(body_from_name(name), hand, TABLE, matrix_of(tuple(poses[i])),
                                    int(f), ROUGH)
            q = truth.q_rad[i, 0, 0, f, :drives]
            command = commands[f, felt.step[i, 0, 0, f], :drives]
            assert np.abs(energy.unheld(q, command)).max() < UNHELD_NM
            rested += 1
    assert rested > 15


def test_friction_stops_fingers_elsewhere() -> None:
    """So that the other tests are not of fingers that never rub."""
    hand = chain_of(hand_of_kind("allegro"))
    commands = chain_commands(hand, "curl40")
    poses = poses_above(24)
    smooth = close(hand, "block", poses, commands)[0]
    rough = close(hand, "block", poses, commands, contact=ROUGH)[0]
    assert (smooth.step != rough.step).mean() > 0.2


@pytest.mark.parametrize("self_contact", [False, True])
def test_hardly_any_friction_is_none(self_contact: bool) -> None:
    hand = chain_of(hand_of_kind("allegro"))
    commands = chain_commands(hand, "curl40")
    poses = poses_above(60)
    contact = replace(ALONE, self_contact=self_contact)
    smooth, there = close(hand, "small_cylinder", poses, commands, contact=contact)
    rubbed, truth = close(hand, "small_cylinder", poses, commands,
                          contact=replace(contact, friction=1e-9))
    clear = smooth.step[:, 0, 0].min(1) > 5  # the open hand does not press
    assert truth.self_contact[clear].any() == self_contact
    same = (smooth.step == rubbed.step) & clear[:, None, None, None]
    assert same.sum() > 0.97 * 4 * clear.sum()
    apart = np.abs(there.q_rad - truth.q_rad)[same].max(-1)
    # Links that bear on the palm and on one another may rest in more than one way.
    assert (apart < 2e-6).mean() > (0.93 if self_contact else 0.999)


def test_the_utah_mit_hand_rubs_alike_as_a_chain() -> None:
    true, truth, both, same = utah_mit_twice(24, ROUGH)
    assert both.sum() > 20
    assert same.sum() > 0.95 * both.sum()
    assert (np.abs(truth.q_rad - true.q_rad)[same].max(-1) < 1e-5).mean() > 0.95
