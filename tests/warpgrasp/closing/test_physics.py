"""Physics by construction, over objects, hand poses, paths and thresholds drawn at random."""

from dataclasses import replace

import numpy as np
import pytest
from closings import HAND, body_of, close, poses_about
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from sweeps.validate.reference_finger import FingerEnergy
from warpgrasp.closing.closing import close_fingers
from warpgrasp.geometry.body import Body, scene_of
from warpgrasp.mechanism.utah_mit_hand import hand_links, hand_of
from warpgrasp.mechanism.utah_mit_weight import weight_misfit
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ContactTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

GRADIENT_NM = 1e-6
ROUND = ("ball", "capsule")
FLAT = ("block", "large_cylinder", "small_cylinder", "wedge")
HOLLOW = ("lightbulb", "wine_bottle", "coke_bottle")


def rests(body: Body, poses: np.ndarray, path: str, threshold: float,
          contact: ContactTable | None = None):
    """Every finger that stopped on something: its energy, joints, command and torque."""
    felt, truth, commands = close(body, poses, path, threshold, contact=contact)
    for i, f in np.argwhere(truth.link[:, 0, 0] >= 0):
        at = i, 0, 0, f
        yield (FingerEnergy(body, HAND, poses[i], f, contact), truth.q_rad[at],
               commands[f, felt.step[at]], truth.torque_Nm[at])


drawn = st.tuples(st.integers(0, 10**6), st.sampled_from(["curl40", "base_then_curl", "together"]),
                  st.floats(2.5, 20.0))


@settings(max_examples=12, derandomize=True, phases=[Phase.generate])
@given(st.sampled_from(ROUND), drawn)
def test_a_rest_is_a_rest(name: str, case) -> None:
    """The energy, written out anew, has no slope at the reported rest, and no way down nearby."""
    seed, path, threshold = case
    body = body_of(name)
    rng = np.random.default_rng(seed)
    for energy, q, command, _ in rests(body, poses_about(body, 2, seed), path, threshold):
        assert np.abs(energy.gradient(q, command)).max() <= GRADIENT_NM
        here = energy.energy(q, command)
        for step in rng.normal(scale=1e-4, size=(4, 4)):
            assert energy.energy(q + step, command) >= here - 1e-12


@settings(max_examples=12, derandomize=True, phases=[Phase.generate])
@given(st.sampled_from((*ROUND, *FLAT)), drawn)
def test_reactions_push_and_no_link_is_deeper_than_its_torque_allows(name: str, case) -> None:
    """Without weight and stops servo torques are what forces k * depth >= 0 along outward normals
    turn the joints with; so no link is deeper than the torques need, and a joint beyond the last
    touched link bears 0."""
    seed, path, threshold = case
    body = body_of(name)
    for energy, q, command, torque in rests(body, poses_about(body, 2, seed), path, threshold,
                                            ContactTable.none()):
        assert np.allclose(torque, HAND.joint_stiffness_Nm_rad * (command - q), atol=1e-12)
        state = energy.links(q)
        pressed = state.depth_m > 0.0
        assert pressed.any()
        lever = HAND.link_length_m[2] / 4  # shorter than any lever that stops a finger
        deepest = np.abs(torque).max() / lever / HAND.skin_stiffness_N_m
        assert state.depth_m.max() <= max(deepest, 5e-4)
        last = int(np.flatnonzero(pressed.any(1)).max())
        assert np.allclose(torque[last + 2:], 0.0, atol=1e-6)


@settings(max_examples=10, derandomize=True, phases=[Phase.generate])
@given(drawn, st.floats(0.0, 30.0), st.sampled_from((0.0, 0.3, 1.0)))
def test_no_tendon_is_slack_and_the_difference_is_the_torque(
        case, co_contraction: float, noise: float) -> None:
    seed, path, threshold = case
    body = body_from_name("block")
    hand = replace(HAND, co_contraction_N=co_contraction)
    commands = closing_commands(CLOSING_PATHS[path])
    poses = poses_about(body, 2, seed)
    felt, truth = close_fingers(
        scene_of([body], "cpu"), np.zeros(1, int), np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1)), hand,
        SensorTable(tendon_threshold_N=threshold, tension_noise_N=noise), np.arange(
            2, dtype=np.uint64), np.full((2, 1, 1), int(ProbeStatus.CONTACT)), poses[:, None],
        commands[None], np.array([commands.shape[1]]))
    read = felt.tension_N[np.isfinite(felt.tension_N)]
    rub, slack = hand.tendon_friction, 6.0 * noise / 4.0 + 0.1  # sixteen readings averaged
    assert (read >= hand.tension_low_N * (1 - rub) - slack).all()
    stopped = felt.status == ProbeStatus.CONTACT
    step = np.maximum(felt.step, 1)
    delta = commands[np.arange(4), step] - commands[np.arange(4), step - 1]
    moving = np.sign(np.round(delta, 12))
    pull = (felt.tension_N[..., 0] / (1 + rub * moving)
            - felt.tension_N[..., 1] / (1 - rub * moving))[stopped]
    torque = truth.torque_Nm[stopped] / hand.moment_arm_m
    np.testing.assert_allclose(pull, torque, atol=2.0 * slack)


