"""A free finger is followed to the very step at which it touches."""

import numpy as np
import pytest
import warp as wp

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from strategies.poses.hand_poses import waypoint_poses
from strategies.ready_made import STRATEGIES
from sweeps.episode.given_prior import draw_prior
from warpgrasp.core.dtypes import real, transform
from warpgrasp.core.kernel_launch import launch
from warpgrasp.core.random import counter_key
from warpgrasp.finger.free_motion import advance_free, start_free
from warpgrasp.finger.path_record import LinkStep, PathStep
from warpgrasp.finger.path_table import path_on_device
from warpgrasp.geometry.body import distance_to_bodies, scene_of
from warpgrasp.geometry.scene import Scene, body_is_convex
from warpgrasp.mechanism.calibration import no_errors
from warpgrasp.mechanism.utah_mit_hand import hand_links, hand_of
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ContactTable, HandTable, ObjectTable

HAND, FREE = HandTable(), ContactTable.none()
FINGER = 1
ON_TABLE = np.array([[0, 0, 0, 0, 0, 0, 1.0]])


@wp.kernel(enable_backward=False)
def _free_kernel(
    first: int, scene: Scene, hand: Hand, base: wp.array[transform], path: wp.array3d[PathStep],
    links: wp.array4d[LinkStep], end: int, out: wp.array[int],
):
    i = wp.tid() + first
    convex = body_is_convex(scene, 0)
    begin = start_free(scene, 0, convex, hand, base[i], links[0, FINGER, 1, 0].end)
    out[i] = advance_free(
        scene, 0, convex, hand, base[i], path, links, 0, FINGER, real(1.0), begin, end).step


@pytest.mark.parametrize("name", [
    pytest.param("block", marks=pytest.mark.slow), "small_cylinder", "lightbulb"])
def test_the_first_touch_against_links_sampled_at_every_step(name: str) -> None:
    body, key = body_from_name(name), counter_key(5, np.arange(1))
    hands = waypoint_poses(STRATEGIES["rim6-ring12"].waypoints,
                           draw_prior(body, ON_TABLE, ObjectTable(), key), HAND, key)[0]
    commands = closing_commands(CLOSING_PATHS["base_then_curl"])[None]
    steps, n = commands.shape[2], len(hands)
    scene = scene_of([body], "cpu")
    path, links = path_on_device(HAND, FREE, no_errors(), commands, "cpu")
    points, _ = hand_links(HAND, hands, np.tile(commands[0, :, 0], (n, 1, 1)))
    base = np.concatenate([points[:, FINGER, 0], hands[:, 3:]], 1)
    out = wp.zeros(n, dtype=int, device="cpu")
    launch(_free_kernel, {"row": n}, {
        "base": "row", "path": "1 4 step", "links": "1 4 3 step", "out": "row"}, {
        "scene": scene, "hand": hand_of(HAND, FREE), "path": path, "end": steps, "links": links,
        "out": out,
        "base": wp.array(base, dtype=transform, device="cpu")}, device="cpu")

    row = links.numpy()[0, FINGER]
    share = np.linspace(0, 1, 23)[:, None]
    along = row["start"][..., None, :] + (row["end"] - row["start"])[..., None, :] * share
    x, y, z, w = hands[:, 3:].T
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    at = np.einsum("abn,lskb->nslka", turn, along).reshape(n, -1, 3) + base[:, None, :3]
    distance = np.minimum(distance_to_bodies(scene, np.zeros(1, int), at)[0], at[..., 2])
    room = distance.reshape(n, steps, -1).min(-1) - HAND.link_radius_m
    touched = 0
    for k, step in enumerate(out.numpy()):
        assert (room[k, :step] > -2e-4).all()  # a link's nearest place lies between samples
        if step < steps:
            touched += 1
            assert room[k, step] < 2e-4
    assert touched > n // 2
