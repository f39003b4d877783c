"""Fingers that stay open: the others close as if their commands had been held."""

from dataclasses import replace

import numpy as np
import pytest
from chain_closings import ALONE, ON_TABLE, QUIET, TABLE, poses_above

from strategies.poses.chain_paths import chain_commands
from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from strategies.procedures.containment import explore_by_containment
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind
from warpgrasp.chain_closing.chain_closing import close_chains
from warpgrasp.closing.closing import close_fingers
from warpgrasp.core.kernel_launch import ShapeError
from warpgrasp.geometry.body import scene_of
from warpgrasp.motion_cost import was_made
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth

BODY = body_from_name("small_cylinder")
OPEN = 3, 1
"""The thumb and a finger beside others."""
TENDONS = SensorTable(tension_noise_N=0.0, tension_step_N=0.0, joint_noise_rad=0.0)


def both_ways(hand: str, contact: ContactTable, count: int = 24):
    """Closings with fingers `OPEN` left open, and with their commands held instead."""
    chain = None if hand == "utah_mit" else chain_of(hand_of_kind(hand))
    commands = (closing_commands(CLOSING_PATHS["curl40"]) if chain is None
                else chain_commands(chain, chain.model.closings[0].name))
    held = commands.copy()
    held[list(OPEN)] = held[list(OPEN), :1]
    poses = poses_above(count)
    closes = np.ones((1, 1, len(commands)), bool)
    closes[..., list(OPEN)] = False

    def close(path: np.ndarray, closes: np.ndarray | None):
        given = (np.tile(ON_TABLE, (count, 1)),)
        told = (np.arange(count, dtype=np.uint64), np.ones((count, 1, 1), int), poses[:, None],
                path[None], np.array([path.shape[1]]))
        scene, body = scene_of([BODY], "cpu"), np.zeros(1, int)
        if chain is None:
            return close_fingers(scene, body, *given, TABLE, TENDONS, *told, contact=contact,
                                 closes=closes)
        return close_chains(scene, body, *given, chain, TABLE, QUIET, *told, contact=contact,
                            closes=closes)

    others = [f for f in range(len(commands)) if f not in OPEN]
    return close(commands, closes), close(held, None), commands, others


@pytest.mark.parametrize("hand", ["utah_mit", "allegro"])
@pytest.mark.parametrize("contact", [
    ALONE, replace(ALONE, friction=0.5), ContactTable(friction=0.0), ContactTable()],
    ids=["alone", "rubbing", "meeting", "meeting and rubbing"])
def test_the_others_close_as_if_commands_were_held(hand: str, contact: ContactTable) -> None:
    (felt, truth), (held, true), commands, others = both_ways(hand, contact)
    assert (felt.status[..., others] == ProbeStatus.CONTACT).mean() > 0.2
    assert np.array_equal(felt.status[..., others], held.status[..., others])
    assert np.array_equal(felt.step[..., others], held.step[..., others])
    assert truth.q_rad[..., others, :] == pytest.approx(true.q_rad[..., others, :], abs=1e-5)
    idle = list(OPEN)
    assert (felt.status[..., idle] == ProbeStatus.NO_CONTACT).all()
    assert (felt.step[..., idle] == 0).all()
    off = np.abs(felt.q_rad[..., idle, :] - commands[idle, 0]).max(-1)
    free = off < 0.02  # elsewhere the open hand strikes the object
    assert free.mean() > 0.5
    assert truth.rest_rad[..., idle, :][free] == pytest.approx(
        true.rest_rad[..., idle, :][free], abs=1e-3)


def test_which_fingers_close_is_checked_for_its_shape() -> None:
    with pytest.raises(ShapeError, match="'closes' has shape"):
        close_fingers(
            scene_of([BODY], "cpu"), np.zeros(1, int), ON_TABLE[None], TABLE, TENDONS,
            np.zeros(1, np.uint64), np.ones((1, 1, 1), int), poses_above(1)[:, None],
            np.zeros((1, 4, 2, 4)), np.array([2]), closes=np.ones((1, 1, 3), bool))


def test_a_robot_counts_no_touch_of_fingers_that_stay_open() -> None:
    worlds, poses = 2, 3
    truth = Truth(np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (worlds, 1)))
    hand_pose = np.tile([0.45, 0.0, 0.19, 1, 0, 0, 0.0], (worlds, poses, 1))
    closes = np.ones((worlds, poses, 4), bool)
    closes[:, :, 3] = False
    closes[1, :, 1:] = False
    wanted = np.ones((worlds, poses), bool)

    def grasped(closes: np.ndarray | None, room: np.ndarray | None = None):
        robot = Robot([BODY], np.zeros(1, int), truth, np.arange(worlds, dtype=np.uint64),
                      ArmTable(), HandTable(), SensorTable(),
                      contact=replace(ContactTable(), self_contact=False))
        return explore_by_containment(robot, hand_pose, wanted, ("curl40",), room, closes)

    found, every = grasped(closes), grasped(None)
    made = was_made(found.closing.status)
    assert made.sum((1, 2, 3)).tolist() == [9, 3]
    assert (found.closing.status[~made] == ProbeStatus.NOT_TRIED).all()
    # Fingers draw from streams of their own: what one does changes nothing of the others.
    for name in ("q_rad", "step", "tension_N"):
        assert np.array_equal(getattr(found.closing, name)[made],
                              getattr(every.closing, name)[made], equal_nan=True), name
    assert (found.time_s <= every.time_s).all()
    short = grasped(closes, np.array([4, 2]))
    assert was_made(short.closing.status).sum((1, 2, 3)).tolist() == [6, 2]
