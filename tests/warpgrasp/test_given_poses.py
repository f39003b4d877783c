"""Verbs refuse poses that are no places and unit quaternions, of those that they are asked about.

Kernels take them at their word: an object or a hand would seem to stand elsewhere.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from strategies.poses.chain_paths import chain_commands
from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind
from warpgrasp.chain_closing.chain_closing import close_chains
from warpgrasp.chain_closing.chain_estimate import estimate_chain_contacts
from warpgrasp.chain_closing.chain_self_contact import chain_self_contacts
from warpgrasp.closing.closing import close_fingers
from warpgrasp.closing.contact_estimate import estimate_contacts
from warpgrasp.closing.self_contact import self_contacts
from warpgrasp.geometry.body import scene_of
from warpgrasp.mechanism.arm_motion import ArmState, move_hand
from warpgrasp.mechanism.calibration import no_errors
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable, PadTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.touch.guarded_motion import guarded_line
from warpgrasp.touch.line_touch import LineMove

SCENE = scene_of([body_from_name("block")], "cpu")
BODY, KEY = np.zeros(1, int), np.arange(2, dtype=np.uint64)
ARM, HAND, SENSORS, ERRORS = ArmTable(), HandTable(), SensorTable(), ErrorTable()
CURL = closing_commands(CLOSING_PATHS["curl40"])[None]
CHAIN = chain_of(hand_of_kind("allegro"))
CHAIN_CURL = chain_commands(CHAIN, "curl40")[None]
BODY_POSE = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
HAND_POSE = np.tile([0.45, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0], (2, 1, 1))
Verb = Callable[[np.ndarray, np.ndarray, np.ndarray], Any]
"""Of poses of objects (world 2, 7), of hands (world 2, probe 1, 7), and worlds asked, bool."""


def status(asked: np.ndarray) -> np.ndarray:
    return np.where(asked, ProbeStatus.CONTACT, ProbeStatus.NOT_TRIED)[:, None, None]


def utah_mit(body_pose: np.ndarray, hand_pose: np.ndarray, asked: np.ndarray):
    return close_fingers(SCENE, BODY, body_pose, HAND, SENSORS, KEY, status(asked), hand_pose,
                         CURL, np.array([CURL.shape[2]]))[0]


def allegro(body_pose: np.ndarray, hand_pose: np.ndarray, asked: np.ndarray):
    return close_chains(SCENE, BODY, body_pose, CHAIN, HAND, SENSORS, KEY, status(asked),
                        hand_pose, CHAIN_CURL, np.array([CHAIN_CURL.shape[2]]))[0]


def moved(body_pose: np.ndarray, hand_pose: np.ndarray, asked: np.ndarray):
    return move_hand(SCENE, BODY, body_pose, ARM, HAND, KEY, ArmState.home(2), hand_pose,
                     asked[:, None], CURL)[0]


def line(body_pose: np.ndarray, hand_pose: np.ndarray, asked: np.ndarray):
    rows = np.flatnonzero(asked)
    n = len(rows)
    move = LineMove(rows, np.zeros(n, int), hand_pose[rows, 0], np.tile([0.0, 0.0, -1.0], (n, 1)),
                    1e-3, 5, 0, CURL[0, :, :1])
    return guarded_line(SCENE, BODY, body_pose, ARM, HAND, SENSORS, PadTable(), KEY, no_errors(),
                        ArmState.home(2).q_rad[rows], move)


def felt(close: Verb, asked: np.ndarray):
    closing = close(BODY_POSE, HAND_POSE + [0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0], asked)
    assert ((closing.status == ProbeStatus.CONTACT).any((1, 2, 3)) == asked).all()
    return closing


OF_HANDS: dict[str, tuple[str, Verb]] = {
    "close_fingers": ("hand_pose", utah_mit), "close_chains": ("hand_pose", allegro),
    "move_hand": ("wanted_pose", moved), "guarded_line": ("hand_pose", line),
    "estimate_contacts": ("believed_pose", lambda _, pose, asked: estimate_contacts(
        felt(utah_mit, asked), pose, CURL, ARM, HAND, SENSORS)),
    "estimate_chain_contacts": ("believed_pose", lambda _, pose, asked: estimate_chain_contacts(
        felt(allegro, asked), pose, CHAIN_CURL, ARM, CHAIN, HAND, SENSORS)),
    "self_contacts": ("believed_pose", lambda _, pose, asked: self_contacts(
        felt(utah_mit, asked), pose, CURL, HAND, SENSORS, ERRORS)),
    "chain_self_contacts": ("believed_pose", lambda _, pose, asked: chain_self_contacts(
        felt(allegro, asked), pose, CHAIN_CURL, CHAIN, HAND, SENSORS, ERRORS)),
    "hand_links": ("hand_pose", lambda _, pose, asked: hand_links(
        HAND, pose[asked, 0], np.zeros((asked.sum(), 4, 4))))}
BOTH, FIRST = np.ones(2, bool), np.array([True, False])


@pytest.mark.parametrize("verb", OF_HANDS)
def test_poses_of_hands_have_unit_quaternions_where_they_are_asked_about(verb: str) -> None:
    name, ask = OF_HANDS[verb]
    for wrong in (1.01, 0.0):
        pose = HAND_POSE.copy()
        pose[1, 0, 3] = wrong
        with pytest.raises(ValueError, match=rf"^{name}: that of world 1 is .* of length 1"):
            ask(BODY_POSE, pose, BOTH)
    pose[1] = np.nan
    ask(BODY_POSE, pose, FIRST)


@pytest.mark.parametrize("verb", sorted({*OF_HANDS} - {"move_hand"}))
def test_poses_of_hands_are_finite_where_they_are_asked_about(verb: str) -> None:
    name, ask = OF_HANDS[verb]
    pose = HAND_POSE.copy()
    pose[1, 0, 2] = np.nan
    with pytest.raises(ValueError, match=rf"^{name}: that of world 1 is .* be finite"):
        ask(BODY_POSE, pose, BOTH)


def test_a_wanted_pose_that_is_not_finite_is_unreachable() -> None:
    pose = HAND_POSE.copy()
    pose[1] = np.nan
    found = moved(BODY_POSE, pose, BOTH).status[:, 0, 0]
    assert found.tolist() == [ProbeStatus.CONTACT, ProbeStatus.UNREACHABLE]


@pytest.mark.parametrize("ask", [utah_mit, allegro, moved, line])
@pytest.mark.parametrize("wrong", [np.nan, 1.01])
def test_poses_of_objects_are_places_and_unit_quaternions(ask: Verb, wrong: float) -> None:
    pose = BODY_POSE.copy()
    pose[1, 6] = wrong
    with pytest.raises(ValueError, match=r"^body_pose: that of world 1 is .* of length 1"):
        ask(pose, HAND_POSE, BOTH)
