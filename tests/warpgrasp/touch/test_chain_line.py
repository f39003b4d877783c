"""Guarded lines of hands of chains: the same as the Utah-MIT's own, and what geometry says."""

from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.poses.postures import extended_finger, poking_pose
from warpgrasp.chain.chain_hand import capsule_ends, chain_of, drive_angles
from warpgrasp.chain.chain_pads import own_pads
from warpgrasp.chain.chain_postures import chain_extended, pad_axes
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.export.model_tree import hand_model_tree
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_frames import posture_angles
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    PadTable,
    SensorTable,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth
from warpgrasp.touch.line_touch import LineTouch

INWARD, DOWN = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
QUIET = PadTable(noise_counts=0.0, gain_spread=0.0, repeatability=0.0, dead_fraction=0.0)
FACE_M = 0.42
"""Where the block's near face stands."""
OTHERS = ("allegro", "leap", "barrett")


def poke(kind: str, gap: float = 0.01, *, errors: ErrorTable | None = None,
         contact: ContactTable | None = None, worlds: int = 1, height: float = 0.09
         ) -> tuple[Robot, Truth, LineTouch]:
    """One finger against the block's near face, on a floating wrist without errors of its own."""
    truth = Truth(np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (worlds, 1)))
    exact = errors is None
    robot = Robot(
        [body_from_name("block")], np.zeros(1, int), truth,
        np.arange(worlds).astype(np.uint64) + np.uint64(99),
        ArmTable(kind="none", encoder_step_rad=0.0, repeatability_m=0.0), HandTable(kind=kind),
        SensorTable(joint_noise_rad=0.0) if exact else SensorTable(),
        pads=QUIET if exact else PadTable(), errors=errors or ErrorTable.none(),
        contact=contact or ContactTable.none())
    one = extended_finger(robot.hand, robot.pads)
    pose = poking_pose(one, np.array([FACE_M - gap, 0.0, height]), INWARD, DOWN)
    return robot, truth, robot.guarded_line(
        np.arange(worlds), np.tile(pose, (worlds, 1)), np.tile(INWARD, (worlds, 1)),
        interval_m=0.001, steps=30, finger=one.finger, commands_rad=one.commands_rad)


def test_the_utah_mit_hand_as_a_chain_feels_the_same() -> None:
    """Its own mathematics, for parallel axes, against a chain's: one algorithm, two fingers."""
    file = resources.files("warpgrasp.hands") / "data" / "utah_mit.toml"
    own = poke("utah_mit", contact=ContactTable(friction=0.0))
    one = extended_finger(own[0].hand, QUIET)
    robot = Robot([body_from_name("block")], np.zeros(1, int), Truth(own[1].body_pose),
                  np.array([99], np.uint64), own[0].arm, HandTable(kind=str(file)),
                  own[0].sensors, pads=QUIET, errors=ErrorTable.none(),
                  contact=ContactTable(friction=0.0))
    pose = poking_pose(one, np.array([FACE_M - 0.01, 0.0, 0.09]), INWARD, DOWN)
    touch = robot.guarded_line(np.zeros(1, int), pose[None], INWARD[None], interval_m=0.001,
                               steps=30, finger=one.finger, commands_rad=one.commands_rad)
    theirs = own[2]
    assert theirs.status[0] == touch.status[0] == ProbeStatus.CONTACT
    assert theirs.steps[0] == touch.steps[0]
    np.testing.assert_allclose(touch.q_rad, theirs.q_rad, atol=2e-5)
    np.testing.assert_allclose(touch.point_m, theirs.point_m, atol=2e-5)
    np.testing.assert_allclose(touch.normal, theirs.normal, atol=2e-3)
    assert np.abs(touch.image.astype(int) - theirs.image.astype(int)).max() <= 1
    assert touch.image.max() > QUIET.threshold_counts


@pytest.mark.parametrize("kind", OTHERS)
def test_a_line_ends_where_the_ball_of_the_tip_meets_the_face(kind: str) -> None:
    robot, truth, touch = poke(kind)
    one = extended_finger(robot.hand, robot.pads)
    assert touch.status[0] == ProbeStatus.CONTACT
    last = len(chain_of(hand_named(kind)).model.fingers[one.finger].joints) - 1
    assert touch.link[0] == last
    assert touch.steps[0] in (11, 12)
    assert 0.0 < touch.tip_m[0, 0] + one.ball_m - FACE_M < 1e-3
    assert touch.point_m[0, 0] == pytest.approx(FACE_M, abs=3e-4)
    # Along the face within half a taxel of the pad's bend, and its normal as far off.
    np.testing.assert_allclose(touch.point_m[0], truth.lines[0].point_m[0], atol=1.2e-3)
    np.testing.assert_allclose(touch.normal[0], -INWARD, atol=0.09)
    spent = poke(kind, gap=0.04)[2]
    assert spent.status[0] == ProbeStatus.NO_CONTACT
    assert spent.steps[0] == 30


