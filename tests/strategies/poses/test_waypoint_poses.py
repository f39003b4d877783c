"""Waypoints: hands look at the object, keep off the table, and files are checked line by line."""

from dataclasses import fields
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fit.arrays import rows_of
from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from strategies.poses.hand_poses import (
    CSV_COLUMNS,
    TABLE_CLEARANCE_M,
    poses_from_csv,
    waypoint_poses,
)
from strategies.poses.waypoints import (
    BoundingBox,
    BoundingCylinder,
    Column,
    Csv,
    Hemisphere,
    Opposing,
    Random,
    Ring,
    Spiral,
    Top,
    WaypointError,
)
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import HandTable

HAND = HandTable()


def prior(radius: float = 0.03, height: float = 0.12) -> BoundingCylinder:
    return BoundingCylinder(*(np.array([v]) for v in (0.45, 0.02, radius, height)))


def axis(poses: np.ndarray, which: int) -> np.ndarray:
    return Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix()[:, :, which]


families = st.one_of(
    st.builds(Ring, count=st.integers(1, 9), tilt_rad=st.floats(0.0, 1.2),
              roll_rad=st.floats(-3, 3), aim=st.floats(0, 1), aim_out=st.floats(0, 1)),
    st.builds(Column, count=st.integers(1, 9), levels=st.integers(1, 4)),
    st.builds(Opposing, count=st.integers(1, 8)), st.builds(Top, count=st.integers(1, 4)),
    st.builds(Random, count=st.integers(1, 8)), st.builds(Spiral, count=st.integers(1, 8)),
    st.builds(Hemisphere, count=st.integers(1, 8)))


@settings(max_examples=60)
@given(families, st.floats(0.01, 0.06), st.floats(0.03, 0.35))
def test_hands_look_down_and_open_fingers_keep_off_the_table(family, radius, height) -> None:
    poses = waypoint_poses((family,), prior(radius, height), HAND, np.zeros(1, np.uint64))
    assert poses.shape == (1, family.count, 7)
    assert np.allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1.0)
    assert (axis(poses, 2)[:, 2] < 0).all()
    q = np.zeros((family.count, 4, 4))
    q[..., 1] = HAND.flexion_low_rad[0]
    points, _ = hand_links(HAND, poses[0], q)
    assert points[..., 2].min() - HAND.link_radius_m >= TABLE_CLEARANCE_M - 1e-9


def test_a_ring_stands_around_at_its_tilt_and_clearance() -> None:
    ring = Ring(count=4, tilt_rad=radians(80), palm_clearance_m=0.1, clearance_per_radius=0.0)
    poses = waypoint_poses((ring,), prior(), HAND, np.zeros(1, np.uint64))[0]
    approach = axis(poses, 2)
    assert np.allclose(-approach[:, 2], np.cos(radians(80)))
    aside = poses[:, :2] - [0.45, 0.02]
    azimuth = np.arctan2(aside[:, 1], aside[:, 0])
    assert np.allclose(np.sort(np.diff(np.unwrap(azimuth))), pi / 2, atol=1e-6)
    assert np.allclose((aside * approach[:, :2]).sum(1) / np.linalg.norm(aside, axis=1),
                       -np.sin(radians(80)))
    assert np.allclose(axis(poses, 0)[:, 2], 0.0)  # at roll 0 the fingers close level


@pytest.mark.parametrize("tilt_deg", [80, 90, 120])
def test_a_level_hand_is_raised_off_the_table_and_not_taken_away(tilt_deg: float) -> None:
    prior = BoundingCylinder(*(np.array([v]) for v in (0.45, 0.0, 0.04, 0.10)))
    family = Ring(count=4, tilt_rad=radians(tilt_deg), aim=0.3)
    pose = waypoint_poses((family,), prior, HandTable(), np.zeros(1, np.uint64))[0]
    tips = hand_links(HandTable(), pose, np.tile(closing_commands(
        CLOSING_PATHS["curl40"])[None, :, 0], (len(pose), 1, 1)))[0][..., 4, :]
    assert (tips[..., 2] >= TABLE_CLEARANCE_M).all()
    if tilt_deg >= 90:
        away = np.hypot(pose[:, 0] - 0.45, pose[:, 1])
        assert (away <= family.palm_clearance_m + family.clearance_per_radius * 0.02 + 0.08).all()


@pytest.mark.parametrize("tilt_deg", [150, 180])
def test_no_pose_from_below_is_through_the_table(tilt_deg: float) -> None:
    """It ended the episode as a fault of the strategy, before poses that could be made."""
    family = Hemisphere(tilt_rad=np.radians(tilt_deg))
    poses = waypoint_poses((family,), prior(), HAND, np.zeros(1, np.uint64))
    assert poses[..., 2].min() >= 0.0


