"""Guarded closing of any hand: an independent energy minimum, the Utah-MIT hand as a chain."""


from dataclasses import replace

import numpy as np
import pytest
import trimesh
import warp as wp
from chain_closings import (
    ALONE,
    ON_TABLE,
    QUIET,
    TABLE,
    close,
    poses_above,
    utah_mit_twice,
)
from reference_chain import ReferenceChain
from scipy.spatial.transform import Rotation

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain import torque_sensor
from warpgrasp.chain.chain_hand import ChainHand, chain_of, chain_rows, hand_of_kind
from warpgrasp.chain.chain_kernel import JOINTS
from warpgrasp.chain.torque_sensor_kernel import TorqueSensor
from warpgrasp.chain_closing import chain_closing
from warpgrasp.chain_closing.chain_closing import close_chains
from warpgrasp.chain_closing.chain_path import no_chain_errors
from warpgrasp.geometry.body import scene_of
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.hands.hand_model import Box, Finger, Follow, HandModel
from warpgrasp.mechanism.calibration import draw_calibration
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ErrorTable
from warpgrasp.probe_status import ProbeStatus


def with_six_joints(model: HandModel) -> HandModel:
    """The hand with fingers of six joints: behind the first one, two that turn a little, about axes
    askew."""
    def more(finger: Finger) -> Finger:
        first, *rest = finger.joints
        extra = [replace(
            first, name=f"{first.name}_{n}", place=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), axis=axis,
            low_rad=-0.3, high_rad=0.3, shapes=(), follows=None)
            for n, axis in enumerate([(0.6, 0.0, 0.8), (0.0, 0.8, -0.6)])]
        return replace(finger, joints=(first, *extra, *rest))

    return replace(model, name="six", fingers=tuple(map(more, model.fingers)))


def with_joints_that_follow(model: HandModel) -> HandModel:
    """The hand with fingers whose last joint turns as the one before it does."""
    def coupled(finger: Finger) -> Finger:
        *others, leader, last = finger.joints
        return replace(finger, joints=(*others, leader, replace(
            last, follows=Follow(leader.name, 0.6, 0.1))))

    return replace(model, name="coupled", fingers=tuple(map(coupled, model.fingers)))


def hand_like(kind: str) -> ChainHand:
    """A hand that ships, or the Allegro with other joints."""
    changed = {"six joints": with_six_joints, "coupled joints": with_joints_that_follow}
    return chain_of(changed[kind](hand_of_kind("allegro")) if kind in changed
                    else hand_of_kind(kind))


@pytest.mark.parametrize("kind", ["allegro", "leap", "barrett"])
def test_a_link_weighs_what_the_shapes_of_its_file_do(kind: str) -> None:
    """Not what the capsules do that it touches with: the Allegro's fingers were by 30 % lighter."""
    model = hand_of_kind(kind)
    hand = chain_of(model)
    joints = chain_rows(hand, TABLE, ALONE, no_chain_errors(hand))[1]["weight"][0]
    for f, finger in enumerate(model.fingers):
        for j, joint in enumerate(finger.joints):
            boxes = [shape for shape in joint.shapes if isinstance(shape, Box)]
            if not boxes or len(boxes) < len(joint.shapes):
                continue
            hull = trimesh.util.concatenate([trimesh.creation.box(
                extents=box.size, transform=matrix_of(box.place)) for box in boxes]).convex_hull
            assert joints[f, j] == pytest.approx(hull.volume * TABLE.link_density_kg_m3 * 9.81,
                                                 rel=1e-3)


@pytest.mark.parametrize("kind", [
    "allegro", "barrett", "coupled joints", pytest.param("leap", marks=pytest.mark.slow),
    pytest.param("six joints", marks=pytest.mark.slow)])
def test_torques_are_in_balance_where_a_finger_stops(kind: str) -> None:
    hand = hand_like(kind)
    commands = chain_commands(hand, "curl40")
    poses = poses_above(12)
    felt, truth = close(hand, "small_cylinder", poses, commands)
    stopped = np.argwhere(truth.link[:, 0, 0] >= 0)
    assert len(stopped) >= 10
    for i, f in stopped[:10]:
        drives = len(hand.drives[f])
        q = truth.q_rad[i, 0, 0, f, :drives]
        command = commands[f, felt.step[i, 0, 0, f], :drives]
        energy = ReferenceChain(body_from_name("small_cylinder"), hand, TABLE,
                                matrix_of(tuple(poses[i])), int(f), ALONE)
        assert energy.slope(q, command) == pytest.approx(0.0, abs=1e-4)
        torque = truth.torque_Nm[i, 0, 0, f, :drives]
        assert torque == pytest.approx(energy.stiffness * (command - q), abs=1e-12)
        bearing = energy.depths(q).max(1).argmax()
        assert hand.capsule_joint[f][bearing] == truth.link[i, 0, 0, f]


