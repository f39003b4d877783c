"""Hand: straight fingers, the sense of flexion, lengths that never change."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from warpgrasp.mechanism.tendon import may_stop_free
from warpgrasp.mechanism.utah_mit_hand import hand_links, hand_of
from warpgrasp.mechanism.utah_mit_weight import link_weights
from warpgrasp.parameters import HandTable, SensorTable

HAND = HandTable()
HOME = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
angles = st.lists(st.floats(-1.5, 1.5), min_size=16, max_size=16)


def test_links_weigh_as_solid_capsules() -> None:
    hand = replace(HAND, link_length_m=(0.05, 0.03, 0.01))
    shapes = [trimesh.creation.capsule(length, hand.link_radius_m, count=(64, 64))
              for length in hand.link_length_m]
    wanted = [hand.link_density_kg_m3 * 9.81 * shape.volume for shape in shapes]
    np.testing.assert_allclose(link_weights(hand), wanted, rtol=0.01)


@pytest.mark.parametrize(("changed", "pull_N"), [
    ({"tension_step_N": 0.5}, 0.0), ({"tension_noise_N": 0.2}, 0.0), ({}, 0.7), ({}, 40.0)])
def test_free_fingers_may_stop_where_all_that_tendons_read_passes_the_threshold(
        changed: dict[str, float], pull_N: float) -> None:
    """Friction of both tendons, the links' pull, a step of the converter, and noise."""
    quiet = SensorTable(tension_step_N=0.0, tension_noise_N=0.0)
    friction = HAND.tendon_friction * max(2 * HAND.co_contraction_N,
                                          2 * HAND.tension_low_N + pull_N)
    steps = changed.get("tension_step_N", 0.0) + 8.5 * changed.get("tension_noise_N", 0.0)
    for off, may in ((-1e-6, True), (1e-6, False)):
        sensor = replace(quiet, **changed, tendon_threshold_N=friction + pull_N + steps + off)
        assert may_stop_free(HAND, sensor, np.array([pull_N])).tolist() == [may]


def test_straight_fingers_point_along_the_approach() -> None:
    points, palmar = hand_links(HAND, HOME, np.zeros((1, 4, 4)))
    reach = HAND.abduction_offset_m + sum(HAND.link_length_m)
    assert np.allclose(points[0, :, 4, 2], reach)
    assert np.allclose(points[0, :, 4, 0], [-0.04, -0.04, -0.04, 0.04])
    assert np.allclose(points[0, :, 4, 1], [-0.028, 0, 0.028, 0])
    assert np.allclose(palmar[0, :, 2, 0], [1, 1, 1, -1])  # palmar sides face each other


def test_flexion_swings_inward_and_abduction_outward() -> None:
    q = np.zeros((1, 4, 4))
    q[..., 1] = 0.3
    points, _ = hand_links(HAND, HOME, q)
    assert (points[0, :3, 4, 0] > -0.04).all()
    assert points[0, 3, 4, 0] < 0.04
    q = np.zeros((1, 4, 4))
    q[..., 0] = 0.2
    points, _ = hand_links(HAND, HOME, q)
    assert (points[0, :3, 4, 1] > points[0, :3, 0, 1]).all()


@settings(max_examples=30)
@given(angles, st.floats(-3, 3), st.floats(-3, 3))
def test_links_keep_their_length_and_move_rigidly(q: list, x: float, turn: float) -> None:
    joints = np.array(q).reshape(1, 4, 4)
    still, palmar = hand_links(HAND, HOME, joints)
    lengths = np.linalg.norm(np.diff(still, axis=2), axis=-1)
    assert np.allclose(lengths, [HAND.abduction_offset_m, *HAND.link_length_m])
    along = np.diff(still, axis=2)[:, :, 1:]
    assert np.allclose((along * palmar).sum(-1), 0.0, atol=1e-12)
    rotation = Rotation.from_rotvec([0.3 * turn, turn, -0.2])
    moved, _ = hand_links(HAND, np.array([[x, 0.1, 0, *rotation.as_quat()]]), joints)
    assert np.allclose(moved[0], rotation.apply(still.reshape(-1, 3)).reshape(4, 5, 3)
                       + [x, 0.1, 0], atol=1e-12)


@pytest.mark.parametrize("key", ["finger_spacing_m", "palm_gap_m"])
def test_fingers_that_lie_in_one_another_are_refused(key: str) -> None:
    """Their straight links, by the places of their axes, are as far apart as they are thick."""
    least = replace(HAND, link_radius_m=0.011, **{key: 0.022})
    points, _ = hand_links(least, HOME, np.zeros((1, 4, 4)))
    base = points[0, :, 0]
    apart = np.linalg.norm(base[:, None] - base, axis=-1)[np.triu_indices(4, 1)]
    assert np.isclose(apart.min(), 2 * least.link_radius_m)
    with pytest.raises(ValueError, match=f"overlap where .* apart; {key}m should be 22 at least"):
        hand_of(replace(least, **{key: 0.0215}))


@pytest.mark.parametrize(("limits", "said"), [
    ({"abduction_limit_rad": (0.4, -0.4)}, r"abduction_limit_deg should rise; are \(0.4,\) and"),
    ({"flexion_low_rad": (1.6, 0.0, 0.0)}, "flexion_low_deg should be below flexion_high_deg; are"),
    ({"flexion_high_rad": (1.5, 0.0, 1.6)}, "flexion_low_deg should be below flexion_high_deg"),
])
def test_limits_the_wrong_way_round_are_refused(
        limits: dict[str, tuple[float, ...]], said: str) -> None:
    """A spec's are; from Python fingers closed between stops that held them off each other."""
    with pytest.raises(ValueError, match=said):
        hand_of(replace(HAND, **limits))  # pyright: ignore[reportArgumentType]


def test_poses_and_joints_of_other_shapes_are_refused() -> None:
    for pose, q, told in ((HOME[:, :6], (1, 4, 4), r"hand_pose: .* \(pose, 7\)"),
                          (HOME, (1, 4, 3), r"q_rad: .* \(pose 1, 4, 4\)"),
                          (HOME, (2, 4, 4), r"q_rad: .* \(pose 1, 4, 4\)")):
        with pytest.raises(ValueError, match=told):
            hand_links(HAND, pose, np.zeros(q))
