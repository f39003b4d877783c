"""Foreseen touches are the simulator's, whatever the hand."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from beliefs import BODY, belief

from fit.superquadric.geometry import Superquadric
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


@pytest.mark.parametrize(("taper", "share"), [(0.0, 0.0), (0.7, 0.022)])
@pytest.mark.parametrize("lanes", [True, False])
def test_touches_do_not_depend_on_where_a_path_begins(
    lanes: bool, taper: float, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands are skipped by planes and bounds of what was looked at before them: by others, where
    a path begins later. What both find they find at the same place, but for bodies that taper, of
    which the formula is no bound."""
    rng = np.random.default_rng(3)
    worlds, size = 32, rng.uniform(0.015, 0.05, (32, 3))
    turn = rng.uniform(0.0, np.pi, worlds)
    bodies = Superquadric(
        size, rng.uniform(0.1, 1.6, (worlds, 2)),
        np.stack([np.full(worlds, 0.45), np.zeros(worlds), size[:, 2]], 1),
        np.stack([0 * turn, 0 * turn, np.sin(turn / 2), np.cos(turn / 2)], 1),
        rng.choice([-taper, taper], (worlds, 2)), np.zeros((worlds, 2)))
    here = belief_of(HandTable(kind="leap"))
    poses = np.tile(candidate_poses(here)[0][:1], (worlds, 1, 1))
    monkeypatch.setattr(first_touch, "has_lanes", lambda device: lanes)

    def touches(begin: int) -> np.ndarray:
        def later(closings: tuple[str, ...], hand: HandTable) -> tuple[np.ndarray, np.ndarray]:
            commands, count = padded_commands(closings, hand)
            return commands[..., begin:, :], count - begin

        monkeypatch.setattr(first_touch, "padded_commands", later)
        first_touch._links_on_device.cache_clear()
        return first_touch.first_touches(
            bodies, here.hand, here.closings, poses, np.ones(poses.shape[:2], bool), "cpu")

    whole, part = touches(0), touches(7)
    first_touch._links_on_device.cache_clear()
    comes = np.isfinite(part).any((3, 4), keepdims=True)[..., 0]  # the hand begins free there, too
    found = np.isfinite(whole[..., 0])
    assert (found & comes).sum() > 1000
    other = (found != np.isfinite(part[..., 0])) & comes
    with np.errstate(invalid="ignore"):
        other |= np.linalg.norm(whole - part, axis=-1) > 1e-9
    assert other.sum() <= share * (found & comes).sum()
