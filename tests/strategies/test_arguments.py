"""What functions of Python are given is refused at once, with the shape or the word that would be
right, before anything is computed from it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from strategies.exploration import explore
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import BoundingCylinder, Random, Ring, WaypointError
from strategies.strategy import Strategy
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, FitTable, HandTable, SensorTable
from warpgrasp.robot import Robot, Truth

KEY = np.arange(2, dtype=np.uint64)
PRIOR = BoundingCylinder(*(np.full(2, v) for v in (0.45, 0.0, 0.03, 0.1)))


@pytest.mark.parametrize("order", ["planar", (), ("planer",), ("containment", 3), None])
def test_an_order_is_of_procedures(order: object) -> None:
    with pytest.raises(ValueError, match=r"order is .*; should be a list of containment, planar, "):
        Strategy("s", order=order)  # type: ignore[arg-type]


def test_a_prior_has_a_number_for_each_world() -> None:
    for x_m in (0.45, np.zeros(3), np.zeros((2, 1))):
        with pytest.raises(ValueError, match=r"x_m, y_m, .* are of shapes .*, \(2,\), .*; should "):
            replace(PRIOR, x_m=x_m)
    with pytest.raises(TypeError, match=r"prior.y_m: is list; should be a NumPy array of numbers"):
        waypoint_poses([Ring()], replace(PRIOR, y_m=[0.0, 0.0]), HandTable(), KEY)  # type: ignore[arg-type]


def test_waypoints_want_a_key_for_each_world_and_a_list() -> None:
    for key, kind in ((KEY[:1], ValueError), (KEY[:, None], ValueError), (KEY * 1.0, TypeError),
                      (3, TypeError)):
        with pytest.raises(kind, match=r"key: .*; should be .*\(world 2,\)"):
            waypoint_poses([Random()], PRIOR, HandTable(), key)  # type: ignore[arg-type]
    with pytest.raises(WaypointError, match=r"should be a list of families, such as \[Ring"):
        waypoint_poses(Ring(), PRIOR, HandTable(), KEY)  # type: ignore[arg-type]


def test_an_episode_wants_a_planner_and_a_prior_and_a_seed_for_each_world() -> None:
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
    robot = Robot([body_from_name("block")], np.zeros(1, int), Truth(pose), KEY, ArmTable(),
                  HandTable(), SensorTable())
    three = BoundingCylinder(*(np.full(3, v) for v in (0.45, 0.0, 0.03, 0.1)))
    right: dict[str, Any] = {"planner": lambda belief: [], "prior": PRIOR, "seed": KEY,
                             "closings": ("curl40",), "table": FitTable()}
    explore(robot, **right)
    for name, value, kind, says in (
            ("planner", Strategy("s"), TypeError, "planner: is Strategy; should be a function"),
            ("prior", three, ValueError, r"prior.x_m: of shape \(3,\); should be \(world 2,\)"),
            ("seed", KEY[:1], ValueError, r"seed: of shape \(1,\); should be \(world 2,\)"),
            ("seed", 3, TypeError, "seed: is int; should be a NumPy array of whole numbers"),
            ("closings", ("curl41",), KeyError, "closing path 'curl41'; should be one of "),
            ("closings", "curl40", ValueError, "closings: are 'curl40'; should be names")):
        given: dict[str, Any] = {**right, name: value}
        with pytest.raises(kind, match=says):
            explore(robot, **given)
