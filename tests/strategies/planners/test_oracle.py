"""The oracle takes what turns out best, and what it foresees comes true."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import BODY, belief

from fit.arrays import rows_of
from strategies.exploration import RunningExploration
from strategies.planners.from_strategy import Budget
from strategies.planners.oracle import Oracle
from strategies.planners.probes import Grasp
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import BoundingCylinder, Ring
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered, Shape
from warpgrasp.core.random import counter_key
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, FitTable, HandTable, SensorTable
from warpgrasp.robot import Robot, Truth


def test_the_oracle_takes_what_turns_out_best() -> None:
    oracle, here = Oracle(tried=6), belief()
    seen: list[tuple[np.ndarray, np.ndarray]] = []

    def foresee(probe: Grasp, rows: np.ndarray) -> Recovered:
        seen.append((rows, probe.hand_pose[:, 0]))
        return Recovered(np.full(len(rows), Shape.SUPERQUADRIC), BODY)

    oracle.foresee = foresee
    oracle.let_see(lambda recovered, rows: np.abs(seen[-1][1][:, 1] - 0.05))
    probe, = oracle(here)
    assert isinstance(probe, Grasp)
    (rows, tried), = seen
    assert rows.tolist() == [0] * 6 + [1] * 6
    for world in range(2):
        mine = tried[rows == world]
        best = np.abs(mine[:, 1] - 0.05).argmin()
        np.testing.assert_array_equal(probe.hand_pose[world, 0], mine[best])
    with pytest.raises(RuntimeError, match="sees nothing"):
        Oracle()(here)


def test_what_is_foreseen_of_a_grasp_comes_of_it() -> None:
    """Also at steps at which bodies get new starts: these have them at the third and fourth."""
    key, one = counter_key(5, np.arange(2, 5)), np.ones(3)
    body = body_from_name("block")
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (3, 1))
    robot = Robot([body], np.zeros(1, int), Truth(pose), key, ArmTable(), HandTable(),
                  SensorTable())
    prior = BoundingCylinder(0.45 * one, 0.0 * one, float(np.hypot(*body.high_m[:2])) * one,
                             body.high_m[2] * one)
    run = RunningExploration(robot, prior, key, FitTable(), ("curl40", "base_then_curl"),
                             Budget())
    ring = Ring(count=6, tilt_rad=np.radians(50))
    for step in range(4):
        def next_one(belief: Belief, step: int = step) -> list[Grasp]:
            poses = waypoint_poses((ring,), belief.prior, belief.hand, belief.seed)
            return [Grasp(poses[:, step:step + 1])]

        grasp, = next_one(run.belief)
        # Beside one another, each world more than once, and after grasps that are not made.
        rows = np.array([0, 0, 1, 2, 2, 2])
        taken = np.array([1, 2, 4])
        others = waypoint_poses((replace(ring, tilt_rad=0.2),), prior, HandTable(), key)[rows, 1:2]
        others[taken] = grasp.hand_pose
        foreseen = rows_of(run.imagine(Grasp(others), rows), taken)
        run.take_step(next_one)
        assert np.array_equal(foreseen.shape, run.recovered.shape), step
        for mine, came in zip(foreseen.superquadric, run.recovered.superquadric, strict=True):
            np.testing.assert_array_equal(mine, came, err_msg=str(step))
