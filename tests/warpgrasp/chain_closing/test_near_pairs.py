"""What is left out where fingers meet changes nothing: pairs not looked at, capsules not placed."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from chain_closings import ALONE, TABLE

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind, padded, true_chains
from warpgrasp.chain.chain_kernel import CAPSULES, Chain, ChainPose, vec6
from warpgrasp.chain_closing.chain_meeting import CLOSE_M, pairs_on_device, palm_of
from warpgrasp.chain_closing.chain_path import no_chain_errors
from warpgrasp.core.dtypes import ZERO, real, transform, vec3, vec4
from warpgrasp.core.kernel_launch import launch
from warpgrasp.core.struct_array import Records
from warpgrasp.finger.chain_energy import ChainRest, free_chain
from warpgrasp.geometry.body import scene_of
from warpgrasp.geometry.scene import Scene
from warpgrasp.hand_rest.chain_meetings import (
    CapsulePair,
    ChainBuild,
    ChainMeeting,
    find_meetings,
    hand_angles,
    near_pairs,
)
from warpgrasp.hand_rest.far_balance import far_balance
from warpgrasp.hands.hand_guesses import with_guesses
from warpgrasp.hands.hand_model import STILL, Capsule, Finger, HandJoint, HandModel
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.rubbing.chain_balance import ChainGrip, finger_balance, start_grip

TRIES = 5
"""Hands in the midst of a step that are looked at before the hand goes on."""
TOUCHING = replace(ALONE, friction=0.5, weight=True)


@wp.kernel(enable_backward=False)
def _meetings_kernel(
    first: int, hands: wp.array2d[Chain], palm: wp.array2d[vec3], palm_balls: wp.array[vec4],
    pairs: wp.array[CapsulePair], order: wp.array3d[int], slack: wp.array3d[real],
    q: wp.array3d[vec6], anew: int, listed: wp.array2d[int], come: wp.array2d[real],
    come_to: wp.array2d[vec6], due: wp.array2d[real], poses: wp.array2d[ChainPose],
    posed: wp.array2d[vec6], ends: wp.array3d[vec3], balls: wp.array2d[vec4],
    meetings: wp.array2d[ChainMeeting], count: wp.array2d[int], depth: wp.array3d[real],
    pushed: wp.array3d[vec6],
):
    i = wp.tid() + first
    build = ChainBuild()
    build.palm = palm
    build.palm_balls = palm_balls
    build.pairs = pairs
    build.order = order
    build.slack = slack
    build.listed = listed
    build.come = come
    build.come_to = come_to
    build.due = due
    build.poses = poses
    build.posed = posed
    build.ends = ends
    build.balls = balls
    now = hand_angles()
    for s in range(q.shape[1]):
        for f in range(hands.shape[1]):
            now[f] = q[i, s, f]
        if anew == 1 or s == 0:
            build = near_pairs(hands, 0, build, now, now, hand_angles(), i, 1)
        elif s % TRIES == 0:
            build = near_pairs(hands, 0, build, now, now, hand_angles(), i, 0)
        count[i, s] = find_meetings(hands, 0, build, now, meetings, i)
        for a in range(count[i, s]):
            depth[i, s, a] = meetings[i, a].depth
            pushed[i, s, a] = meetings[i, a].by_one


@pytest.mark.parametrize("kind", ["allegro", "leap"])
def test_no_meeting_is_missed_that_looking_at_all_pairs_finds(kind: str) -> None:
    """Fingers that close together, and stray to and fro as the search for a rest does."""
    hand = chain_of(hand_of_kind(kind))
    way = chain_commands(hand, "together")  # (finger, step, width)
    rng = np.random.default_rng(0)
    rows, steps = 3, way.shape[1] // 2
    at = np.repeat(np.arange(steps) * 2, TRIES)
    stray = rng.normal(scale=0.01, size=(rows, steps * TRIES, hand.fingers, way.shape[2]))
    q = padded(np.moveaxis(way[:, at], 0, 1)[None] + stray)
    palm, palm_balls, pairs = pairs_on_device(hand, CLOSE_M, "cpu")
    n = pairs.shape[0]
    found = []
    for anew in (0, 1):
        shape, own = (rows, steps * TRIES), hand.fingers
        meetings, poses = Records(ChainMeeting, (rows, 8), "cpu"), Records(
            ChainPose, (rows, own), "cpu")
        given = {
            "palm": palm, "palm_balls": palm_balls, "pairs": pairs, "anew": anew,
            "hands": true_chains(hand, TABLE, TOUCHING, no_chain_errors(hand), "cpu"),
            "order": wp.array(np.arange(n)[None, None], dtype=int, device="cpu"),
            "slack": wp.zeros((1, 1, n), dtype=real, device="cpu"),
            "q": wp.array(q, dtype=vec6, device="cpu"),
            "meetings": meetings.array, "poses": poses.array,
            **{name: wp.zeros(size, dtype=dtype, device="cpu") for name, dtype, size in (
                ("listed", int, (rows, n)), ("come", real, (rows, own)),
                ("posed", vec6, (rows, own)), ("come_to", vec6, (rows, own)),
                ("due", real, (rows, n)), ("ends", vec3, (rows, own * CAPSULES, 2)),
                ("balls", vec4, (rows, own * CAPSULES)), ("count", int, shape),
                ("depth", real, (*shape, 8)), ("pushed", vec6, (*shape, 8)))}}
        launch(_meetings_kernel, {"row": rows}, {
            "hands": "1 finger", "palm": "bar 2", "palm_balls": "bar", "pairs": "pair",
            "order": "1 1 pair", "slack": "1 1 pair", "q": "row step finger", "listed": "row pair",
            "come": "row finger", "come_to": "row finger", "due": "row pair", "poses": "row finger",
            "posed": "row finger", "ends": "row every 2", "balls": "row every",
            "meetings": "row 8", "count": "row step", "depth": "row step 8",
            "pushed": "row step 8"}, given, device="cpu")
        found.append([given[name].numpy() for name in ("count", "depth", "pushed")])
    assert (found[1][0] > 0).sum() > 50
    assert (found[1][1] > 0.0).any()
    for listed, all_pairs in zip(*found, strict=True):
        np.testing.assert_array_equal(listed, all_pairs)


@wp.kernel(enable_backward=False)
def _balances_kernel(
    first: int, scene: Scene, hands: wp.array2d[Chain], base: wp.array[transform],
    q: wp.array[vec6], begun: wp.array[vec6], command: wp.array[vec6], state: wp.array2d[ChainRest],
    grips: wp.array2d[ChainGrip], poses: wp.array2d[ChainPose], posed: wp.array2d[vec6],
    far: wp.array[int], torque: wp.array2d[vec6], depth: wp.array2d[real],
):
    i = wp.tid() + first
    hand = hands[0, 1]
    build = ChainBuild()
    build.poses = poses
    build.posed = posed
    build.up = wp.quat_rotate_inv(wp.transform_get_rotation(base[i]), vec3(ZERO, ZERO, real(1.0)))
    grip = start_grip(begun[i])
    before = finger_balance(scene, 0, hand, base[i], command[i], begun[i], free_chain(begun[i]),
                            grip, grip, 5, 1)
    state[i, 0] = before.rest
    grips[i, 0] = before.grip
    at = finger_balance(scene, 0, hand, base[i], command[i], q[i], before.rest, grip, before.grip,
                        0, 0)
    far[i] = int(far_balance(hand, base[i], build, 0, command[i], q[i], state, i, 1, 0, grips, 0))
    torque[i, 0] = at.rest.gradient
    torque[i, 1] = state[i, 1].gradient
    for c in range(hand.capsule_count):
        depth[i, 0] = wp.max(depth[i, 0], wp.max(at.rest.depth[c], at.rest.table[c]))
        if far[i] == 1 and (state[i, 1].depth[c] < at.rest.depth[c] - real(1e-12)
                            or state[i, 1].table[c] < at.rest.table[c] - real(1e-12)):
            depth[i, 1] = real(1.0)


def test_a_finger_that_is_told_to_be_far_is_balanced_as_one_that_is_looked_at() -> None:
    hand = chain_of(hand_of_kind("allegro"))
    rng = np.random.default_rng(1)
    rows = 400
    turns = rng.normal(size=(rows, 4))
    places = np.column_stack([rng.uniform(-0.15, 0.15, (rows, 2)), rng.uniform(0.02, 0.3, rows)])
    poses = np.column_stack([places, turns / np.linalg.norm(turns, axis=1, keepdims=True)])
    begun = padded(rng.uniform(0.0, 1.2, (rows, 4)))
    q = begun + padded(rng.normal(scale=0.02, size=(rows, 4)))
    command = q + padded(rng.normal(scale=0.05, size=(rows, 4)))
    kept = [Records(kind, (rows, n), "cpu") for kind, n in (
        (ChainRest, 2), (ChainGrip, 1), (ChainPose, 1))]
    out = {name: wp.zeros(size, dtype=dtype, device="cpu") for name, dtype, size in (
        ("posed", vec6, (rows, 1)), ("far", int, rows), ("torque", vec6, (rows, 2)),
        ("depth", real, (rows, 2)))}
    launch(_balances_kernel, {"row": rows}, {
        "hands": "1 finger", "base": "row", "q": "row", "begun": "row", "command": "row",
        "state": "row 2", "grips": "row 1", "poses": "row 1", "posed": "row 1", "far": "row",
        "torque": "row 2", "depth": "row 2"}, {
        "scene": scene_of([body_from_name("block")], "cpu"),
        "hands": true_chains(hand, TABLE, TOUCHING, no_chain_errors(hand), "cpu"),
        "base": wp.array(poses, dtype=transform, device="cpu"),
        **{name: wp.array(values, dtype=vec6, device="cpu") for name, values in (
            ("q", q), ("begun", begun), ("command", command))},
        **dict(zip(("state", "grips", "poses"), (k.array for k in kept), strict=True)), **out},
        device="cpu")
    found = {name: values.numpy() for name, values in out.items()}
    far = found["far"] == 1
    assert 50 < far.sum() < rows - 50
    assert (found["depth"][far, 0] <= 0.0).all()
    assert (found["depth"][:, 1] == 0.0).all()  # bounds
    np.testing.assert_allclose(found["torque"][far, 1], found["torque"][far, 0], atol=1e-12)
    np.testing.assert_array_equal(found["posed"][far, 0], q[far])


def beside_hand(apart_m: float) -> HandModel:
    """Two fingers side by side, and a thumb across from them; links of a radius of 8 mm."""
    def finger(name: str, x: float, y: float, turn: float) -> Finger:
        base = (x, y, 0.0, 0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2))
        skin = (Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.04), 0.008),)
        return Finger(name, tuple(
            HandJoint(f"{name}{n}", place, (0.0, 1.0, 0.0), -0.1, 1.2, 0.0, 2.0, None, skin)
            for n, place in enumerate((base, (0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 1.0)))),
            (0.0, 0.0, 0.04), ())

    return with_guesses(HandModel("x", "", "", STILL, (), (
        finger("a", -0.05, 0.0, 0.0), finger("b", -0.05, apart_m, 0.0),
        finger("thumb", 0.05, apart_m / 2, np.pi)), "", "nothing", (), ()))


def test_links_of_fingers_that_go_side_by_side_are_no_pairs() -> None:
    """They are 5 mm apart all along; those of the thumb come towards them."""
    for apart, beside in ((0.021, True), (0.03, False)):
        barred = palm_of(chain_of(beside_hand(apart)))[2][:, :3 * CAPSULES]
        pairs = barred.reshape(3, CAPSULES, 3, CAPSULES)[:, :2, :, :2]
        assert pairs[0, :, 1].all() == pairs[0, :, 1].any() == beside
        assert not pairs[:2, :, 2].any()
