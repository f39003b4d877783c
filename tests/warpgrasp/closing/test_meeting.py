"""Fingers that meet: they stop at one another and at the palm, and the robot can tell."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp

from strategies.poses.hand_poses import waypoint_poses
from strategies.procedures.containment import padded_commands
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior
from sweeps.validate.reference_finger import (
    OVERLAP_M,
    FingerEnergy,
    link_overlap,
    overlap_beyond_skin,
)
from warpgrasp.closing import closing
from warpgrasp.closing.closing import Closing, ClosingTruth, close_fingers
from warpgrasp.closing.closing_record import ClosingRow, ClosingTruthRow
from warpgrasp.closing.near_kernel import pairs_that_may
from warpgrasp.core.random import counter_key
from warpgrasp.core.struct_array import Records, record_type
from warpgrasp.finger.path_record import PathStep
from warpgrasp.finger.path_table import path_on_device
from warpgrasp.geometry.body import Body, Part, scene_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.mechanism.arm_motion import ArmState, move_hand
from warpgrasp.mechanism.calibration import (
    draw_calibration,
    no_errors,
    true_hands,
    true_tendons,
)
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
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

HAND = HandTable()
COMMANDS, COUNT = padded_commands(("curl40", "together"))


def close(name: str, contact: ContactTable, *, worlds: int = 8, errors: ErrorTable | None = None,
          sensors: SensorTable | None = None) -> tuple[Closing, ClosingTruth, np.ndarray]:
    """Closings of `ring18` about a body, with the true hand poses."""
    key = counter_key(5, np.arange(worlds))
    body, pose = body_from_name(name), place_objects(ObjectTable(), key)
    given = draw_prior(body, pose, ObjectTable(), key)
    hands = waypoint_poses(STRATEGIES["ring18"].waypoints, given, HAND, key)
    scene, none = scene_of([body], "cpu"), np.zeros(1, int)
    moves, actual = move_hand(scene, none, pose, ArmTable(), HAND, key, ArmState.home(worlds),
                              hands, np.ones(hands.shape[:2], bool), COMMANDS)
    drawn = draw_calibration(errors or ErrorTable.none(), key)
    felt, truth = close_fingers(scene, none, pose, HAND, sensors or SensorTable(), key,
                                moves.status, actual, COMMANDS, COUNT, contact=contact,
                                errors=drawn)
    return felt, truth, actual


def overlap(q_rad: np.ndarray, hand_pose: np.ndarray) -> np.ndarray:
    """How deep links of fingers are in those of others [m], (world, probe, grasp)."""
    return link_overlap(HAND, np.repeat(hand_pose.reshape(-1, 7), q_rad.shape[2], 0),
                        q_rad.reshape(-1, 4, 4)).reshape(q_rad.shape[:3])


@pytest.mark.parametrize(("name", "friction"), [
    ("funnel", 0.0), ("block", 0.0), ("wine_bottle", 0.0), ("block", 0.5)])
def test_no_links_overlap_at_rest(name: str, friction: float) -> None:
    felt, truth, poses = close(name, ContactTable(friction=friction))
    made = felt.status[..., 0] != ProbeStatus.COLLISION
    made &= np.isfinite(truth.rest_rad).all((-1, -2))
    _, through, _ = close(name, ContactTable(self_contact=False))
    before = overlap(np.nan_to_num(through.rest_rad), poses)[made]
    after = overlap(np.nan_to_num(truth.rest_rad), poses)[made]
    assert (before > 2e-3).mean() > 0.05
    assert (after > OVERLAP_M).sum() == 0


def test_fingers_that_never_come_near_close_as_they_did() -> None:
    felt, truth, _ = close("large_cylinder", ContactTable())
    alone_felt, alone, _ = close("large_cylinder", ContactTable(self_contact=False))
    stopped = (alone_felt.status == ProbeStatus.CONTACT).all(-1)  # all four at the cylinder
    assert stopped.sum() > 50
    np.testing.assert_array_equal(felt.step[stopped], alone_felt.step[stopped])
    np.testing.assert_array_equal(truth.q_rad[stopped], alone.q_rad[stopped])
    np.testing.assert_array_equal(felt.tension_N[stopped], alone_felt.tension_N[stopped])


def test_what_found_nothing_stops_at_itself() -> None:
    """A hand that closes on air: fingers at the thumb or at the palm, no point on the object."""
    _, truth, _ = close("block", ContactTable())
    alone, _, _ = close("block", ContactTable(self_contact=False))
    air = (alone.status == ProbeStatus.NO_CONTACT).all(-1)
    assert air.sum() > 20
    assert truth.self_contact[air].mean() > 0.95
    assert (truth.link[air][truth.self_contact[air]] == -1).all()
    assert np.isnan(truth.point_m[truth.self_contact]).all()


def test_a_finger_is_read_where_it_stops() -> None:
    """One that stopped at the object is pushed later by one that closes on it: that it does not
    read, though it rests elsewhere then."""
    felt, truth, _ = close("block", ContactTable())
    alone_felt, alone, _ = close("block", ContactTable(self_contact=False))
    stopped = (alone.link >= 0) & (felt.step == alone_felt.step) & ~truth.self_contact
    pushed = stopped & (np.abs(truth.rest_rad - truth.q_rad).max(-1) > 1e-3)
    assert pushed.any()
    np.testing.assert_allclose(truth.q_rad[pushed], alone.q_rad[pushed], atol=1e-9)


@pytest.mark.parametrize(("name", "friction"), [("block", 0.0), ("wedge", 0.5)])
def test_fingers_that_have_stopped_keep_bearing_while_others_close(
    name: str, friction: float
) -> None:
    """On convex bodies, too: the body does not give way when a hand is closed together."""
    felt, truth, _ = close(name, ContactTable(friction=friction))
    stopped = (felt.status == ProbeStatus.CONTACT) & (truth.link >= 0)
    command = np.stack([COMMANDS[np.arange(2)[:, None], np.arange(4), np.minimum(
        step, COMMANDS.shape[2] - 1)] for step in felt.step.reshape(-1, 2, 4)]).reshape(
            *felt.step.shape, 4)
    bore, bears = (np.abs(command - q)[..., 1:].max(-1)[stopped]
                   for q in (truth.q_rad, truth.rest_rad))
    moved = np.abs(truth.rest_rad - truth.q_rad).max(-1)[stopped] > 1e-3
    assert moved.sum() > 5  # pushed by fingers that came later
    assert (bears > 0.3 * bore).mean() > 0.995


@wp.kernel(enable_backward=False)
def _pairs_kernel(  # type: ignore
    hands: wp.array2d[Hand], sensors: wp.array2d[TendonSensor],  # type: ignore
    path: wp.array3d[PathStep], felt: wp.array4d[ClosingRow],  # type: ignore
    truth: wp.array4d[ClosingTruthRow], pairs: wp.array3d[int],  # type: ignore
):
    w, p, g = wp.tid()
    pairs[w, p, g] = pairs_that_may(hands, sensors, w % hands.shape[0], w % sensors.shape[0], path,
                                    felt, truth, w, p, g)


def test_errors_of_flexion_bring_no_neighbours_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fingers beside one another meet by abduction alone: with errors of calibration hardly more of
    them are followed together than without."""
    found: list[int] = []
    neighbours = sum(1 << (5 * one + one + 1) for one in range(2))  # of `pair_bit`

    def counted(near: np.ndarray, given: dict[str, Any], *others: Any) -> None:
        pairs = wp.zeros(near.shape, dtype=int, device="cpu")
        wp.launch(_pairs_kernel, near.shape, [given[n] for n in (
            "hands", "sensors", "path", "felt", "truth")], [pairs], device="cpu")
        found.append(int(((pairs.numpy() & neighbours) != 0).sum()))

    monkeypatch.setattr(closing, "_resolve", counted)
    for errors in (ErrorTable.none(), ErrorTable()):
        close("block", ContactTable(), errors=errors)
    assert found[1] <= 0.05 * 8 * 18 * 2 + found[0]


