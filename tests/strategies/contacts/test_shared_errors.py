"""Shifts of contacts by errors of calibration, against differences of the forward kinematics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.contacts.finger_touch import no_links
from strategies.contacts.shared_errors import COUNT, EACH_FINGER, shared_shifts, shared_vectors
from warpgrasp.mechanism.calibration import arm_variance
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable

HAND, ERRORS, ARM, N = HandTable(), ErrorTable(), ArmTable(), 12
STEP = 1e-6


def stood():
    """Contacts at the tips of fingers of random hands, in one world: links, points, normals."""
    rng = np.random.default_rng(3)
    q = rng.uniform([-0.2, 0.0, 0.1, 0.1], [0.2, 1.0, 1.0, 1.0], (N, 4))
    pose = np.concatenate([rng.normal(0, 0.2, (N, 3)), Rotation.random(N, rng=rng).as_quat()], 1)
    finger = np.arange(N) % 4
    links = replace(no_links(1, N, HAND), hand_pose=pose[None], q_rad=q[None],
                    finger=finger[None], link=np.full((1, N), 2))
    normal = rng.normal(size=(1, N, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return links, tips(HAND, pose, q, finger), normal


def tips(hand: HandTable, pose: np.ndarray, q: np.ndarray, finger: np.ndarray) -> np.ndarray:
    points, _ = hand_links(hand, pose, np.repeat(q[:, None], 4, axis=1))
    return points[np.arange(N), finger, 4][None]


def along(difference: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return np.abs(np.sum(difference * normal, axis=-1))[0]


@pytest.mark.parametrize("link", range(3))
def test_contacts_on_any_link_are_moved_by_what_comes_before_them_alone(link: int) -> None:
    """In the middle of a link: by the joints up to its own, by the lengths of links before it."""
    links, _, _ = stood()
    pose, q, finger = links.hand_pose[0], links.q_rad[0], links.finger[0]

    def middles(hand: HandTable, q: np.ndarray) -> np.ndarray:
        points = hand_links(hand, pose, np.repeat(q[:, None], 4, axis=1))[0][np.arange(N), finger]
        return points[:, 1 + link:3 + link].mean(1)

    before = middles(HAND, q)
    vectors = shared_vectors(replace(links, link=np.full((1, N), link)), before[None], ERRORS, ARM)
    own = vectors[0, np.arange(N)[:, None], :, EACH_FINGER * finger[:, None] + np.arange(6)]
    for joint in range(4):
        turned = q + STEP * (np.arange(4) == joint)
        np.testing.assert_allclose(
            np.linalg.norm(own[:, joint], axis=1) / ERRORS.joint_offset_rad,
            np.linalg.norm(middles(HAND, turned) - before, axis=1) / STEP, rtol=1e-4, atol=1e-7)
    for k in range(2):
        length = np.array(HAND.link_length_m) * (1.0 + STEP * (np.arange(3) == k) * (k < link))
        moved = middles(replace(HAND, link_length_m=tuple(length)), q) - before
        np.testing.assert_allclose(own[:, 4 + k] / ERRORS.link_length_share, moved / STEP,
                                   rtol=1e-4, atol=1e-7)


def own_columns(shifts: np.ndarray, links, number: int) -> np.ndarray:
    return np.abs(shifts[0, np.arange(N), EACH_FINGER * links.finger[0] + number])


@pytest.mark.parametrize("joint", range(4))
def test_a_joint_zero_turns_the_finger(joint: int) -> None:
    links, points, normal = stood()
    shifts = shared_shifts(links, points, normal, ERRORS, ARM)
    q = links.q_rad[0].copy()
    q[:, joint] += STEP
    moved = tips(HAND, links.hand_pose[0], q, links.finger[0]) - points
    assert shifts.shape == (1, N, COUNT)
    assert own_columns(shifts, links, joint) == pytest.approx(
        along(moved, normal) / STEP * ERRORS.joint_offset_rad, rel=1e-4, abs=1e-8)


@pytest.mark.parametrize("joint", range(4))
@pytest.mark.parametrize("finger", range(4))
def test_an_error_moves_all_contacts_of_a_finger_by_one_sign(joint: int, finger: int) -> None:
    links, points, _ = stood()
    vectors = shared_vectors(links, points, ERRORS, ARM)
    q = links.q_rad[0].copy()
    q[:, joint] += STEP
    moved = (tips(HAND, links.hand_pose[0], q, links.finger[0]) - points)[0] / STEP
    own = links.finger[0] == finger
    column = vectors[0, own, :, EACH_FINGER * finger + joint] / ERRORS.joint_offset_rad
    sign = np.sign((column * moved[own]).sum())
    np.testing.assert_allclose(sign * column, moved[own], rtol=1e-4, atol=1e-7)
    assert not vectors[0, ~own, :, EACH_FINGER * finger + joint].any()


@pytest.mark.parametrize("link", range(2))
def test_a_length_moves_what_follows(link: int) -> None:
    links, points, normal = stood()
    shifts = shared_shifts(links, points, normal, ERRORS, ARM)
    length = np.array(HAND.link_length_m)
    length[link] *= 1.0 + STEP
    longer = replace(HAND, link_length_m=tuple(length))
    moved = tips(longer, links.hand_pose[0], links.q_rad[0], links.finger[0]) - points
    assert own_columns(shifts, links, 4 + link) == pytest.approx(
        along(moved, normal) / STEP * ERRORS.link_length_share, rel=1e-4, abs=1e-8)


def test_mount_and_arm_move_the_whole_hand() -> None:
    links, points, normal = stood()
    shifts = shared_shifts(links, points, normal, ERRORS, ARM)[0]
    mount, turn, arm = (shifts[:, -9 + k:shifts.shape[1] - 6 + k] for k in (0, 3, 6))
    assert np.linalg.norm(mount, axis=1) == pytest.approx(np.full(N, ERRORS.mount_m))
    assert np.linalg.norm(arm, axis=1) == pytest.approx(
        np.full(N, np.sqrt(arm_variance(ERRORS, ARM))))
    hands = Rotation.from_quat(links.hand_pose[0, :, 3:])
    flange = links.hand_pose[0, :, :3] - hands.apply([0.0, 0.0, HAND.mount_length_m])
    for axis in range(3):
        way = hands.apply(np.eye(3)[axis])
        expected = np.sum(np.cross(way, points[0] - flange) * normal[0], axis=1)
        assert np.abs(turn[:, axis]) == pytest.approx(
            np.abs(expected) * ERRORS.mount_rad, abs=1e-9)


def test_without_errors_nothing_is_shared() -> None:
    links, points, normal = stood()
    exact = shared_shifts(links, points, normal, ErrorTable.none(), ArmTable(repeatability_m=0.0))
    assert not exact.any()
