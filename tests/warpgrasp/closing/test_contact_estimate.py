"""Believed contacts: torques alone find link and place where the geometry lets them."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from reference_posterior import Skin, affine_lever, posterior

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from sweeps.validate.reference_finger import FingerEnergy
from warpgrasp.closing.closing import Closing
from warpgrasp.closing.contact_estimate import ContactEstimate, estimate_contacts
from warpgrasp.closing.contact_places_kernel import ALONG
from warpgrasp.mechanism.calibration import place_variance
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ContactTable, ErrorTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth

EXACT_ARM = ArmTable(repeatability_m=0.0, encoder_step_rad=0.0)


def grasp_lightbulb(sensors: SensorTable, arm: ArmTable = EXACT_ARM, worlds: int = 40):
    """Hands straight above lightbulbs, off their axes by up to a centimetre."""
    pose = np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (worlds, 1))
    truth = Truth(pose)
    exact = arm is EXACT_ARM
    robot = Robot([body_from_name("lightbulb")], np.zeros(1, int), truth,
                  np.arange(worlds, dtype=np.uint64), arm, HandTable(), sensors,
                  errors=ErrorTable.none() if exact else None,
                  contact=ContactTable.none() if exact else None)
    aside = np.random.default_rng(0).uniform(-0.01, 0.01, (worlds, 2))
    hand = np.zeros((worlds, 1, 7))
    hand[:, 0, 0], hand[:, 0, 1] = 0.45 + aside[:, 0], aside[:, 1]
    hand[:, 0, 2], hand[:, 0, 3] = 0.16, 1.0
    commands = closing_commands(CLOSING_PATHS["curl40"])[None]
    grasps = robot.grasp(hand, np.ones((worlds, 1), bool), commands, np.array([commands.shape[2]]))
    return grasps, truth.closings[0]


def quiet(estimator: str) -> SensorTable:
    return SensorTable(tension_noise_N=0.0, tension_step_N=0.0, joint_noise_rad=0.0,
                       contact_estimator=estimator)


def test_the_touched_link_is_known_from_torques() -> None:
    grasps, truth = grasp_lightbulb(quiet("intrinsic"))
    felt = (grasps.closing.status == ProbeStatus.CONTACT) & (truth.link >= 0)
    assert felt.sum() > 100
    assert (grasps.estimate.link == truth.link)[felt].mean() > 0.95
    assert np.allclose(grasps.estimate.link_weight[felt].sum(-1), 1.0)


def test_intrinsic_beats_fingertip_and_the_axis_passes_one_radius_from_the_contact() -> None:
    errors = {}
    for estimator in ("intrinsic", "fingertip"):
        grasps, truth = grasp_lightbulb(quiet(estimator))
        felt = (grasps.closing.status == ProbeStatus.CONTACT) & (truth.link >= 0)
        errors[estimator] = np.median(np.linalg.norm(
            grasps.estimate.point_m - truth.point_m, axis=-1)[felt])
    assert errors["intrinsic"] < errors["fingertip"]
    grasps, truth = grasp_lightbulb(quiet("intrinsic"))
    joints = grasps.estimate.link_points_m
    on = (grasps.closing.status == ProbeStatus.CONTACT) & (truth.link == 2)
    a, b, p = joints[on][:, 2], joints[on][:, 3], truth.point_m[on]
    share = np.clip(((p - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1), 0, 1)
    away = np.linalg.norm(a + share[:, None] * (b - a) - p, axis=-1)
    assert np.allclose(away, HandTable().link_radius_m, atol=2e-4)  # less the skin's give


def test_covariances_are_symmetric_positive_and_unfelt_fingers_have_none() -> None:
    grasps, _ = grasp_lightbulb(SensorTable(), ArmTable())
    felt = grasps.closing.status == ProbeStatus.CONTACT
    c = grasps.estimate.covariance_m2[felt]
    assert np.allclose(c, np.swapaxes(c, -1, -2))
    assert (np.linalg.eigvalsh(c) > 0).all()
    assert np.isnan(grasps.estimate.point_m[~felt]).all()


def readings(count: int, sensors: SensorTable) -> tuple[Closing, np.ndarray, np.ndarray]:
    """Hands that feel any torques, the bases of half of their fingers at a stop."""
    rng, hand = np.random.default_rng(1), HandTable()
    dims = (count, 1, 1, 4)
    q = rng.uniform(0.2, 1.2, (*dims, 4))
    q[..., 0] = rng.uniform(-0.3, 0.3, dims)
    q[::2, ..., 1] = hand.flexion_low_rad[0]
    half = rng.uniform(-0.15, 0.15, q.shape) / np.array(hand.moment_arm_m)
    closing = replace(
        grasp_lightbulb(sensors, worlds=1)[0].closing, status=np.full(dims, ProbeStatus.CONTACT),
        q_rad=q, tension_N=30.0 + np.stack([half, -half], -1), step=np.zeros(dims, int))
    pose = np.tile([0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0], (count, 1, 1))
    return closing, pose, np.zeros((1, 4, 2, 4))


@pytest.mark.parametrize("sensors", [SensorTable(), quiet("intrinsic")], ids=["noise", "quiet"])
def test_every_contact_has_a_place_that_hardly_depends_on_hardly_any_friction(
    sensors: SensorTable
) -> None:
    """A huge force that turns no joint but for rounding, or by friction of its own, explains
    torques: it does not leave out all places."""
    closing, pose, commands = readings(500, sensors)

    def felt(friction: float) -> ContactEstimate:
        return estimate_contacts(closing, pose, commands, ArmTable(), HandTable(), sensors,
                                 errors=ErrorTable(), contact=ContactTable(friction=friction))

    smooth = felt(0.0)
    for friction in (0.0, 1e-9, 1e-7, 1e-5, 1e-3, 0.5):
        rough = felt(friction)
        assert np.isfinite(rough.point_m).all()
        assert np.isfinite(rough.covariance_m2).all()
        np.testing.assert_allclose(rough.link_weight.sum(-1), 1.0, rtol=1e-12)
        if friction <= 1e-5:
            off = np.linalg.norm(rough.point_m - smooth.point_m, axis=-1)
            sigma = np.sqrt(np.trace(rough.covariance_m2, axis1=-2, axis2=-1))
            assert (off < 0.3 * sigma).all()
            assert np.median(off) < 1e-6


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_an_estimate_is_the_posterior_over_all_places_of_the_skin(friction: float) -> None:
    """Written out in NumPy, with the hand turned any way, some joints at their upper stops and some
    at their lower ones."""
    hand, sensors = HandTable(tendon_friction=0.0), SensorTable()
    errors, contact = ErrorTable(), ContactTable(friction=friction)
    closing, pose, commands = readings(4, sensors)
    closing.step[:] = 1
    commands[0, :, 1] = [[0.0, 0.02, 0.01, 0.0], [0.0, 0.02, 0.0, 0.0], [0.01, 0.0, 0.01, 0.03],
                         [0.0, 0.01, 0.02, 0.02]]
    closing.q_rad[::2, ..., 1] = 0.5
    closing.q_rad[0, ..., 2], closing.q_rad[1, ..., 3] = (
        hand.flexion_high_rad[1], hand.flexion_low_rad[2])
    rng = np.random.default_rng(2)
    pose[..., 3:] = rng.normal(size=pose[..., 3:].shape)
    pose[..., 3:] /= np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
    found = estimate_contacts(closing, pose, commands, ArmTable(), hand, sensors, errors=errors,
                              contact=contact)
    arm = np.array(hand.moment_arm_m)
    read = 2.0 * arm**2 * (sensors.tension_noise_N**2 + sensors.tension_step_N**2 / 12.0
                           ) / sensors.tension_readings
    low = np.array([hand.abduction_limit_rad[0], *hand.flexion_low_rad])
    high = np.array([hand.abduction_limit_rad[1], *hand.flexion_high_rad])
    cell = max(hand.link_length_m) / ALONG
    for world, finger in np.ndindex(4, 4):
        i = world, 0, 0, finger
        q = closing.q_rad[i]
        energy = FingerEnergy(body_from_name("block"), hand, pose[world, 0], finger, contact)
        torque = arm * (closing.tension_N[i] @ [1.0, -1.0]) - energy.drive(q, q)
        sigma = np.sqrt(read + (0.03 * np.abs(torque).max()) ** 2
                        + (errors.moment_arm_share * torque) ** 2 + 5e-4**2)
        held = np.minimum(q - low, high - q) < 3.0 * sensors.joint_noise_rad
        sigma[held] = 1e150
        assert found.torque_Nm[i] == pytest.approx(torque, abs=1e-12)
        assert found.torque_sigma_Nm[i] == pytest.approx(sigma, rel=1e-9)
        places, axes = energy.chain(q)
        skins = []
        for link in range(3):
            way = (places[link + 1] - places[link]) / hand.link_length_m[link]
            skins.append(Skin(
                link, places[link:link + 2], hand.link_radius_m, np.cross(axes[1], way),
                affine_lever(partial(energy.lever, link, q=q)), (1.0,) if link == 2 else ()))
        went = commands[0, finger, closing.step[i]] - commands[0, finger, closing.step[i] - 1]
        told = posterior(skins, torque, sigma, friction, 3, went, np.full(4, 2.0))
        lever = np.linalg.norm(told.mean - places[0])
        spread = (cell**2 / 12.0 + place_variance(errors, ArmTable(), max(hand.link_length_m))
                  + 2.0 * (sensors.joint_noise_rad**2 + errors.joint_offset_rad**2) * lever**2)
        np.testing.assert_allclose(found.point_m[i], told.mean, atol=1e-5)
        np.testing.assert_allclose(found.covariance_m2[i], told.covariance + spread * np.eye(3),
                                   atol=1e-7)
        np.testing.assert_allclose(found.normal[i], told.normal, atol=1e-3)
        np.testing.assert_allclose(found.link_weight[i], told.link_weight, atol=1e-3)
