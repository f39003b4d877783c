"""Guarded closing: an analytic contact angle, an independent energy minimum, exact chances."""

from dataclasses import replace
from math import asin, cos, hypot, radians
from pathlib import Path

import numpy as np
import pytest
import trimesh
from false_stops import false_stop_probability
from scipy.optimize import minimize, minimize_scalar
from scipy.stats import norm

from warpgrasp.closing.closing import close_fingers
from warpgrasp.core.kernel_launch import ShapeError, set_thread_count
from warpgrasp.core.random import Purpose, counter_key, counter_normal
from warpgrasp.geometry.body import Body, scene_of
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.objects.mesh_import import body_from_mesh
from warpgrasp.parameters import ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

HAND = HandTable()
QUIET = SensorTable(tension_noise_N=0.0, tension_step_N=0.0, joint_noise_rad=0.0)
CYLINDER = body_from_name("small_cylinder")  # radius 20, height 90 mm
ON_TABLE = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
DEPTH = 0.060  # of the cylinder's rim below the flexion joints


def base_flexion(step_deg: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Straight fingers swung by the base joint alone, -10 to 60 degrees."""
    base = np.radians(np.arange(-10.0, 60.0 + 1e-9, step_deg))
    commands = np.zeros((1, 4, len(base), 4))
    commands[..., 1] = base
    return commands, np.array([len(base)])


def close_on_cylinder(sensors: SensorTable, worlds: int = 1, height: float | None = None,
                      hand: HandTable = HAND, step_deg: float = 0.1, body: Body = CYLINDER):
    """A hand straight above the cylinder, pointing down."""
    z = 0.090 + DEPTH + HAND.abduction_offset_m if height is None else height
    pose = np.tile([0, 0, z, 1, 0, 0, 0.0], (worlds, 1, 1))
    commands, count = base_flexion(step_deg)
    return close_fingers(
        scene_of([body], "cpu"), np.zeros(1, int), np.repeat(ON_TABLE, worlds, 0), hand,
        sensors, np.arange(worlds, dtype=np.uint64), np.ones((worlds, 1, 1), int), pose, commands,
        count, contact=ContactTable.none())


def test_streams_of_a_closing_begin_with_a_purpose_of_their_own() -> None:
    """A probe's number at the level of purposes would share streams with a purpose."""
    noisy = replace(QUIET, joint_noise_rad=1e-3)
    probes = 6
    commands, count = base_flexion(1.0)
    pose = np.tile([0, 0, 0.5, 1, 0, 0, 0.0], (1, probes, 1))  # nothing is there
    felt, truth = close_fingers(
        scene_of([CYLINDER], "cpu"), np.zeros(1, int), ON_TABLE, HAND, noisy,
        np.array([11], np.uint64), np.ones((1, probes, 1), int), pose, commands, count,
        contact=ContactTable.none())
    read = (felt.q_rad - truth.q_rad)[0, :, 0] / 1e-3
    probe, finger, joint = np.ogrid[:probes, :4, :4]
    drawn = counter_normal(counter_key(11, int(Purpose.CLOSING), probe, 0, finger,
                                       int(Purpose.JOINT), joint))
    assert read == pytest.approx(drawn, abs=1e-9)
    assert len(set(Purpose)) == len(Purpose.__members__)


def contact_angle() -> float:
    """Angle at which a straight finger's tip meets the cylinder's side, in its own plane."""
    aside = HAND.palm_gap_m / 2 - 0.020 - HAND.link_radius_m
    return asin(aside / sum(HAND.link_length_m))


def test_the_finger_stops_at_the_analytic_contact_angle() -> None:
    felt, truth = close_on_cylinder(QUIET)
    # The outer fingers pass beside the cylinder: 28 mm off its axis, and it is 20 mm thick.
    assert felt.status[0, 0, 0].tolist() == [2, 1, 2, 1]
    # The finger yields a little: 0.05 N m against 2 N m/rad bends its three joints.
    assert truth.q_rad[0, 0, 0, 1, 1] == pytest.approx(contact_angle(), abs=radians(1.0))
    assert truth.link[0, 0, 0, 1] == 2
    tip_height = 0.090 + DEPTH - sum(HAND.link_length_m) * cos(contact_angle())
    assert np.allclose(truth.point_m[0, 0, 0, 1], [-0.020, 0.0, tip_height], atol=1e-3)
    assert np.allclose(truth.normal[0, 0, 0, 1], [-1, 0, 0])


def test_true_normals_of_a_mesh_are_of_unit_length(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path))
    trimesh.creation.cylinder(0.020, 0.090).export(tmp_path / "can.stl")
    can = body_from_mesh(tmp_path / "can.stl", units="m")
    _, truth = close_on_cylinder(QUIET, body=can)
    lengths = np.linalg.norm(truth.normal[truth.link >= 0], axis=-1)
    assert len(lengths) == 2
    assert np.allclose(lengths, 1.0, rtol=0.0, atol=1e-12)
    lengths = np.linalg.norm(sample_body(can).surface_normal, axis=-1)
    assert np.allclose(lengths, 1.0, rtol=0.0, atol=1e-12)


