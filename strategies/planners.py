"""From a strategy's record to the planner that carries it out."""

import numpy as np

from strategies.budget import MOST_STEPS, Budget
from strategies.exploration import Planner
from strategies.ordering import OrderedPlanner
from strategies.registry import make_planner
from strategies.stereo_axis import see_axis
from strategies.strategy import Strategy
from strategies.tables import ContourTable, DecideTable, PlanarTable
from strategies.waypoints import BoundingCylinder
from warpgrasp.parameters import StereoTable
from warpgrasp.robot import Robot


def planner_of(
    strategy: Strategy, planar: PlanarTable, contour: ContourTable, decide: DecideTable,
    stereo: StereoTable, robot: Robot, told: BoundingCylinder
) -> Planner:
    """A fresh planner for one batch. Raises PlannerError for one that cannot be found or made."""
    if strategy.call:
        return make_planner(strategy.call, dict(strategy.options))
    seen = None
    if contour.axis == "stereo" and {"contour", "decide"} & set(strategy.order):
        target = np.stack([told.x_m, told.y_m, told.height_m / 2], 1)
        seen = see_axis(robot, target, stereo)
    return OrderedPlanner(strategy, planar, contour, decide, seen)


def budget_of(strategy: Strategy) -> Budget:
    """The budget a strategy sets itself; an order given in advance ends as it is."""
    return Budget(strategy.touches, strategy.robot_time_s, strategy.volume_ratio,
                  MOST_STEPS if strategy.call else None)