def test_random_poses_depend_on_the_key_alone() -> None:
    two = rows_of(prior(), [0, 0])
    both = waypoint_poses((Random(),), two, HAND, np.array([5, 6], np.uint64))
    one = waypoint_poses((Random(),), prior(), HAND, np.array([6], np.uint64))
    assert np.array_equal(both[1], one[0])
    assert not np.allclose(both[0], both[1])


@pytest.mark.parametrize(("line", "message"), [
    ("0.4,0,0.3,1,0,0,zero", ":3: qw: 'zero' is not a number"),
    ("nan,0,0.3,1,0,0,0", ":3: x_m: nan is not finite"),
    ("0.4,0,0.3,1,0,0", ":3: 6 cells, 7 are wanted"),
    ("0.4,0,-0.1,1,0,0,0", ":3: z_m: -0.1 is below the table; 0 and more is right"),
    ("450,0,0.3,1,0,0,0", ":3: x_m: 450 m is out of every arm's reach; places are in metres"),
    ("0.4,0,0.3,1,1,0,0", ":3: qx..qw: a quaternion of length 1.414"),
])
def test_pose_files_name_the_line(tmp_path: Path, line: str, message: str) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(",".join(CSV_COLUMNS) + "\n0.4,0,0.3,1,0,0,0\n" + line + "\n")
    with pytest.raises(WaypointError, match=message.replace(".", r"\.")):
        poses_from_csv(file)


