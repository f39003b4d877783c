"""Strategies, procedures and fits know nothing of the truth: a robot whose truth raises when read.

The robot's own guarded moves may read it, since they are the simulator. Nothing else may: not the
scene, the place of the object, what truly happened, or the errors of calibration.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from strategies.exploration import explore
from strategies.planners.from_strategy import budget_of, planner_of
from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior
from warpgrasp.core.random import counter_key
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import (
    ArmTable,
    FitTable,
    HandTable,
    ObjectTable,
    SensorTable,
    StereoTable,
)
from warpgrasp.robot import Robot, Truth

SECRETS = ("_truth", "_scene", "_body", "_calibration", "_key")
MOVES = ("grasp", "guarded_line", "look", "camera_noise", "rehearsing")


class TruthWasReadError(Exception):
    """Somebody asked for what a robot cannot know."""


class GuardedRobot(Robot):
    """A robot that gives its secrets to its own moves alone."""

    def __init__(self, *values: Any, **words: Any) -> None:
        object.__setattr__(self, "moving", True)
        super().__init__(*values, **words)
        object.__setattr__(self, "moving", False)

    def __getattribute__(self, name: str) -> Any:
        found = object.__getattribute__(self, name)
        if name in SECRETS and not object.__getattribute__(self, "moving"):
            raise TruthWasReadError(name)
        if name in MOVES:
            return _in_motion(self, found)
        return found

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(object.__getattribute__(self, "_key"))


def _in_motion(robot: GuardedRobot, move: Callable[..., Any]) -> Callable[..., Any]:
    def call(*values: Any, **words: Any) -> Any:
        before = object.__getattribute__(robot, "moving")
        object.__setattr__(robot, "moving", True)
        try:
            return move(*values, **words)
        finally:
            object.__setattr__(robot, "moving", before)
    return call


def run(name: str, body_name: str = "block", poses: int | None = None,
        table: FitTable | None = None) -> np.ndarray:
    """The statuses of two short episodes of a strategy."""
    key = counter_key(11, np.arange(2))
    body, pose = body_from_name(body_name), place_objects(ObjectTable(), key)
    prior = draw_prior(body, pose, ObjectTable(), key)
    robot = GuardedRobot([body], np.zeros(1, int), Truth(pose), key, ArmTable(), HandTable(),
                         SensorTable())
    strategy = STRATEGIES[name]
    if poses is not None and strategy.waypoints == ():
        strategy = replace(strategy, touches=8 * poses)
    planner = planner_of(strategy, PlanarTable(), ContourTable(), DecideTable(), StereoTable(),
                         robot, prior)
    found = explore(robot, planner, prior, counter_key(key, 3), table=table or FitTable(),
                    closings=strategy.closings, budget=budget_of(strategy))
    assert not found.fault.any(), found.fault
    return found.status


def test_the_guard_bites() -> None:
    body, key = body_from_name("block"), counter_key(11, np.arange(2))
    robot = GuardedRobot([body], np.zeros(1, int), Truth(place_objects(ObjectTable(), key)), key,
                         ArmTable(), HandTable(), SensorTable())
    for name in SECRETS:
        with pytest.raises(TruthWasReadError, match=name):
            getattr(robot, name)
    assert robot.worlds == 2


@pytest.mark.parametrize("name", ["ring6", "planar"])
def test_what_ships_reads_no_truth(name: str) -> None:
    # Small fits: what matters here is who reads the truth.
    assert len(run(name, table=FitTable(taper=False, rivals=False, rounds=0))) == 2


def test_a_search_by_free_forms_reads_no_truth() -> None:
    table = FitTable(taper=False, rivals=False, rounds=0, reconstruct="implicit")
    assert len(run("gaussian-process", poses=2, table=table)) == 2


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in STRATEGIES if name not in ("oracle",)])
def test_all_that_ships_reads_no_truth(name: str) -> None:
    """But the oracle, which is the reference that may."""
    for body in ("block", "coke_bottle"):
        assert len(run(name, body, poses=3)) == 2
