"""Closing paths tabled: places as forward kinematics has them, ways never shorter than they are."""

from dataclasses import replace

import numpy as np

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.finger.path_table import path_on_device, path_table
from warpgrasp.mechanism.calibration import draw_calibration, no_errors, true_hands
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import ContactTable, ErrorTable, HandTable

HAND, FREE = HandTable(), ContactTable.none()


def chains(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps, links, and joints 1 to 3 and tip by forward kinematics, (step, 4, 3), of finger 2."""
    commands = closing_commands(CLOSING_PATHS[name])
    table, links = path_table(HAND, commands[None])
    still = np.tile([0, 0, 0, 0, 0, 0, 1.0], (commands.shape[1], 1))
    points, _ = hand_links(HAND, still, commands.transpose(1, 0, 2))
    return table[0, 2], links[0, 2], points[:, 2, 1:] - points[:, 2, :1]


def test_links_stand_where_forward_kinematics_puts_them() -> None:
    for name in CLOSING_PATHS:
        _, links, points = chains(name)
        for link in range(3):
            np.testing.assert_allclose(links[link]["start"], points[:, link], atol=1e-15)
            np.testing.assert_allclose(links[link]["end"], points[:, link + 1], atol=1e-15)


def test_no_point_of_a_link_comes_farther_than_the_table_says() -> None:
    rng = np.random.default_rng(0)
    for name in CLOSING_PATHS:
        _, links, points = chains(name)
        pairs = np.sort(rng.integers(0, len(points), (200, 2)), axis=1)
        share = rng.random((200, 1))
        for link in range(3):
            place = [(1 - share) * points[step, link] + share * points[step, link + 1]
                     for step in pairs.T]
            way = np.linalg.norm(place[1] - place[0], axis=1)
            assert (way <= np.diff(links[link]["come"][pairs], axis=1)[:, 0] + 1e-12).all()


def test_strain_is_what_servos_put_on_the_stops() -> None:
    commands = np.zeros((1, 4, 5, 4))
    commands[0, :, :, 2] = np.radians([10.0, 80.0, 96.0, 98.0, 90.0])  # the stop is at 95
    path, links = path_table(HAND, commands)
    torque = HAND.joint_stiffness_Nm_rad * np.radians([0.0, 0.0, 1.0, 3.0, 3.0])
    np.testing.assert_allclose(path[0, 1]["strain"], torque, atol=1e-12)
    np.testing.assert_array_equal(links[0, 1, :, 2]["end"], links[0, 1, :, 3]["end"])


def test_a_path_is_tabled_once_and_anew_when_it_changes() -> None:
    commands = closing_commands(CLOSING_PATHS["curl40"])[None].copy()
    first = path_on_device(HAND, FREE, no_errors(), commands, "cpu")
    for shared, whole in zip(first, path_table(HAND, commands, stops=False), strict=True):
        np.testing.assert_array_equal(shared.numpy(), whole)  # all fingers go the same way
    assert path_on_device(HAND, FREE, no_errors(), commands.copy(), "cpu")[0] is first[0]
    commands[0, 1, 5] += 0.01  # in place
    path, links = path_on_device(HAND, FREE, no_errors(), commands, "cpu")
    table, tabled = path_table(HAND, commands, stops=False)
    np.testing.assert_array_equal(path.numpy()["command"], table["command"])
    np.testing.assert_array_equal(links.numpy(), tabled)


def test_a_true_finger_is_as_near_as_its_bound_and_comes_no_farther_than_tabled() -> None:
    """By forward kinematics with its own links, at joints where its sensors say they are not."""
    worlds, contact = 40, ContactTable()
    errors = draw_calibration(ErrorTable(), np.arange(worlds, dtype=np.uint64))
    rng = np.random.default_rng(2)
    for name in CLOSING_PATHS:
        commands = closing_commands(CLOSING_PATHS[name])
        links = path_on_device(HAND, contact, errors, commands[None], "cpu")[1].numpy()[0]
        hands = true_hands(HAND, contact, errors, "cpu").numpy()
        for world in range(worlds):
            for finger in range(3):
                own = replace(HAND, link_length_m=tuple(
                    np.array(HAND.link_length_m) * (1 + errors.link_length_share[world, finger])))
                q = commands[:, :, :] - errors.joint_offset_rad[world, :, None]
                points, _ = hand_links(own, np.tile([0, 0, 0, 0, 0, 0, 1.0], (q.shape[1], 1)),
                                       q.swapaxes(0, 1))
                ends = points[:, finger, 2:] - points[:, finger, :1]
                pairs = np.sort(rng.integers(0, len(ends), (50, 2)), axis=1)
                for link in range(3):
                    off = np.linalg.norm(ends[:, link] - links[finger, link]["end"], axis=1)
                    assert (off <= hands["sag"][world, finger, link]).all()
                    way = np.linalg.norm(ends[pairs[:, 1], link] - ends[pairs[:, 0], link], axis=1)
                    row = links[finger, link]
                    come = row["come"] + hands["askew"][world, finger] * row["swing"]
                    assert (way <= np.diff(come[pairs], axis=1)[:, 0] + 1e-12).all()
                    step = rng.integers(0, len(ends), 50)
                    jump = np.floor(0.02 * row["steps"][step]).astype(int)
                    there = np.minimum(step + jump, len(ends) - 1)
                    assert (come[there] - come[step] <= 0.02 + 1e-12).all()


def test_no_jump_goes_beyond_what_is_free() -> None:
    """As many steps as a table's `steps` allows for a free way: no link comes farther than it."""
    rng = np.random.default_rng(1)
    for name in CLOSING_PATHS:
        _, links, _ = chains(name)
        for link in links:
            step = rng.integers(0, len(link), 300)
            room = rng.uniform(0.0, 0.05, 300)
            jump = np.floor(room * link["steps"][step])
            there = np.minimum(step + jump, len(link) - 1).astype(int)
            assert (link["come"][there] - link["come"][step] <= room + 1e-12).all()
            assert (jump > 0).mean() > 0.8