@pytest.mark.slow
def test_a_link_flush_with_a_face_rests_where_its_energy_is_least() -> None:
    """Where two places of a capsule are equally near, the slope of the energy jumps."""
    hand = chain_of(hand_of_kind("allegro"))
    commands = chain_commands(hand, "curl40")
    poses = poses_above(12)
    felt, truth = close(hand, "block", poses, commands)
    for i, f in np.argwhere(truth.link[:, 0, 0] >= 0)[:3]:
        q = truth.q_rad[i, 0, 0, f]
        command = commands[f, felt.step[i, 0, 0, f]]
        energy = ReferenceChain(body_from_name("block"), hand, TABLE, matrix_of(tuple(poses[i])),
                                int(f), ALONE)
        best = energy.rest(command, q)
        assert energy.energy(q, command) <= energy.energy(best, command) + 2e-8
        assert q == pytest.approx(best, abs=5e-4)


def test_a_stop_is_the_first_step_whose_torques_pass_the_threshold() -> None:
    """By the independent energy: torques less weight, a step before the stop and there."""
    hand = chain_of(hand_of_kind("allegro"))
    commands = chain_commands(hand, "curl40")
    poses = poses_above(12)
    felt, truth = close(hand, "small_cylinder", poses, commands)
    stopped = np.argwhere(truth.link[:, 0, 0] >= 0)[:2]
    assert len(stopped) == 2
    for i, f in stopped:
        energy = ReferenceChain(body_from_name("small_cylinder"), hand, TABLE,
                                matrix_of(tuple(poses[i])), int(f), ALONE)
        step, q = int(felt.step[i, 0, 0, f]), truth.q_rad[i, 0, 0, f]
        assert np.abs(energy.felt(q)).max() > QUIET.torque_threshold_Nm
        before = energy.rest(commands[f, step - 1], q)
        assert np.abs(energy.felt(before)).max() < QUIET.torque_threshold_Nm


@pytest.mark.parametrize("kind", ["allegro", "barrett", "coupled joints"])
def test_what_is_read_at_a_stop_is_what_servos_bear_less_the_weight_that_is_believed(kind: str
                                                                                     ) -> None:
    """Of links as long as believed, at the angles that are read; times the true sensor's gain."""
    hand, key = hand_like(kind), np.arange(12, dtype=np.uint64)
    commands, poses = chain_commands(hand, "curl40"), poses_above(12)
    errors = draw_calibration(
        replace(ErrorTable.none(), joint_offset_rad=0.03, link_length_share=0.03,
                moment_arm_share=0.05), key, fingers=hand.fingers, joints=JOINTS, links=JOINTS)
    sensors = replace(QUIET, torque_friction_Nm=0.004)
    body = body_from_name("small_cylinder")
    felt, truth = close_chains(
        scene_of([body], "cpu"), np.zeros(1, int), np.tile(ON_TABLE, (12, 1)), hand, TABLE, sensors,
        key, np.ones((12, 1, 1), int), poses[:, None], commands[None],
        np.array([commands.shape[1]]), contact=ALONE, errors=errors)
    stopped = np.argwhere((felt.status == ProbeStatus.CONTACT)[:, 0, 0])
    assert len(stopped) >= 10
    for i, f in stopped[:10]:
        at, drives = (i, 0, 0, f), len(hand.drives[f])
        weight = ReferenceChain(body, hand, TABLE, matrix_of(tuple(poses[i])), int(f), ALONE)
        weight.stiffness, weight.skin, weight.stop = 0.0 * weight.stiffness, 0.0, 0.0
        q = felt.q_rad[at][:drives]
        assert q == pytest.approx(truth.q_rad[at][:drives] + errors.joint_offset_rad[i, f, :drives],
                                  abs=1e-12)
        step = felt.step[at]
        moving = np.sign(np.round(commands[f, step] - commands[f, max(step - 1, 0)], 12))[:drives]
        borne = truth.torque_Nm[at][:drives] - weight.slope(q, q)
        assert felt.torque_Nm[at][:drives] == pytest.approx(
            (1.0 + errors.moment_arm_share[i, f, :drives]) * borne
            + sensors.torque_friction_Nm * moving, abs=1e-7)


