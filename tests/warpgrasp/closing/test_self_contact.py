"""Which stops a robot takes for its own fingers and palm: those that pressing on them explains."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
import warp as wp

from strategies.poses.hand_poses import waypoint_poses
from strategies.procedures.containment import padded_commands
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior
from warpgrasp.chain.chain_hand import ChainHand, chain_of, hand_of_kind
from warpgrasp.chain_closing.chain_self_contact import chain_self_contacts
from warpgrasp.closing.closing import Closing
from warpgrasp.closing.self_contact import MISFIT, doubt_of, self_contacts
from warpgrasp.core.dtypes import real, vec4
from warpgrasp.core.random import counter_key
from warpgrasp.hand_rest.press_kernel import Doubt, press_misfit, pushed_turn
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    ObjectTable,
    SensorTable,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth

HAND, SENSORS, ERRORS = HandTable(), SensorTable(), ErrorTable()
NOISY = replace(SENSORS, joint_noise_rad=radians(2.0))
WORLDS = 6


def stops(name: str, hand: HandTable, sensors: SensorTable = SENSORS, errors: ErrorTable = ERRORS
          ) -> tuple[np.ndarray, np.ndarray]:
    """Of all stops of grasps about an object, those truly at it and those truly at the hand itself:
    which of them the robot takes for its own links."""
    key = counter_key(7, np.arange(WORLDS))
    body, pose = body_from_name(name), place_objects(ObjectTable(), key)
    truth = Truth(pose)
    robot = Robot([body], np.zeros(WORLDS, int), truth, key, ArmTable(), hand, sensors,
                  errors=errors)
    poses = waypoint_poses(STRATEGIES["rim6-ring12"].waypoints,
                           draw_prior(body, pose, ObjectTable(), key), hand, key)
    found = robot.grasp(poses, np.ones(poses.shape[:2], bool),
                        *padded_commands(("curl40", "together"), hand)).closing
    met, at = truth.closings[0].self_contact, truth.closings[0].link >= 0
    told = found.status == ProbeStatus.SELF_CONTACT
    stopped = told | (found.status == ProbeStatus.CONTACT)
    return told[stopped & at & ~met], told[stopped & met]


@pytest.mark.parametrize(("hand", "sensors", "errors", "most", "least"), [
    (HAND, SENSORS, ERRORS, 0.01, 0.98),
    (HAND, NOISY, ERRORS, 0.2, 0.96),
    (HAND, SENSORS, replace(ERRORS, scale=3.0), 0.03, 0.98),
    (replace(HAND, link_radius_m=0.012), SENSORS, ERRORS, 0.02, 0.98),
    (replace(HAND, finger_spacing_m=0.020), SENSORS, ERRORS, 0.02, 0.98),
    (replace(HAND, kind="allegro"), SENSORS, ERRORS, 0.02, 0.98),
    (replace(HAND, kind="allegro"), NOISY, ERRORS, 0.15, 0.98),
    pytest.param(replace(HAND, kind="leap"), SENSORS, ERRORS, 0.07, 0.98,
                 marks=pytest.mark.slow)],
    ids=["utah_mit", "noise", "errors", "thick", "narrow", "allegro", "allegro noise", "leap"])
def test_contacts_on_an_object_are_kept_and_meetings_told(
    hand: HandTable, sensors: SensorTable, errors: ErrorTable, most: float, least: float
) -> None:
    """Also where the hand's own build keeps fingers nearer to one another than they are known."""
    at_object, at_itself = stops("small_cylinder", hand, sensors, errors)
    assert len(at_object) > 150
    assert len(at_itself) > 50
    assert at_object.mean() <= most
    assert at_itself.mean() >= least


def test_a_hand_whose_fingers_do_not_meet_keeps_its_contacts() -> None:
    for errors in (ERRORS, replace(ERRORS, scale=0.0)):
        at_object, at_itself = stops("small_cylinder", replace(HAND, kind="barrett"), errors=errors)
        assert len(at_object) > 200
        assert len(at_itself) == 0
        assert at_object.mean() < 0.01


def test_steps_are_of_the_commands() -> None:
    """Commands were read from anywhere in memory."""
    shape = 1, 1, 1, 4
    closing = Closing(np.full(shape, int(ProbeStatus.CONTACT)), np.full(shape, 9),
                      np.zeros((*shape, 4)), np.zeros((*shape, 4, 2)), np.zeros(shape))
    pose = np.array([[[0.45, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]]])
    self_contacts(closing, pose, np.zeros((1, 4, 10, 4)), HAND, SENSORS, ERRORS)
    for step in (10, -2):
        wrong = replace(closing, step=np.full(shape, step))
        with pytest.raises(ValueError, match=f"closing.step {step}: wants -1 to 9"):
            self_contacts(wrong, pose, np.zeros((1, 4, 10, 4)), HAND, SENSORS, ERRORS)


@pytest.mark.parametrize("chain", [None, chain_of(hand_of_kind("utah_mit"))],
                         ids=["own", "chain"])