def test_a_hands_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    """A line of a hand's file is that of the hand that ships, whatever the file was before."""
    file = tmp_path / "hand.toml"
    for kind in ("allegro", "leap"):
        shipped = resources.files("warpgrasp.hands") / "data" / f"{kind}.toml"
        file.write_text(shipped.read_text())
        mine, theirs = poke(str(file))[2], poke(kind)[2]
        for name in ("status", "steps", "link", "q_rad", "point_m", "image"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))


@pytest.mark.parametrize("kind", OTHERS)
def test_a_heavy_finger_is_not_taken_for_a_blocked_one(kind: str) -> None:
    """What its weight turns the joints by is known to the robot, and is no touch."""
    errors = ErrorTable()
    touch = poke(kind, errors=errors, contact=ContactTable(friction=0.0), worlds=24)[2]
    assert (touch.status == ProbeStatus.CONTACT).all()
    free = poke(kind, 0.04, errors=errors, contact=ContactTable(friction=0.0), worlds=24)[2]
    assert (free.status == ProbeStatus.NO_CONTACT).all()


def test_rows_of_a_world_do_not_depend_on_its_neighbours() -> None:
    many, one = (poke("leap", errors=ErrorTable(), worlds=n)[2] for n in (3, 1))
    for name in ("status", "point_m", "q_rad", "image", "steps"):
        np.testing.assert_array_equal(getattr(many, name)[:1], getattr(one, name))


@pytest.mark.parametrize("kind", OTHERS)
def test_a_pad_lies_where_mujoco_has_its_link(kind: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    chain = chain_of(hand_named(kind))
    model, pads = chain.model, own_pads(chain, PadTable())
    engine = mujoco.MjModel.from_xml_string(mjcf_text(hand_model_tree(hand_named(kind))))
    data = mujoco.MjData(engine)
    rng = np.random.default_rng(5)
    for _ in range(20):
        q = rng.uniform([j.low_rad for j in model.driven], [j.high_rad for j in model.driven])
        for joint, angle in zip(model.driven, q, strict=True):
            data.qpos[engine.joint(joint.name).qposadr[0]] = angle
        mujoco.mj_kinematics(engine, data)
        drives = drive_angles(chain, q)
        for f, finger in enumerate(model.fingers):
            tip, axes, ball = pad_axes(chain, f, drives[f], pads)
            link = data.body(f"{finger.joints[-1].name}_link")
            capsules = [n for n, j in enumerate(chain.capsule_joint[f])
                        if j == len(finger.joints) - 1]
            end = np.mean([chain.capsules[f][n].end for n in capsules], axis=0)
            assert np.abs(link.xpos + link.xmat.reshape(3, 3) @ end - tip).max() < 1e-9
            np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
            # The face stands off the skin by the pad's thickness at least.
            assert ball >= chain.capsules[f][capsules[0]].radius + pads.thickness_m - 1e-9


@pytest.mark.parametrize("kind", OTHERS)
def test_the_extended_finger_leads_the_rest_of_its_hand(kind: str) -> None:
    """Also where the file names no posture, and it is computed."""
    said = hand_named(kind)
    for model in (said, replace(said, extended=None)):
        chain = chain_of(model)
        one = chain_extended(chain, PadTable())
        assert one is not None
        way = np.cos(one.lean_rad) * one.axes[:, 0] + np.sin(one.lean_rad) * one.axes[:, 2]
        for f in range(chain.fingers):
            last = len(model.fingers[f].joints) - 1
            ends = capsule_ends(chain, f, one.commands_rad[f, 0]) @ way
            for end, capsule, joint in zip(ends, chain.capsules[f], chain.capsule_joint[f],
                                           strict=True):
                if (f, joint) != (one.finger, last):
                    assert end.max() + capsule.radius < one.tip_m @ way + one.ball_m - 0.005


def test_a_posture_of_the_file_is_that_of_the_finger() -> None:
    chain = chain_of(hand_named("allegro"))
    one = chain_extended(chain, PadTable())
    q = posture_angles(chain.model, chain.model.posture("extended"))
    np.testing.assert_array_equal(one.commands_rad[:, 0], drive_angles(chain, q))
    assert Rotation.from_matrix(one.axes).magnitude() < np.radians(6)