def test_a_switch_closes_at_the_first_step_whose_force_on_its_link_suffices() -> None:
    """On the table, too."""
    hand = chain_of(replace(hand_of_kind("allegro"), senses="tip_switches"))
    commands, force = chain_commands(hand, "curl40"), 0.5
    roll = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    turn = Rotation.from_euler("ZYZ", np.stack([0 * roll, 0 * roll + np.pi - 1.2, roll], 1))
    poses = np.column_stack([np.tile([0.5, 0.0, 0.06], (24, 1)), turn.as_quat()])
    sensors = replace(QUIET, switch_force_N=force)
    felt, truth = close(hand, "small_cylinder", poses, commands, sensors)
    stopped = np.argwhere((felt.status == ProbeStatus.CONTACT)[:, 0, 0]
                          & (felt.step > 1)[:, 0, 0])[:4]
    assert len(stopped) == 4
    for i, f in stopped:
        energy = ReferenceChain(body_from_name("small_cylinder"), hand, TABLE,
                                matrix_of(tuple(poses[i])), int(f), ALONE)
        tip = np.array(hand.capsule_joint[f]) == max(hand.capsule_joint[f])
        step = felt.step[i, 0, 0, f]

        def pressed(q: np.ndarray, energy=energy, tip=tip) -> float:
            """Force on the last link [N]."""
            depth = np.maximum(energy.depths(q)[tip], 0.0)
            return float(TABLE.skin_stiffness_N_m * depth.sum())

        assert pressed(truth.q_rad[i, 0, 0, f]) >= force - 1e-4
        before = close(hand, "small_cylinder", poses[[i]], commands[:, :step], sensors)
        assert before[0].status[0, 0, 0, f] == ProbeStatus.NO_CONTACT
        assert pressed(before[1].q_rad[0, 0, 0, f]) < force
    assert truth.on_table[stopped[:, 0], 0, 0, stopped[:, 1]].all()


@pytest.mark.parametrize("kind", ["allegro", "leap", "barrett"])
def test_fingers_that_sink_onto_their_stops_do_not_stop_without_a_touch(kind: str) -> None:
    """The Barrett's spread stands on its stop, which bears what it weighs."""
    hand = chain_of(hand_of_kind(kind))
    commands = chain_commands(hand, "curl40")
    for f, own in enumerate(hand.drives):  # led beyond a stop on the way
        commands[f, 20, 0] = hand.model.fingers[f].joints[own[0]].low_rad - 0.05
    poses = poses_above(40)
    poses[:, 2] += 1.0
    # As much noise as makes every reading be drawn, and one in 1e8 pass the threshold.
    felt, truth = close(hand, "small_cylinder", poses, commands,
                        replace(QUIET, torque_threshold_Nm=0.01, torque_noise_Nm=0.0017))
    assert (truth.link == -1).all()
    assert (felt.status == ProbeStatus.NO_CONTACT).all()


def test_the_utah_mit_hand_closes_alike_as_a_chain() -> None:
    true, truth, both, same = utah_mit_twice(24, ALONE)
    assert both.sum() > 30
    assert (same == both).all()
    assert truth.q_rad[both] == pytest.approx(true.q_rad[both], abs=2e-6)
    assert (truth.link[both] == true.link[both] + 1).all()
    assert truth.point_m[both] == pytest.approx(true.point_m[both], abs=1e-6)


def test_noise_that_may_stop_a_free_finger_is_found_by_its_first_draw(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with the readings of all free steps drawn."""
    hand = chain_of(hand_of_kind("barrett"))
    commands = chain_commands(hand, "curl40")
    poses = poses_above(40)
    poses[:, 2] += 1.0
    loud = replace(QUIET, torque_threshold_Nm=0.03, torque_noise_Nm=0.01, torque_friction_Nm=0.003)
    some = close(hand, "small_cylinder", poses, commands, loud)
    stopped = some[0].status == ProbeStatus.CONTACT
    assert 0.2 < stopped.mean() < 0.98

    def every(*given: object) -> wp.array:
        rows = torque_sensor.true_sensors(*given).numpy()
        assert (rows["suspect"] < 0.9).all()
        rows["suspect"] = 2.0
        return wp.array(rows, dtype=TorqueSensor, device="cpu")

    monkeypatch.setattr(chain_closing, "true_sensors", every)
    drawn = close(hand, "small_cylinder", poses, commands, loud)
    for one, other in zip(some, drawn, strict=True):
        for name in vars(one):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