def gap(place: float, joint: np.ndarray, along: np.ndarray) -> float:
    """Distance from a point of a link to the cylinder in the middle finger's plane (x, down)."""
    beside, above = np.array([-0.020, DEPTH]) - (joint + place * along)
    return min(max(beside, above), 0.0) + hypot(max(beside, 0.0), max(above, 0.0))


def energy(q: np.ndarray, command: np.ndarray) -> float:
    """E(q) of the middle finger, written out anew in its plane."""
    joint = np.array([-HAND.palm_gap_m / 2, 0.0])
    total = 0.5 * HAND.joint_stiffness_Nm_rad * ((command - q) ** 2).sum()
    angle = 0.0
    for bend, length in zip(q, HAND.link_length_m, strict=True):
        angle += bend
        along = np.array([np.sin(angle), np.cos(angle)])
        nearest = min(gap(0.0, joint, along), gap(length, joint, along),
                      minimize_scalar(gap, args=(joint, along), bounds=(0, length),
                                      method="bounded", options={"xatol": 1e-10}).fun)
        total += 0.5 * HAND.skin_stiffness_N_m * max(0.0, HAND.link_radius_m - nearest) ** 2
        joint = joint + length * along
    return total


def test_rest_and_stop_against_an_independent_minimum() -> None:
    """Same step, same torques as scipy's minimum of the energy written out in the test: of every
    tenth step, and of each about the stop."""
    felt, truth = close_on_cylinder(QUIET)
    commands, _ = base_flexion()
    stop = -1
    q = np.zeros(3)
    q[0] = radians(-10.0)
    last = q
    for step, command in enumerate(commands[0, 1, :, 1:]):
        if step % 10 and step < felt.step[0, 0, 0, 1] - 2:
            continue
        start, last = q + command - last, command
        if energy(command, command) == 0.0:
            q = command.copy()
            continue
        q = minimize(energy, start, args=(command,), method="Nelder-Mead",
                     options={"xatol": 1e-10, "fatol": 1e-16, "maxiter": 4000}).x
        torque = HAND.joint_stiffness_Nm_rad * (command - q)
        moving = np.array([1.0, 0.0, 0.0])
        pull = torque / (2 * np.array(HAND.moment_arm_m[1:]))
        difference = ((9 + pull) * (1 + HAND.tendon_friction * moving)
                      - (9 - pull) * (1 - HAND.tendon_friction * moving))
        if np.abs(difference).max() > QUIET.tendon_threshold_N:
            stop = step
            break
    assert felt.step[0, 0, 0, 1] == stop
    assert np.allclose(truth.q_rad[0, 0, 0, 1, 1:], q, atol=1e-5)
    assert np.allclose(truth.torque_Nm[0, 0, 0, 1, 1:], torque, atol=2e-5)


def test_reactions_only_push_and_no_link_is_deeper_than_the_skin_allows() -> None:
    _, truth = close_on_cylinder(QUIET)
    touched = truth.link >= 0
    assert touched.sum() == 2
    assert (truth.torque_Nm[touched][:, 1] > 0).all()
    assert ((truth.normal * truth.point_m)[touched][:, :2].sum(-1) > 0).all()


def test_nothing_in_reach_is_no_contact() -> None:
    felt, truth = close_on_cylinder(QUIET, height=1.0)
    assert (felt.status == ProbeStatus.NO_CONTACT).all()
    assert np.isnan(felt.tension_difference_N).all()
    assert (truth.link == -1).all()


def test_a_threshold_below_friction_stops_at_once_and_without_contact() -> None:
    felt, truth = close_on_cylinder(replace(QUIET, tendon_threshold_N=1.0), height=1.0)
    assert (felt.status == ProbeStatus.CONTACT).all()
    assert (felt.step <= 1).all()  # the first step moves nothing
    assert (truth.link == -1).all()


