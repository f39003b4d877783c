"""Where the robot concludes that a finger of any hand touched, beside where it did."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from chain_closings import ALONE, QUIET, TABLE, close, poses_above
from reference_chain import ReferenceChain
from reference_posterior import Skin, affine_lever, posterior

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind, link_frames_of, palmar_sides
from warpgrasp.chain_closing.chain_estimate import (
    ChainEstimate,
    estimate_chain_contacts,
    longest_link_m,
)
from warpgrasp.closing.closing import ClosingTruth
from warpgrasp.closing.contact_places_kernel import ALONG
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.hands.hand_model import Finger, Follow, HandModel
from warpgrasp.mechanism.calibration import place_variance
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ErrorTable, SensorTable

POSES = poses_above(60)
EXACT = replace(ErrorTable.none())


def estimated(model: HandModel, sensors: SensorTable
              ) -> tuple[ChainEstimate, ClosingTruth, np.ndarray]:
    """Estimates, truths, and which of them are contacts with the object."""
    hand = chain_of(model)
    commands = chain_commands(hand, "curl40")
    felt, truth = close(hand, "small_cylinder", POSES, commands, sensors)
    found = estimate_chain_contacts(felt, POSES[:, None], commands[None], ArmTable(), hand, TABLE,
                                    sensors, errors=EXACT, contact=ALONE)
    return found, truth, (felt.status == 1) & (truth.link >= 0) & ~truth.on_table


@pytest.mark.parametrize("kind", ["allegro", "leap"])
def test_torques_tell_the_link_and_the_place(kind: str) -> None:
    found, truth, felt = estimated(hand_of_kind(kind), QUIET)
    assert felt.sum() >= 50
    off = np.linalg.norm(found.point_m - truth.point_m, axis=-1)[felt]
    assert np.quantile(off, 0.5) < 0.005
    assert (found.link == truth.link)[felt].mean() >= 0.85
    assert found.link_weight[felt].sum(-1) == pytest.approx(1.0)
    # As far off as the covariance says: three quarters within two deviations.
    sigma = np.sqrt(np.trace(found.covariance_m2, axis1=-2, axis2=-1))[felt]
    assert (off < 2.0 * sigma).mean() > 0.75


def test_a_switch_tells_its_link_and_no_more() -> None:
    model = replace(hand_of_kind("allegro"), senses="tip_switches")
    found, truth, felt = estimated(model, replace(QUIET, switch_force_N=0.2))
    hand = chain_of(model)
    assert felt.sum() >= 20
    assert (found.link[felt] == 3).all()
    assert (truth.link[felt] == 3).mean() > 0.9
    for i in map(tuple, np.argwhere(felt)[:8]):
        pose = matrix_of(tuple(POSES[i[0]]))
        frame = pose @ link_frames_of(hand, i[3], truth.q_rad[i])[3]
        ends = np.array([hand.capsules[i[3]][-1].start, hand.capsules[i[3]][-1].end])
        middle = frame[:3, :3] @ ends.mean(0) + frame[:3, 3]
        assert np.linalg.norm(found.point_m[i] - middle) < 0.03


def test_places_inside_the_finger_lie_in_its_capsules() -> None:
    found, truth, felt = estimated(hand_of_kind("leap"), QUIET)
    hand = chain_of(hand_of_kind("leap"))
    i = tuple(np.argwhere(felt)[0])
    pose = matrix_of(tuple(POSES[i[0]]))
    frames = pose @ link_frames_of(hand, i[3], truth.q_rad[i])
    for c, (capsule, joint) in enumerate(zip(hand.capsules[i[3]], hand.capsule_joint[i[3]],
                                             strict=True)):
        end = frames[joint] @ [*capsule.end, 1.0]
        assert found.inside_m()[i][2 * c + 1] == pytest.approx(end[:3], abs=1e-9)


def test_a_hand_of_one_joint_a_finger_has_no_links_between_joints() -> None:
    model = hand_of_kind("barrett")
    short = tuple(replace(f, joints=f.joints[:1], pads=(), pad_places=()) for f in model.fingers)
    assert longest_link_m(chain_of(replace(model, fingers=short))) == 0.0
    assert longest_link_m(chain_of(model)) > 0.0


def with_one_drive(model: HandModel) -> HandModel:
    """The hand with fingers whose last joint turns with the one before it: one drive of a finger of
    two joints."""
    def coupled(finger: Finger) -> Finger:
        *others, leader, last = finger.joints
        return replace(finger, joints=(*others, leader, replace(
            last, follows=Follow(leader.name, 0.4, 0.0))))

    return replace(model, fingers=tuple(map(coupled, model.fingers)))


@pytest.mark.parametrize("kind", ["allegro", "barrett", "one drive"])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_an_estimate_is_the_posterior_over_all_places_of_the_skin(kind: str, friction: float
                                                                  ) -> None:
    """Written out in NumPy, of fingers that stopped anywhere, one with a drive at its stop."""
    single = kind == "one drive"
    hand = chain_of(with_one_drive(hand_of_kind("barrett")) if single else hand_of_kind(kind))
    sensors, errors = SensorTable(), ErrorTable()
    contact = replace(ALONE, friction=friction)
    commands = chain_commands(hand, "curl40")
    felt, truth = close(hand, "small_cylinder", POSES[:12], commands, QUIET)
    stopped = np.argwhere((felt.status == 1) & (truth.link >= 0) & (felt.step > 5))
    if single:
        stopped = np.array([i for i in stopped if len(hand.drives[i[3]]) == 1])
    stopped = stopped[:5]
    assert len(stopped) >= 3
    first = tuple(stopped[0])
    held = hand.model.fingers[first[3]].joints[hand.drives[first[3]][-1]]
    felt.q_rad[(*first, len(hand.drives[first[3]]) - 1)] = held.high_rad
    found = estimate_chain_contacts(felt, POSES[:12, None], commands[None], ArmTable(), hand, TABLE,
                                    sensors, errors=errors, contact=contact)
    read = (sensors.torque_noise_Nm**2 + sensors.torque_step_Nm**2 / 12.0
            ) / sensors.tension_readings
    for i in map(tuple, stopped):
        finger, drives = i[3], len(hand.drives[i[3]])
        model = hand.model.fingers[finger]
        q = felt.q_rad[i][:drives]
        step = felt.step[i]
        went = np.round(commands[finger, step] - commands[finger, step - 1], 12)[:drives]
        torque = felt.torque_Nm[i][:drives] - sensors.torque_friction_Nm * np.sign(went)
        sigma = np.sqrt(read + (0.03 * np.abs(torque).max()) ** 2
                        + (errors.moment_arm_share * torque) ** 2 + 5e-4**2)
        limits = np.array([(model.joints[j].low_rad, model.joints[j].high_rad)
                           for j in hand.drives[finger]]).T
        sigma[np.minimum(q - limits[0], limits[1] - q) < 3.0 * sensors.joint_noise_rad] = 1e150
        pose = matrix_of(tuple(POSES[i[0]]))
        energy = ReferenceChain(body_from_name("block"), hand, TABLE, pose, finger, contact)
        frames = pose @ link_frames_of(hand, finger, felt.q_rad[i])
        last, longest, skins = len(model.joints) - 1, 0.0, []
        for c, (capsule, joint) in enumerate(zip(hand.capsules[finger],
                                                 hand.capsule_joint[finger], strict=True)):
            frame = frames[joint]
            ends = np.array([capsule.start, capsule.end]) @ frame[:3, :3].T + frame[:3, 3]
            longest = max(longest, float(np.linalg.norm(ends[1] - ends[0])))
            skins.append(Skin(
                joint, ends, capsule.radius, frame[:3, :3] @ palmar_sides(hand)[finger][c],
                affine_lever(partial(energy.lever, c, q=q)), (1.0, -1.0) if joint == last else ()))
        stiffness = np.array([model.joints[j].stiffness_Nm_rad for j in hand.drives[finger]])
        told = posterior(skins, torque, sigma, friction, hand.links, went, stiffness, 1e-9)
        lever = np.linalg.norm(told.mean - frames[0, :3, 3])
        spread = ((longest / ALONG) ** 2 / 12.0
                  + place_variance(errors, ArmTable(), longest_link_m(hand))
                  + 2.0 * (sensors.joint_noise_rad**2 + errors.joint_offset_rad**2) * lever**2)
        np.testing.assert_allclose(found.point_m[i], told.mean, atol=1e-6)
        np.testing.assert_allclose(found.covariance_m2[i], told.covariance + spread * np.eye(3),
                                   atol=1e-8)
        np.testing.assert_allclose(found.normal[i], told.normal, atol=1e-4)
        np.testing.assert_allclose(found.link_weight[i], told.link_weight, atol=1e-4)
        if single:
            assert found.link[i] == np.argmax(told.link_weight)


@pytest.mark.parametrize("kind", ["allegro", "leap", "barrett"])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_every_contact_has_a_place(kind: str, friction: float) -> None:
    """Of any torques: a huge force hardly beside a joint, at no place of the grid, does not leave
    out all places."""
    hand, n = chain_of(hand_of_kind(kind)), 400
    commands = chain_commands(hand, "curl40")
    felt, _ = close(hand, "small_cylinder", POSES[:1], commands, QUIET)
    rng, shape = np.random.default_rng(0), (n, 1, 1, hand.fingers)
    q = np.zeros((*shape, hand.width))
    for f, own in enumerate(hand.drives):
        for d, j in enumerate(own):
            joint = hand.model.fingers[f].joints[j]
            q[..., f, d] = rng.uniform(joint.low_rad + 0.05, joint.high_rad - 0.05, (n, 1, 1))
    felt = replace(felt, status=np.ones(shape, int), step=np.zeros(shape, int), q_rad=q,
                   torque_Nm=rng.uniform(-0.3, 0.3, q.shape))
    found = estimate_chain_contacts(
        felt, np.repeat(POSES[:1, None], n, axis=0), commands[None], ArmTable(), hand, TABLE, QUIET,
        contact=replace(ALONE, friction=friction))
    assert np.isfinite(found.point_m).all()
    np.testing.assert_allclose(found.link_weight.sum(-1), 1.0, rtol=1e-12)