@pytest.mark.parametrize(("step", "noisy"), [(3, True), (4, True), (5, False)])
def test_the_noise_of_another_finger_counts_once_it_has_stopped(
    chain: ChainHand | None, step: int, noisy: bool
) -> None:
    """A finger that stopped straight at step 4, the one beside it leaning over by an angle: the
    variance of the gap is that of both places, and of noise in the other's joint alone."""
    sensors = replace(SENSORS, joint_noise_rad=radians(1.0))
    lean = np.linspace(0.0, 0.1, 101)  # one of each grasp
    shape, errors = (1, 1, len(lean), 4), ErrorTable.none()
    q = np.zeros((*shape, 4))
    q[0, 0, :, 0, 0] = lean
    status, steps = np.full(shape, int(ProbeStatus.NO_CONTACT)), np.full(shape, 4)
    status[..., 1], steps[..., 0] = ProbeStatus.CONTACT, step
    closing = Closing(status, steps, q, np.zeros((*shape, 4, 2)), np.zeros(shape))
    given = (closing, np.array([[[0.45, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]]]),
             np.repeat(q[0, 0, :, :, None], 6, axis=2))
    told = (self_contacts(*given, HAND, sensors, errors, contact=ContactTable.none())
            if chain is None else
            chain_self_contacts(*given, chain, HAND, sensors, errors, contact=ContactTable.none()))
    long = HAND.abduction_offset_m + sum(HAND.link_length_m)
    gap = HAND.finger_spacing_m - long * np.sin(lean) - 2 * HAND.link_radius_m
    doubt = doubt_of(sensors, errors, np.array(HAND.link_length_m))
    joints = 2 * doubt.zero + noisy * doubt.reading
    variance = 2 * doubt.place + joints * (long * np.cos(lean)) ** 2
    near = gap**2 < MISFIT * variance
    assert 10 < near.sum() < 90
    np.testing.assert_array_equal(told[0, 0, :, 1], near)


@wp.kernel(enable_backward=False)
def _misfit_kernel(  # type: ignore
    apart: wp.array[real], turned: wp.array[vec4], doubt: Doubt,  # type: ignore
    misfit: wp.array[real],  # type: ignore
):
    i = wp.tid()
    away = vec4(real(0.0), real(0.1), real(0.05), real(0.0))
    k = real(2.0)
    far = vec4(real(1.0), real(1.0), real(1.0), real(1.0))
    give = pushed_turn(away, vec4(k, k, k, k), vec4(), -far, far, real(200.0))
    misfit[i] = press_misfit(  # type: ignore
        apart[i], real(0.016), real(4e-6), away, give, turned[i], doubt)


def test_a_press_explains_overlap_turn_and_its_way() -> None:
    doubt = Doubt()
    doubt.turn = 1e-4
    press = 0.5 * np.array([0.0, 0.1, 0.05, 0.0]) * 0.8  # of 0.8 N [rad], which lift by 5 mm
    cases = {
        "it presses": (0.011, press), "the other gives, too": (0.008, press),
        "4 mm short of it": (0.015, press), "16 mm short of it": (0.027, press),
        "turned towards it": (0.011, -press), "turned aside": (0.011, press[[1, 0, 3, 2]] * 2.0),
        "free, at it": (0.016, 0.0 * press)}
    misfit = wp.zeros(len(cases), dtype=real, device="cpu")
    wp.launch(_misfit_kernel, len(cases), [
        wp.array([apart for apart, _ in cases.values()], dtype=real, device="cpu"),
        wp.array([turned for _, turned in cases.values()], dtype=vec4, device="cpu"), doubt],
        [misfit], device="cpu")
    found = dict(zip(cases, misfit.numpy(), strict=True))
    assert found["it presses"] == pytest.approx(0.0, abs=1e-6)
    assert found["the other gives, too"] == pytest.approx(0.0, abs=1e-6)
    assert found["free, at it"] == pytest.approx(0.0, abs=1e-6)
    # The least of (gap / 2 mm)^2 and of what is left of the turn, for each force.
    force = np.linspace(0.0, 3.0, 3001)
    give = 0.5 * np.array([0.0, 0.1, 0.05, 0.0])
    for name in ("4 mm short of it", "16 mm short of it", "turned towards it", "turned aside"):
        apart, turned = cases[name]
        gap = np.maximum(apart - 0.016 + 0.00625 * force, 0.0)
        left = ((turned - give * force[:, None]) ** 2).sum(1)
        doubtful = 1e-4 + (turned**2).sum() * 4e-6 / max(apart, 0.016) ** 2
        assert found[name] == pytest.approx((gap**2 / 4e-6 + left / doubtful).min(), rel=1e-3)
    assert found["16 mm short of it"] > 30.0


@wp.kernel(enable_backward=False)
def _pushed_kernel(  # type: ignore
    away: wp.array[vec4], free: wp.array[vec4], turn: wp.array[vec4]  # type: ignore
):
    i = wp.tid()
    k = real(2.0)
    one = vec4(real(1.0), real(1.0), real(1.0), real(1.0))
    turn[i] = pushed_turn(away[i], vec4(k, k, k, k), free[i], -one, one, real(200.0))  # type: ignore


def test_a_joint_that_is_pushed_into_its_stop_hardly_turns() -> None:
    """At its upper or its lower stop; out of it, it turns as its servo lets it."""
    free = np.array([-0.99, -0.5, 0.5, 0.99])
    away = np.array([[1.0, 1.0, 1.0, 1.0], [-1.0, -1.0, -1.0, -1.0]]) * 0.1
    turn = wp.zeros(2, dtype=vec4, device="cpu")
    wp.launch(_pushed_kernel, 2, [
        wp.array(away, dtype=vec4, device="cpu"),
        wp.array(np.tile(free, (2, 1)), dtype=vec4, device="cpu")], [turn], device="cpu")
    stiffness = np.full((2, 4), 2.0)
    stiffness[0, 3] += 200.0
    stiffness[1, 0] += 200.0
    np.testing.assert_allclose(turn.numpy(), away / stiffness, rtol=1e-12)
