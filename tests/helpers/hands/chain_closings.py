"""Closings of hands of chains about a body on the table, each finger alone, without noise."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.chain.chain_hand import ChainHand, chain_of, hand_of_kind
from warpgrasp.chain_closing.chain_closing import close_chains
from warpgrasp.closing.closing import close_fingers
from warpgrasp.geometry.body import scene_of
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

TABLE = HandTable()
QUIET = SensorTable(torque_noise_Nm=0.0, torque_step_Nm=0.0, torque_friction_Nm=0.0,
                    joint_noise_rad=0.0)
ALONE = replace(ContactTable(), friction=0.0, self_contact=False)
ON_TABLE = np.array([0, 0, 0, 0, 0, 0, 1.0])


def poses_above(count: int, seed: int = 0) -> np.ndarray:
    """Hand poses from the upper side, some 0.1 m from a body's middle, (count, 7)."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        azimuth, roll = rng.uniform(-np.pi, np.pi, 2)
        turn = Rotation.from_euler("ZYZ", [azimuth, np.pi - rng.uniform(0, 1.2), roll])
        place = [0, 0, 0.06] - turn.apply([0, 0, 1.0]) * rng.uniform(0.08, 0.14)
        found.append([*place, *turn.as_quat()])
    return np.array(found)


def close(hand: ChainHand, name: str, poses: np.ndarray, commands: np.ndarray,
          sensors: SensorTable = QUIET, contact: ContactTable = ALONE):
    n = len(poses)
    return close_chains(
        scene_of([body_from_name(name)], "cpu"), np.zeros(1, int), np.tile(ON_TABLE, (n, 1)), hand,
        TABLE, sensors, np.arange(n, dtype=np.uint64), np.ones((n, 1, 1), int), poses[:, None],
        commands[None], np.array([commands.shape[1]]), contact=contact)


def utah_mit_twice(count: int, contact: ContactTable):
    """Closings of the Utah-MIT hand about a small cylinder by its own kernels and as a chain: both
    truths, and which fingers stopped at the same step, of those that both stop."""
    hand = chain_of(hand_of_kind("utah_mit"))
    commands = closing_commands(CLOSING_PATHS["curl40"])
    poses = poses_above(count)
    # The same thresholds: tendons have a moment arm each, and here all joints are guarded.
    table = replace(TABLE, moment_arm_m=(0.01,) * 4, tendon_friction=0.0)
    tendons = SensorTable(tendon_threshold_N=5.0, tension_noise_N=0.0, tension_step_N=0.0,
                          joint_noise_rad=0.0)
    contact = replace(contact, weight=False)
    theirs, true = close_fingers(
        scene_of([body_from_name("small_cylinder")], "cpu"), np.zeros(1, int),
        np.tile(ON_TABLE, (count, 1)), table, tendons, np.arange(count, dtype=np.uint64),
        np.ones((count, 1, 1), int), poses[:, None], commands[None],
        np.array([commands.shape[1]]), contact=contact)
    ours, truth = close(hand, "small_cylinder", poses, commands,
                        replace(QUIET, torque_threshold_Nm=0.05), contact)
    one, two = (felt.status == ProbeStatus.CONTACT for felt in (theirs, ours))
    # A finger may stop by its abduction, which tendons do not guard.
    both = one & two & (np.abs(truth.torque_Nm[..., 0]) < 0.05)
    assert not (one & ~two).any()
    return true, truth, both, both & (ours.step == theirs.step)
