"""Foreseen touches are the simulator's, whatever the hand."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from beliefs import BODY, belief

from strategies.foresight import first_touch
from strategies.planners.adaptive import GreedyCoverage
from strategies.planners.candidates import candidate_poses, predicted_touches
from strategies.planners.expected_error import ExpectedError
from strategies.planners.probes import Grasp
from strategies.procedures.containment import padded_commands
from strategies.procedures.possible import NotPossible
from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.recovery.belief import Belief
from warpgrasp.geometry.body import Body, Part
from warpgrasp.geometry.scene import Shape as Solid
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps, Robot, Truth

HANDS = files("warpgrasp.hands") / "data"
AS_CHAIN = HandTable(kind=str(HANDS / "utah_mit.toml"))


def belief_of(hand: HandTable) -> Belief:
    return replace(belief(), hand=hand, arm=ArmTable(kind="none", repeatability_m=0.0))


def grasped(here: Belief, poses: np.ndarray, wanted: np.ndarray) -> tuple[Grasps, Truth]:
    """Guarded closings on the very bodies believed, noise and errors off."""
    bodies = []
    for world in range(2):
        numbers = [float(v) for row in (BODY.size_m, BODY.exponents, BODY.taper, BODY.bend)
                   for v in row[world]]
        x, y, z = (float(v) for v in BODY.position_m[world])
        place = (x, y, z, *(float(v) for v in BODY.quaternion_xyzw[world]))
        part = Part(Solid.SUPERQUADRIC, superquadric=tuple(numbers), place=place)
        r = float(np.linalg.norm(BODY.size_m[world]))
        bodies.append(Body("believed", (part,), (x - r, y - r, z - r), (x + r, y + r, z + r)))
    truth = Truth(np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1)))
    quiet = replace(here.sensors, tension_noise_N=0.0, joint_noise_rad=0.0, torque_noise_Nm=0.0,
                    torque_friction_Nm=0.0)
    robot = Robot(bodies, np.arange(2), truth, np.zeros(2, np.uint64), here.arm, here.hand, quiet,
                  errors=ErrorTable.none())
    return robot.grasp(poses, wanted, *padded_commands(here.closings, here.hand)), truth


@pytest.mark.parametrize("kind", ["utah_mit", "allegro", "leap", "barrett"])
def test_touches_are_foreseen_where_the_simulator_finds_them(kind: str) -> None:
    """Where both touch, the places are near, and few are missed or added. Where a touch is
    foreseen, the open hand comes to its pose."""
    here = belief_of(HandTable(kind=kind))
    poses, reachable = candidate_poses(here)
    points, found = predicted_touches(here, poses, reachable)
    grasps, truth = grasped(here, poses, reachable)
    true = truth.closings[-1].point_m.reshape(points.shape)
    status = grasps.closing.status.reshape(found.shape)
    assert (status[found] != ProbeStatus.COLLISION).all()
    felt = np.isfinite(true).all(-1) & (np.nan_to_num(true[..., 2]) > TABLE_MARGIN_M)
    both = found & felt
    assert both.sum() > 0.94 * felt.sum()
    assert both.sum() > 0.95 * found.sum()
    apart = np.linalg.norm(points - true, axis=-1)[both]
    assert np.median(apart) < 0.003
    assert np.quantile(apart, 0.9) < 0.006


def test_places_of_a_link_are_looked_at_side_by_side_as_one_by_one(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    here = belief_of(HandTable(kind="leap"))
    poses, reachable = candidate_poses(here)
    points, found = predicted_touches(here, poses, reachable)
    monkeypatch.setattr(first_touch, "has_lanes", lambda device: False)
    alone, alone_found = predicted_touches(here, poses, reachable)
    assert found.sum() > 100
    np.testing.assert_array_equal(found, alone_found)
    np.testing.assert_allclose(points, alone, atol=1e-10)


def test_a_hand_described_as_chains_foresees_the_touches_of_its_own_functions() -> None:
    own, chain = belief_of(HandTable()), belief_of(AS_CHAIN)
    poses, reachable = candidate_poses(own)
    points, found = predicted_touches(own, poses, reachable)
    others, others_found = predicted_touches(chain, poses, reachable)
    np.testing.assert_array_equal(others_found, found)
    np.testing.assert_allclose(others, points, atol=1e-6)


@pytest.mark.parametrize("make", [GreedyCoverage, ExpectedError])
def test_the_pose_chosen_for_a_true_belief_is_free_and_touches(make: type) -> None:
    here = belief_of(HandTable(kind="leap"))
    probe, = make()(here)
    assert isinstance(probe, Grasp)
    assert probe.wanted is not None
    status = grasped(here, probe.hand_pose, probe.wanted)[0].closing.status
    assert (status != ProbeStatus.COLLISION).all()
    assert ((status == ProbeStatus.CONTACT).sum((1, 2, 3)) >= 4).all()


def test_links_that_feel_nothing_are_not_foreseen_to_touch(tmp_path) -> None:
    def foreseen(senses: str) -> tuple[np.ndarray, np.ndarray]:
        text = (HANDS / "leap.toml").read_text()
        path = tmp_path / f"{senses}.toml"
        path.write_text(text.replace('senses = "joint_torques"', f'senses = "{senses}"'))
        here = belief_of(HandTable(kind=str(path)))
        return predicted_touches(here, *candidate_poses(here))

    points, found = foreseen("joint_torques")
    by_tips, tips_found = foreseen("tip_switches")
    assert (found >= tips_found).all()
    assert 0.5 * found.sum() < tips_found.sum() < found.sum()
    np.testing.assert_array_equal(by_tips[tips_found], points[tips_found])
    with pytest.raises(NotPossible, match="the hand leap feels none"):
        foreseen("nothing")