def test_false_stops_come_as_often_as_their_chance_says() -> None:
    sensors = SensorTable(tendon_threshold_N=2.4)
    chance = false_stop_probability(HAND, sensors, moving=True)
    still = false_stop_probability(HAND, sensors, moving=False)
    felt, _ = close_on_cylinder(sensors, worlds=1500, height=1.0, step_deg=0.5)
    steps = 140
    survive = (1 - chance) ** steps * (1 - still) ** (2 * steps + 3)
    free = (felt.status == ProbeStatus.NO_CONTACT).mean()
    assert free == pytest.approx(survive, abs=4 * np.sqrt(survive * (1 - survive) / 6000))
    stopped = felt.status == ProbeStatus.CONTACT
    assert (np.abs(felt.tension_difference_N[stopped]) > sensors.tendon_threshold_N).all()


def test_the_false_stop_chance_against_drawing_readings() -> None:
    sensors = SensorTable(tendon_threshold_N=1.9, tension_step_N=0.25)
    rng = np.random.default_rng(0)
    flexor = 9 * 1.07 + 0.3 * rng.standard_normal(400_000)
    extensor = 9 * 0.93 + 0.3 * rng.standard_normal(400_000)
    read = 0.25 * (np.floor(flexor / 0.25 + 0.5) - np.floor(extensor / 0.25 + 0.5))
    drawn = (np.abs(read) > 1.9).mean()
    assert false_stop_probability(HAND, sensors, moving=True) == pytest.approx(drawn, abs=0.003)


def test_false_stops_know_the_least_tension() -> None:
    """Co-contraction below it: tendons are taut by the least tension, and rub by that."""
    hand = replace(HAND, tension_low_N=20.0)
    sensors = SensorTable(tendon_threshold_N=3.0, tension_step_N=0.0)
    rest = hand.tension_low_N
    spread = sensors.tension_noise_N * np.sqrt(2.0)
    above, below = ((3.0 + sign * 0.14 * rest) / spread for sign in (-1, 1))
    chance = false_stop_probability(hand, sensors, moving=True)
    assert chance == pytest.approx(norm.sf(above) + norm.sf(below), rel=1e-6)


@pytest.mark.parametrize("more", [-1, 1])
def test_steps_that_there_are_not_are_refused(more: int) -> None:
    path, count = base_flexion()
    wrong = count + 1 if more > 0 else 0 * count
    with pytest.raises(ValueError, match="command_count"):
        close_fingers(scene_of([CYLINDER], "cpu"), np.zeros(1, int), ON_TABLE, HAND, QUIET,
                      np.zeros(1, np.uint64), np.ones((1, 1, 1), int), np.zeros((1, 1, 7)),
                      path, wrong)


def test_each_tendon_has_noise_of_its_own() -> None:
    """Both tendons of abduction, which bears nothing here, are read at the co-contraction."""
    sensors = SensorTable(tension_step_N=0.0)
    felt, _ = close_on_cylinder(sensors, worlds=600)
    read = felt.tension_N[felt.status == ProbeStatus.CONTACT][:, 0] - HAND.co_contraction_N
    assert len(read) == 1200
    sigma = sensors.tension_noise_N / np.sqrt(sensors.tension_readings)
    np.testing.assert_allclose(read.T @ read / 1200 / sigma**2, np.eye(2), atol=5 / np.sqrt(600))


def test_slices_over_threads_change_no_bit() -> None:
    try:
        set_thread_count(1)
        one, truth_one = close_on_cylinder(SensorTable(), worlds=600)
        set_thread_count(2)
        two, truth_two = close_on_cylinder(SensorTable(), worlds=600)
    finally:
        set_thread_count(1)
    assert np.array_equal(one.q_rad, two.q_rad)
    assert np.array_equal(one.tension_N, two.tension_N, equal_nan=True)
    assert np.array_equal(truth_one.point_m, truth_two.point_m, equal_nan=True)


def test_a_wrong_shape_is_refused_by_name() -> None:
    with pytest.raises(ShapeError, match="probe_status"):
        close_fingers(scene_of([CYLINDER], "cpu"), np.zeros(1, int), ON_TABLE, HAND, QUIET,
                      np.zeros(1, np.uint64), np.ones((1, 2, 1), int),
                      np.zeros((1, 1, 7)), *base_flexion())
