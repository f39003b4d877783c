"""A free finger is followed to the very step at which it touches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from strategies.poses.hand_poses import waypoint_poses
from strategies.ready_made import STRATEGIES
from sweeps.episode.given_prior import draw_prior
from warpgrasp.core.dtypes import real, transform, vec3
from warpgrasp.core.kernel_launch import launch
from warpgrasp.core.random import counter_key
from warpgrasp.finger.free_motion import advance_free, start_free
from warpgrasp.finger.path_record import LinkStep, PathStep
from warpgrasp.finger.path_table import path_on_device
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.geometry.scene import Scene, body_is_convex
from warpgrasp.mechanism.calibration import draw_calibration, true_hands
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ContactTable, ErrorTable, HandTable, ObjectTable

HAND, FREE = HandTable(), ContactTable.none()
FINGER = 1
ON_TABLE = np.array([[0, 0, 0, 0, 0, 0, 1.0]])


ASTRAY = replace(ErrorTable.none(), joint_offset_rad=0.03, link_length_share=0.08)
"""Errors so large that bounds which leave them out are no bounds."""


@wp.kernel(enable_backward=False)
def _free_kernel(
    first: int, scene: Scene, hand: wp.array[Hand], base: wp.array[transform],
    path: wp.array3d[PathStep], links: wp.array4d[LinkStep], end: int, out: wp.array[int],
    left: wp.array[vec3],
):
    i = wp.tid() + first
    own = hand[i % hand.shape[0]]
    convex = body_is_convex(scene, 0)
    begin = start_free(scene, 0, convex, own, base[i], links[0, FINGER, 1, 0].end)
    free = advance_free(
        scene, 0, convex, own, base[i], path, links, 0, FINGER, real(1.0), begin, end)
    out[i] = free.step
    left[i] = free.room


def followed(body: Body, hands: np.ndarray, commands: np.ndarray, errors: ErrorTable
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of one finger of hands (row, 7), on commands (4, step, 4): the step to which it is free
    (row,), how far its links, sampled, are from body and table at each (row, step, link) [m], by
    forward kinematics with the true links' lengths and joints' zeros, how far it may stray [m]
    (row,), and how far each link may still move freely [m] (row, link).
    """
    drawn = draw_calibration(errors, counter_key(6, np.arange(4)))
    hands = np.repeat(hands, drawn.worlds, axis=0)
    steps, n = commands.shape[1], len(hands)
    scene = scene_of([body], "cpu")
    path, links = path_on_device(HAND, FREE, drawn, commands[None], "cpu")
    points, _ = hand_links(HAND, hands, np.tile(commands[:, 0], (n, 1, 1)))
    base = np.concatenate([points[:, FINGER, 0], hands[:, 3:]], 1)
    out, left = (wp.zeros(n, dtype=kind, device="cpu") for kind in (int, vec3))
    own = true_hands(HAND, FREE, drawn, "cpu").numpy()[:, FINGER]
    launch(_free_kernel, {"row": n}, {
        "hand": "world", "base": "row", "path": "1 4 step", "links": "1 4 3 step", "out": "row",
        "left": "row"}, {
        "scene": scene, "hand": wp.array(own, dtype=Hand, device="cpu"), "path": path,
        "end": steps, "links": links, "out": out, "left": left,
        "base": wp.array(base, dtype=transform, device="cpu")}, device="cpu")

    share = np.linspace(0, 1, 23)[:, None]
    room = np.empty((n, steps, 3))
    for world in range(drawn.worlds):
        mine = slice(world, None, drawn.worlds)
        true = replace(HAND, link_length_m=tuple(
            np.array(HAND.link_length_m) * (1 + drawn.link_length_share[world, FINGER])))
        q = commands - drawn.joint_offset_rad[world, :, None]
        places, _ = hand_links(true, np.tile(ON_TABLE, (steps, 1)), q.swapaxes(0, 1))
        ends = places[:, FINGER, 1:] - places[:, FINGER, :1]
        along = ends[:, :3, None] + share * (ends[:, 1:] - ends[:, :3])[:, :, None]
        turn = Rotation.from_quat(hands[mine, 3:]).as_matrix()
        at = np.einsum("nab,slkb->nslka", turn, along).reshape(len(turn), -1, 3)
        at += base[mine, None, :3]
        distance = np.minimum(distance_to_bodies(scene, np.zeros(1, int), at)[0], at[..., 2])
        room[mine] = distance.reshape(len(turn), steps, 3, -1).min(-1) - HAND.link_radius_m
    return out.numpy(), room, np.resize(own["sag"].max(-1), n), left.numpy()


def check(out: np.ndarray, rooms: np.ndarray, stray: np.ndarray, left: np.ndarray) -> None:
    touched, room = 0, rooms.min(-1)
    for row, step in enumerate(out):
        assert (room[row, :step] > -2e-4).all()  # a link's nearest place lies between samples
        if step < room.shape[1]:
            touched += 1
            # A finger that may not stand where it is computed counts as touching a little before.
            assert room[row, step] < 2e-4 + 0.02 * stray[row]
            assert (left[row] < rooms[row, step] + 2e-4).all()
    assert touched > len(out) // 2


@pytest.mark.parametrize("errors", [ErrorTable.none(), ASTRAY], ids=["exact", "astray"])
@pytest.mark.parametrize("name", [
    pytest.param("block", marks=pytest.mark.slow), "small_cylinder", "lightbulb"])
def test_the_first_touch_against_links_sampled_at_every_step(name: str, errors: ErrorTable
                                                             ) -> None:
    body, key = body_from_name(name), counter_key(5, np.arange(1))
    hands = waypoint_poses(STRATEGIES["rim6-ring12"].waypoints,
                           draw_prior(body, ON_TABLE, ObjectTable(), key), HAND, key)[0]
    check(*followed(body, hands, closing_commands(CLOSING_PATHS["base_then_curl"]), errors))


@pytest.mark.parametrize("parts", [1, 2], ids=["convex", "two parts"])
def test_a_finger_that_swings_straight_at_a_wall_is_followed_to_it(parts: int) -> None:
    """With large errors: all that its links move brings them nearer to the wall."""
    half = {"shape": "block", "size_mm": [20, 200, 300]}
    body = body_from_table({"name": "wall", "compound": [half] * parts}, Path())
    commands = np.zeros((4, 350, 4))
    commands[..., 1] = np.radians(np.linspace(-10.0, 60.0, 350))
    away = np.linspace(0.02, 0.06, 12)
    hands = np.array([[HAND.palm_gap_m / 2 - 0.01 - x, 0.0, 0.25, 1.0, 0.0, 0.0, 0.0]
                      for x in away])
    check(*followed(body, hands, commands, ASTRAY))
