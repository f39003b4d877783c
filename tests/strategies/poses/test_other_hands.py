"""Poses and closing paths of hands other than the Utah-MIT, in their own frame."""

from math import radians

import numpy as np
import pytest

from strategies.poses.chain_paths import chain_commands, chain_path_names
from strategies.poses.hand_outline import outline_of
from strategies.poses.hand_poses import TABLE_CLEARANCE_M, waypoint_poses
from strategies.poses.waypoints import BoundingCylinder, Ring, Top
from strategies.procedures.containment import padded_commands
from warpgrasp.chain.chain_hand import capsule_ends, chain_of, hand_of_kind, tip_places
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.parameters import HandTable

HANDS = ("allegro", "leap", "barrett")
PRIOR = BoundingCylinder(np.array([0.45]), np.array([0.1]), np.array([0.03]), np.array([0.1]))


@pytest.mark.parametrize("kind", HANDS)
def test_paths_go_in_small_steps_from_open_to_closed_within_the_limits(kind: str) -> None:
    hand = chain_of(hand_of_kind(kind))
    for name in chain_path_names(hand):
        commands = chain_commands(hand, name)
        assert np.abs(np.diff(commands, axis=1)).max() <= radians(0.5) + 1e-12
        for f, finger in enumerate(hand.model.fingers):
            for d, j in enumerate(hand.drives[f]):
                low, high = finger.joints[j].low_rad, finger.joints[j].high_rad
                assert commands[f, :, d].min() >= low - 1e-9
                assert commands[f, :, d].max() <= high + 1e-9
        assert commands[:, 0] == pytest.approx(chain_commands(hand, "together")[:, 0])
    whole = chain_commands(hand, "together")
    assert chain_commands(hand, "base_then_curl")[:, -1] == pytest.approx(whole[:, -1])
    with pytest.raises(KeyError):
        chain_commands(hand, "curl25_spread")


@pytest.mark.parametrize("kind", HANDS)
def test_fingers_of_a_ring_meet_about_the_prior(kind: str) -> None:
    table = HandTable(kind=kind)
    hand = chain_of(hand_of_kind(kind))
    poses = waypoint_poses((Ring(count=4), Top(count=2)), PRIOR, table, np.zeros(1, np.uint64))[0]
    commands, count = padded_commands(("together",), table)
    tips = tip_places(hand, np.moveaxis(commands[0, :, :count[0]], 0, 1))  # (step, finger, 3)
    for pose in poses:
        at = matrix_of(tuple(pose))
        world = tips @ at[:3, :3].T + at[:3, 3]
        across = np.linalg.norm(world[..., :2] - [0.45, 0.1], axis=-1)
        thumb = [f.name for f in hand.model.fingers].index(hand.model.thumb)
        nearest = across.min(0)
        assert nearest[thumb] < 0.035  # it and a finger pass near the axis
        assert np.delete(nearest, thumb).min() < 0.035
        assert world[0, :, 2].min() > 0.0


@pytest.mark.parametrize("kind", HANDS)
def test_the_open_hand_clears_the_table(kind: str) -> None:
    table = HandTable(kind=kind)
    hand = chain_of(hand_of_kind(kind))
    low = Ring(count=5, tilt_rad=radians(85), aim=0.0)
    poses = waypoint_poses((low,), PRIOR, table, np.zeros(1, np.uint64))[0]
    opened = padded_commands(("curl40",), table)[0][0, :, 0]
    lowest = []
    for pose in poses:
        at = matrix_of(tuple(pose))
        for f in range(hand.fingers):
            ends = capsule_ends(hand, f, opened[f]) @ at[:3, :3].T + at[:3, 3]
            radius = np.array([c.radius for c in hand.capsules[f]])
            lowest.append((ends[..., 2].min(1) - radius).min())
    assert min(lowest) == pytest.approx(TABLE_CLEARANCE_M, abs=1e-9)


def test_the_utah_mit_hand_keeps_its_distances() -> None:
    outline = outline_of(HandTable())
    assert outline.scale == 1.0
    assert outline.centre_m == (0.0, 0.0)
    for kind in HANDS:
        assert 0.9 < outline_of(HandTable(kind=kind)).scale < 1.2
