"""Closings about a body that stands at the origin, from hand poses drawn around it."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.closing.closing import close_fingers
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

HAND = HandTable()
ALONE = ContactTable(self_contact=False, friction=0.0)
"""A finger whose rest does not depend on the way there."""


def body_of(name: str) -> Body:
    """A catalogue object, or one of two round ones."""
    if name == "ball":
        return body_from_table({"name": name, "compound": [
            {"shape": "sphere", "radius_mm": 35}]}, Path())
    if name == "capsule":
        return body_from_table({"name": name, "compound": [
            {"shape": "capsule", "radius_mm": 25, "height_mm": 110}]}, Path())
    return body_from_name(name)


def close(body: Body, poses: np.ndarray, path: str, threshold: float, noise: float = 0.0,
          contact: ContactTable | None = None):
    """Close along a path at poses (world, 7) about a body at the origin."""
    n = len(poses)
    sensors = SensorTable(tendon_threshold_N=threshold, tension_noise_N=noise,
                          tension_step_N=0.0, joint_noise_rad=0.0)
    commands = closing_commands(CLOSING_PATHS[path])
    felt, truth = close_fingers(
        scene_of([body], "cpu"), np.zeros(1, int), np.tile([0, 0, 0, 0, 0, 0, 1.0], (n, 1)), HAND,
        sensors, np.arange(n, dtype=np.uint64), np.full((n, 1, 1), int(ProbeStatus.CONTACT)),
        poses[:, None], commands[None], np.array([commands.shape[1]]), contact=contact or ALONE)
    return felt, truth, commands


def poses_about(body: Body, count: int, seed: int) -> np.ndarray:
    """Hand poses around a body from which the open hand clears it and the table."""
    rng = np.random.default_rng(seed)
    low, high = np.asarray(body.low_m), np.asarray(body.high_m)
    turn = Rotation.from_euler("ZYZ", np.stack([
        rng.uniform(-np.pi, np.pi, 400), np.pi - rng.uniform(0.0, 1.4, 400),
        rng.uniform(-np.pi, np.pi, 400)], 1))
    aim = low + (high - low) * rng.uniform([0.3, 0.3, 0.1], [0.7, 0.7, 1.0], (400, 3))
    back = turn.apply([0.0, 0.0, 1.0]) * rng.uniform(0.03, 0.12, (400, 1))
    poses = np.concatenate([aim - back, turn.as_quat()], 1)
    opened = np.zeros((400, 4, 4))
    opened[..., 1] = np.radians(-10.0)
    joints = hand_links(HAND, poses, opened)[0]
    share = np.linspace(0.0, 1.0, 9)[:, None]
    links = joints[:, :, 1:-1, None] + share * (joints[:, :, 2:] - joints[:, :, 1:-1])[..., None, :]
    points = links.reshape(1, -1, 3)
    gap, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points)
    gap = np.minimum(gap, points[..., 2]).reshape(400, -1).min(1)
    return poses[gap > HAND.link_radius_m + 5e-4][:count]