def test_a_link_between_object_and_table_bears_on_both() -> None:
    """One distance for both used to jam the descent on its kink, a millimetre deep."""
    body, between = body_of("capsule"), 0
    poses = np.array([[0.0787, 0.0002, 0.0952, 0.6919, 0.5717, -0.3664, -0.2454],
                      [-0.0455, 0.0270, 0.0995, -0.3393, 0.8512, -0.3444, 0.2042],
                      [0.0109, 0.0733, 0.0872, 0.8861, 0.0651, -0.0724, 0.4531]])
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    for energy, q, command, _ in rests(body, poses, "base_then_curl", 12.0):
        state = energy.links(q)
        if (state.depth_m > 0.0).all(1).any():
            between += 1
            assert np.abs(energy.gradient(q, command)).max() <= GRADIENT_NM
            assert state.depth_m.max() < 3e-4
    assert between > 0


def worst_slopes(body: Body, path: str, count: int) -> list[tuple[float, float]]:
    """Of every rest the largest slope at the nearest places, and with creases allowed [N m]."""
    return [(float(np.abs(energy.gradient(q, command)).max()),
             float(np.abs(energy.slope(q, command)).max()))
            for energy, q, command, _ in rests(body, poses_about(body, count, 5), path, 6.0)]


@pytest.mark.slow
def test_a_stop_is_looked_at_closely() -> None:
    """Where a link lies deeper at a place that five samples miss, the rest goes on from there; one
    of these stood 0.8 N m off its rest."""
    assert max(slope for _, slope in worst_slopes(body_of("lightbulb"), "base_then_curl", 60)
               ) <= GRADIENT_NM


def test_a_rest_on_a_crease_is_a_rest() -> None:
    """Flush with a face or in a neck a link has two places equally near: neither slope vanishes
    there, a mean of the two does."""
    slopes = np.array(worst_slopes(body_of("wine_bottle"), "base_then_curl", 20))
    creased = slopes[:, 0] > GRADIENT_NM
    assert creased.any()
    assert (slopes[creased, 1] <= GRADIENT_NM).all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "share"), [
    *((name, 0.0) for name in ROUND), *((name, 0.01) for name in (*FLAT, *HOLLOW))])
def test_rests_of_many_closings(name: str, share: float) -> None:
    """Creases allowed, hardly a rest is left that is none: those on which BFGS itself stalls."""
    body = body_of(name)
    slopes = [slope for path in ("curl40", "base_then_curl")
              for _, slope in worst_slopes(body, path, 60)]
    assert len(slopes) > 50
    assert np.mean(np.array(slopes) > GRADIENT_NM) <= share


def test_free_fingers_hang_where_their_energy_is_least() -> None:
    """As heavy as fingers may be, tips are within a tenth of a millimetre; heavier are refused."""
    body, contact = body_from_name("block"), ContactTable(friction=0.0, self_contact=False)
    soft = replace(HAND, joint_stiffness_Nm_rad=0.38)
    poses = poses_about(body, 3, 5)
    poses[:, 2] += 1.0
    commands = closing_commands(CLOSING_PATHS["curl40"])
    assert weight_misfit(soft, contact) == ""
    _, truth = close_fingers(
        scene_of([body], "cpu"), np.zeros(1, int), np.tile([0, 0, 0, 0, 0, 0, 1.0], (3, 1)),
        soft, SensorTable(tendon_threshold_N=30.0), np.arange(3, dtype=np.uint64),
        np.full((3, 1, 1), int(ProbeStatus.CONTACT)), poses[:, None], commands[None],
        np.array([commands.shape[1]]), contact=contact)
    sunk = []
    for i in range(3):
        for f in range(4):
            energy = FingerEnergy(body, soft, poses[i], f, contact)
            q, command = truth.q_rad[i, 0, 0, f], commands[f, -1]
            least = minimize(energy.energy, command, (command,), jac=energy.gradient).x
            tips, _ = hand_links(soft, poses[[i, i, i]], np.tile(
                np.array([q, least, command])[:, None], (1, 4, 1)))
            assert np.linalg.norm(tips[0, f, 4] - tips[1, f, 4]) < 1e-4
            sunk.append(np.linalg.norm(tips[0, f, 4] - tips[2, f, 4]))
    assert max(sunk) > 3e-3
    with pytest.raises(ValueError, match=r"turns their joints by 0\.12 rad together"):
        hand_of(replace(HAND, joint_stiffness_Nm_rad=0.3), contact)
    # Where they weigh nothing they hang nowhere, and links are where their joints have them.
    hand_of(replace(HAND, joint_stiffness_Nm_rad=0.3), replace(contact, weight=False))
    hand_links(replace(HAND, joint_stiffness_Nm_rad=0.3), poses[:1], np.zeros((1, 4, 4)))