def test_pose_files_are_used_as_they_stand(tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(",".join(CSV_COLUMNS) + "\n0.4,0,0.3,1,0,0,0\n0.5,0.1,0.3,0,1,0,0\n")
    poses = waypoint_poses((Csv(str(file)),), prior(), HAND, np.zeros(1, np.uint64))
    assert np.allclose(poses[0, 1], [0.5, 0.1, 0.3, 0, 1, 0, 0])


def test_pose_files_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    """As spreadsheets write them."""
    file = tmp_path / "poses.csv"
    file.write_text(",".join(CSV_COLUMNS) + "\n0.4,0,0.3,1,0,0,0\n", encoding="utf-8-sig")
    assert np.allclose(poses_from_csv(file), [[0.4, 0, 0.3, 1, 0, 0, 0]])


@pytest.mark.parametrize("name", CLOSING_PATHS)
def test_no_joint_outruns_the_step_and_ranges_are_kept(name: str) -> None:
    path = CLOSING_PATHS[name]
    commands = closing_commands(path)
    assert np.abs(np.diff(commands, axis=1)).max() <= path.step_rad + 1e-12
    assert (commands[..., 1:] >= np.array(HAND.flexion_low_rad) - 1e-9).all()
    assert (commands[..., 1:] <= np.array(HAND.flexion_high_rad) + 1e-9).all()
    assert np.abs(commands[..., 0]).max() <= HAND.abduction_limit_rad[1]


def test_a_spiral_climbs_as_it_goes_around() -> None:
    poses = waypoint_poses((Spiral(count=9, turns=2.0, tilt_rad=radians(90)),), prior(height=0.3),
                           HAND, np.zeros(1, np.uint64))[0]
    assert (np.diff(poses[:, 2]) > 0).all()
    angle = np.unwrap(np.arctan2(poses[:, 1] - 0.02, poses[:, 0] - 0.45))
    assert np.allclose(angle[-1] - angle[0], 4 * pi, atol=1e-9)


@pytest.mark.parametrize("count", [2, 4, 6, 8])
def test_pairs_that_oppose_look_at_all_sides(count: int) -> None:
    poses = waypoint_poses((Opposing(count=count, tilt_rad=radians(70)),), prior(), HAND,
                           np.zeros(1, np.uint64))[0]
    way = axis(poses, 2)[:, :2]
    np.testing.assert_allclose(way[::2], -way[1::2], atol=1e-9)
    azimuth = np.sort(np.arctan2(way[:, 1], way[:, 0]))
    np.testing.assert_allclose(np.diff(azimuth), 2 * pi / count, atol=1e-9)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_hands_from_above_close_along_lines_evenly_over_half_a_turn(count: int) -> None:
    poses = waypoint_poses((Top(count=count),), prior(), HAND, np.zeros(1, np.uint64))[0]
    closing = axis(poses, 0)
    twice = 2 * np.arctan2(closing[:, 1], closing[:, 0])  # of a line, whichever its sense
    np.testing.assert_allclose(np.abs(np.exp(1j * twice).sum()), 0.0, atol=1e-9)
    apart = np.abs(np.exp(1j * twice)[:, None] - np.exp(1j * twice)) + 9 * np.eye(count)
    assert apart.min() > 1.9 * np.sin(pi / count)


def test_a_box_is_as_wide_as_its_corners_reach_and_faces_the_robot_with_a_side() -> None:
    rng, n = np.random.default_rng(2), 40
    half, yaw = rng.uniform(0.01, 0.08, (n, 2)), rng.uniform(-pi, pi, n)
    x, y = rng.normal(size=(2, n))
    box = BoundingBox(x, y, np.hypot(*half.T), np.full(n, 0.1), half, yaw)
    # Level places as complex numbers.
    corners = np.exp(1j * yaw)[:, None] * (half @ [[1, 1, -1, -1], [1j, -1j, 1j, -1j]])
    angle = rng.uniform(-pi, pi, (n, 5))
    reach = (np.exp(-1j * angle)[:, :, None] * corners[:, None]).real.max(2)
    np.testing.assert_allclose(box.half_width(angle), reach)
    sides = yaw[:, None] + pi / 2 * np.arange(4)
    best = (np.exp(1j * sides) * -np.conj(x + 1j * y)[:, None]).real.argmax(1)
    np.testing.assert_allclose(np.cos(box.front() - sides[np.arange(n), best]), 1.0)


def test_hemisphere_directions_are_spread_over_the_whole_cap() -> None:
    cap = radians(70)
    poses = waypoint_poses((Hemisphere(count=64, tilt_rad=cap),), prior(), HAND,
                           np.zeros(1, np.uint64))[0]
    up = -axis(poses[None], 2)
    assert up[:, 2].min() > np.cos(cap)
    assert up[:, 2].min() < np.cos(cap) + 0.03
    apart = np.arccos(np.clip(up @ up.T, -1, 1)) + 10 * np.eye(64)
    # An even lattice of 64 on this cap: every direction has its neighbour near, none is crowded.
    ideal = np.sqrt(2 * pi * (1 - np.cos(cap)) / 64)
    assert apart.min() > 0.6 * ideal
    assert apart.min(1).max() < 1.4 * ideal


@pytest.mark.parametrize("family", [Ring, Column, Opposing, Top, Random, Spiral, Hemisphere])
def test_a_family_of_no_poses_is_refused(family: type) -> None:
    for count in (0, -3):
        with pytest.raises(ValueError, match=f"{family.__name__}: count is {count}; should be"):
            family(count=count)


def test_what_is_no_family_is_refused() -> None:
    prior = BoundingCylinder(*(np.full(1, v) for v in (0.45, 0.0, 0.03, 0.1)))
    for wrong, says in (([], r"waypoints: \[\] is no family"), ([Ring], "Ring.* is no family"),
                        (["ring"], "'ring' is no family; should be some of Ring, ")):
        with pytest.raises(WaypointError, match=says):
            waypoint_poses(wrong, prior, HandTable(), np.zeros(1, np.uint64))


@pytest.mark.parametrize("family", [Ring, Column, Opposing, Top, Random, Spiral, Hemisphere])
def test_every_number_of_a_family_moves_its_poses(family: type) -> None:
    """Some had a height, or a tilt, that changed nothing."""
    for f in fields(family):
        if f.init and f.name != "count":
            low, high = f.metadata["low"], f.metadata["high"]
            whole = isinstance(f.default, int)
            one, other = (waypoint_poses((family(**{f.name: int(value) if whole else value}),),
                                         prior(height=0.3), HAND, np.zeros(1, np.uint64))
                          for value in (0.7 * low + 0.3 * high, 0.3 * low + 0.7 * high))
            assert one.shape != other.shape or not np.allclose(one, other), f.name


@pytest.mark.parametrize("name", ["x_m", "y_m", "radius_m", "height_m"])
def test_a_prior_is_finite(name: str) -> None:
    """LAPACK did not converge."""
    given = {"x_m": np.full(2, 0.45), "y_m": np.zeros(2), "radius_m": np.full(2, 0.05),
             "height_m": np.full(2, 0.1)} | {name: np.array([0.1, np.nan])}
    with pytest.raises(ValueError, match=rf"prior.{name}: is nan at \(1,\); should be finite"):
        waypoint_poses([Ring(count=2)], BoundingCylinder(**given), HAND, np.arange(2))


@pytest.mark.parametrize("name", ["radius_m", "height_m", "half_m"])
def test_a_prior_has_sizes_above_0(name: str) -> None:
    """Poses about a radius below 0 were those of the other side."""
    given = {"x_m": np.full(2, 0.45), "y_m": np.zeros(2), "radius_m": np.full(2, 0.05),
             "height_m": np.full(2, 0.1), "half_m": np.full((2, 2), 0.03), "yaw_rad": np.zeros(2)}
    waypoint_poses([Ring(count=2)], BoundingBox(**given), HAND, np.arange(2))
    given[name][1] = -0.05
    with pytest.raises(ValueError, match=rf"prior.{name}: is -0.05 m in world 1; should be above"):
        waypoint_poses([Ring(count=2)], BoundingBox(**given), HAND, np.arange(2))