def test_a_finger_that_hangs_sideways_by_its_weight_may_meet_the_one_beside_it() -> None:
    """A hand on its side, one of its straight fingers held: the next sinks to it by its torque
    about the joint of abduction. It then curls, so that its last joints tell nothing of it."""
    heavy = replace(HAND, link_density_kg_m3=5000.0)
    length, radius = np.array(heavy.link_length_m), heavy.link_radius_m
    weight = 9.81 * heavy.link_density_kg_m3 * np.pi * radius**2 * (length + 4 / 3 * radius)
    lever = heavy.abduction_offset_m + length.cumsum() - length / 2
    turn = float(weight @ lever) / heavy.joint_stiffness_Nm_rad
    sinks = (heavy.abduction_offset_m + length.sum()) * np.sin(turn)
    hand = replace(heavy, finger_spacing_m=2 * radius + 0.95 * sinks)
    commands = np.zeros((1, 4, 10, 4))
    commands[..., 1:] = np.radians(np.linspace(0.0, 60.0, 10))[:, None]
    rows = np.zeros((1, 1, 1, 4), record_type(ClosingRow))
    truths = np.zeros(rows.shape, record_type(ClosingTruthRow))
    rows["step"], truths["q"], truths["touched"] = 9, commands[:, :, 9], -1
    felt, truth = (Records(kind, values, "cpu") for kind, values in (
        (ClosingRow, rows), (ClosingTruthRow, truths)))
    for contact, may in ((ContactTable(), 1), (ContactTable(weight=False), 0)):
        pairs = wp.zeros((1, 1, 1), dtype=int, device="cpu")
        wp.launch(_pairs_kernel, pairs.shape, [
            true_hands(hand, contact, no_errors(), "cpu"),
            true_tendons(hand, SensorTable(), contact, no_errors(), "cpu"),
            path_on_device(hand, contact, no_errors(), commands, "cpu")[0], felt.array,
            truth.array], [pairs], device="cpu")
        assert pairs.numpy().item() >> 1 & 1 == may  # the bit of fingers 0 and 1


