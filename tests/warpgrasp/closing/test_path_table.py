"""Closing paths tabled: places as forward kinematics has them, ways never shorter than they are."""

from dataclasses import replace

import numpy as np

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.closing.path_table import path_on_device
from warpgrasp.mechanism.calibration import draw_calibration, no_errors
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import ErrorTable, HandTable

HAND = HandTable()


def chains(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps, links, and joints 1 to 3 and tip by forward kinematics, (step, 4, 3), of finger 2."""
    commands = closing_commands(CLOSING_PATHS[name])
    table, links = (rows.numpy() for rows in path_on_device(
        HAND, no_errors(), commands[None], "cpu"))
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


def test_moves_count_the_flexion_joints_that_move() -> None:
    table, _, _ = chains("curl40")
    curl, close = 80, 200  # steps of half a degree: two joints curl, then one closes
    assert table["moves"][[0, curl, curl + close]].tolist() == [0, 2 * curl, 2 * curl + close]


def test_a_path_is_tabled_once_and_anew_when_it_changes() -> None:
    commands = closing_commands(CLOSING_PATHS["curl40"])[None].copy()
    first = path_on_device(HAND, no_errors(), commands, "cpu")
    assert path_on_device(HAND, no_errors(), commands.copy(), "cpu")[0] is first[0]
    commands[0, 1, 5] += 0.01  # in place
    path, links = (rows.numpy() for rows in path_on_device(HAND, no_errors(), commands, "cpu"))
    np.testing.assert_array_equal(path["command"], commands)
    shared = first[1].numpy()  # all fingers go the same way
    np.testing.assert_array_equal(links[:, [0, 2, 3]], shared[:, [0, 2, 3]])
    assert (links[0, 1, 2, 5]["end"] != shared[0, 1, 2, 5]["end"]).any()


def test_a_true_robot_goes_its_own_way() -> None:
    """Its links are as long as they are, and its joints stand where its sensors say they do not."""
    key = np.arange(3, dtype=np.uint64)
    errors = draw_calibration(ErrorTable(), key)
    commands = np.stack([closing_commands(CLOSING_PATHS[name])[:, :150]
                         for name in ("curl40", "base_then_curl")])
    path, links = (rows.numpy().reshape(3, 2, 4, *rows.shape[2:])
                   for rows in path_on_device(HAND, errors, commands, "cpu"))
    np.testing.assert_allclose(path["command"], commands[None]
                               - errors.joint_offset_rad[:, None, :, None], atol=1e-15)
    for world in range(3):
        for finger in range(4):
            own = replace(HAND, link_length_m=tuple(
                np.array(HAND.link_length_m) * (1 + errors.link_length_share[world, finger])))
            points, _ = hand_links(own, np.tile([0, 0, 0, 0, 0, 0, 1.0], (150, 1)),
                                   path["command"][world, 1].swapaxes(0, 1))
            points = points[:, finger, 1:] - points[:, finger, :1]
            if finger == 3:  # it faces the others
                points = points * [-1, -1, 1]
            for link in range(3):
                np.testing.assert_allclose(links["end"][world, 1, finger, link],
                                           points[:, link + 1], atol=1e-15)


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
