"""Poses and closing paths of hands other than the Utah-MIT, in their own frame."""

from importlib.resources import files
from math import radians
from pathlib import Path

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
AS_CHAIN = HandTable(kind=str(files("warpgrasp.hands") / "data" / "utah_mit.toml"))
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
    assert outline.scale == outline.wide == 1.0
    assert outline.centre_m == (0.0, 0.0)
    for kind in HANDS:
        assert 0.9 < outline_of(HandTable(kind=kind)).scale < 1.2


def test_the_utah_mit_hand_opens_as_far_read_as_chains() -> None:
    by_table, by_chains = outline_of(HandTable()), outline_of(AS_CHAIN)
    assert by_chains.open_half_m == pytest.approx(by_table.open_half_m, abs=1e-9)
    assert by_chains.wide == pytest.approx(1.0, abs=1e-9)


def opened_by(degrees: float, folder: Path) -> HandTable:
    """The Utah-MIT hand as chains whose open fingers lean outwards by so much."""
    text = Path(AS_CHAIN.kind).read_text()
    assert text.count("_flexion1\" = -10.0") == 4
    file = folder / f"opened_{degrees:.0f}.toml"
    file.write_text(text.replace("_flexion1\" = -10.0", f"_flexion1\" = {-degrees}").replace(
        "limits_deg = [-10.0,", "limits_deg = [-45.0,"))
    return HandTable(kind=str(file))


def palm_away_m(hand: HandTable, radius_m: float) -> float:
    """How far the hand's origin stays from the axis of an upright prior, level before it."""
    prior = BoundingCylinder(np.array([0.45]), np.array([0.1]), np.array([radius_m]),
                             np.array([0.4]))
    level = Ring(count=1, tilt_rad=radians(90))
    pose = waypoint_poses((level,), prior, hand, np.zeros(1, np.uint64))[0, 0]
    return float(np.linalg.norm(pose[:2] - [0.45, 0.1]))


def test_hands_that_open_wider_come_nearer_to_what_is_wide(tmp_path: Path) -> None:
    usual, wider = opened_by(10.0, tmp_path), opened_by(30.0, tmp_path)
    table = HandTable()
    tip = table.palm_gap_m / 2 + sum(table.link_length_m) * np.sin(radians(30.0))
    opening = tip - table.link_radius_m
    assert outline_of(wider).open_half_m == pytest.approx(opening, abs=1e-9)
    ratio = opening / outline_of(table).open_half_m
    assert palm_away_m(wider, 0.015) == pytest.approx(palm_away_m(usual, 0.015), abs=1e-3)
    for radius in (0.05, 0.08):
        nearer = palm_away_m(usual, radius) - palm_away_m(wider, radius)
        assert nearer == pytest.approx(1.5 * radius * (1 - 1 / ratio), abs=1e-3)
    # One that hardly opens reaches nothing from farther off.
    narrow = opened_by(-10.0, tmp_path)
    assert palm_away_m(narrow, 0.05) == pytest.approx(palm_away_m(usual, 0.05), abs=1e-3)