def test_a_finger_that_stopped_on_an_edge_holds_its_command() -> None:
    """At this pose the thumb's reading at an edge of the wedge grazes the threshold. A step later
    it would slip off the edge and close on, through the finger that comes to meet it."""
    body = body_from_name("wedge")
    pose = np.array([[0.0163, 0.0078, 0.1225, 0.363, 0.9314, -0.0219, -0.0157]])
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:])
    sensors = SensorTable(tendon_threshold_N=12.0, tension_noise_N=0.0, tension_step_N=0.0,
                          joint_noise_rad=0.0)
    felt, truth = close_fingers(
        scene_of([body], "cpu"), np.zeros(1, int), np.array([[0, 0, 0, 0, 0, 0, 1.0]]), HAND,
        sensors, np.zeros(1, np.uint64), np.full((1, 1, 1), int(ProbeStatus.CONTACT)), pose[None],
        COMMANDS[:1], COUNT[:1], contact=ContactTable(friction=0.0))
    rest, commands = truth.rest_rad[0, 0, 0], COMMANDS[0, np.arange(4), felt.step[0, 0, 0]]
    assert np.isclose(np.degrees(rest), np.degrees(commands), atol=8.0).all()
    assert overlap(truth.rest_rad, pose[None])[0, 0, 0] < OVERLAP_M


def test_links_that_overlap_are_as_deep_as_the_force_between_them_presses() -> None:
    """At this pose, and the highest threshold, the thumb pushes a finger sideways, which tendons do
    not feel: with 7 N, under which two skins give 0.7 mm. The force is that of the joints of a
    finger that touches nothing else; were the rest not one, or a pair of links not known to touch,
    the overlap would be another."""
    angle = np.linspace(0.0, np.pi, 400)
    profile = np.stack([0.05 * (1.0 - np.cos(angle)), 0.03 * np.sin(angle)], 1)
    body = Body("ellipsoid", (Part(Shape.REVOLUTION, profile_m=profile),), (-0.03, -0.03, 0.0),
                (0.03, 0.03, 0.1))
    pose = np.array([[0.03292, -0.02467, 0.12534, -0.88318, 0.0679, 0.26146, 0.38344]])
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:])
    sensors = SensorTable(tendon_threshold_N=12.0, tension_noise_N=0.0, tension_step_N=0.0,
                          joint_noise_rad=0.0)
    contact = ContactTable(friction=0.0)
    felt, truth = close_fingers(
        scene_of([body], "cpu"), np.zeros(1, int), np.array([[0, 0, 0, 0, 0, 0, 1.0]]), HAND,
        sensors, np.zeros(1, np.uint64), np.full((1, 1, 1), int(ProbeStatus.CONTACT)), pose[None],
        COMMANDS[:1], COUNT[:1], contact=contact)
    rest, commands = truth.rest_rad[0, 0, 0], COMMANDS[0, np.arange(4), felt.step[0, 0, 0]]
    fingers = [FingerEnergy(body, HAND, pose[0], f, contact) for f in range(4)]
    deep = float(overlap(truth.rest_rad, pose[None])[0, 0, 0])
    assert 0.6e-3 < deep < 0.75e-3
    assert abs(overlap_beyond_skin(fingers, rest, commands)) < 1e-6
    assert overlap_beyond_skin(fingers, rest, rest) > 0.9 * deep  # servos that bear nothing
