"""From a strategy's record to the planner that carries it out, and to its budget."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strategies.planners.ordered import OrderedPlanner
from strategies.planners.register import Planner
from strategies.planners.registry import make_planner
from strategies.planners.unguided import Unguided
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.procedures.possible import check_possible
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Shape
from strategies.strategy import Strategy
from warpgrasp.parameters import StereoTable
from warpgrasp.robot import Robot

MOST_STEPS = 128
"""Steps of a planner that goes by what it finds, for it might never end."""


@dataclass(frozen=True)
class Budget:
    """Limits of one episode; a world that has reached one of them ends."""

    touches: int | None = None
    """Guarded motions of a finger, felt or not. A batch of grasps is cut so as not to pass it by
    more than the last hand pose."""
    robot_time_s: float | None = None
    """Checked between steps."""
    volume_ratio: float | None = None
    """Stop when the 90 % interval of the volume, upper over lower bound, is below this (> 1)."""
    steps: int | None = MOST_STEPS
    """Steps in which the world wanted something; None where a strategy is known to end."""
    time_each_pose: bool = False
    """Whether a batch of grasps is cut for `robot_time_s` too, so as to pass it by no more than the
    last hand pose."""


def within_budget(budget: Budget, belief: Belief) -> np.ndarray:
    """Worlds that may go on, bool (world,)."""
    on = np.ones(belief.worlds, bool)
    if budget.touches is not None:
        on &= belief.touches < budget.touches
    if budget.robot_time_s is not None:
        on &= belief.time_s < budget.robot_time_s
    known = belief.shape != Shape.PRIOR
    if budget.volume_ratio is not None and belief.step and known.any():
        low, high = belief.uncertainty.volume_interval_m3().T
        on &= ~(known & (high <= budget.volume_ratio * low))
    return on


def planner_of(
    strategy: Strategy, planar: PlanarTable, contour: ContourTable, decide: DecideTable,
    stereo: StereoTable, robot: Robot, prior: BoundingCylinder,
    waypoints: Sequence[tuple[Sequence[object], int]] = ()
) -> Planner:
    """A fresh planner for one batch. Raises PlannerError for one that cannot be found or made,
    NotPossible for an order that the robot's hand cannot carry out.

    `waypoints` are those of an `OrderedPlanner`.
    """
    if strategy.call:
        made = make_planner(strategy.call, dict(strategy.options))
        if isinstance(made, Unguided):
            made.at_once = max(strategy.refit_every, 1) if fits_on_way(strategy, made) else None
        return made
    for procedure in strategy.order:
        check_possible(procedure, robot.hand, robot.pads)
    seen = None
    if contour.axis == "stereo" and {"contour", "decide"} & set(strategy.order):
        from strategies.procedures.stereo_axis import see_axis  # with it cameras

        target = np.stack([prior.x_m, prior.y_m, prior.height_m / 2], 1)
        seen = see_axis(robot, target, stereo)
    return OrderedPlanner(strategy, planar, contour, decide, seen, waypoints)


def fits_on_way(strategy: Strategy, planner: Planner) -> bool:
    """Whether bodies are fitted after every step: where the planner looks at them, the strategy
    asks for it, or the budget is of what is looked at between steps."""
    return (not isinstance(planner, Unguided) or strategy.refit_every > 0
            or strategy.robot_time_s is not None or strategy.volume_ratio is not None)


def budget_of(strategy: Strategy) -> Budget:
    """The budget a strategy sets itself; an order given in advance ends as it is, and asks for all
    poses of a containment at once."""
    return Budget(strategy.touches, strategy.robot_time_s, strategy.volume_ratio,
                  MOST_STEPS if strategy.call else None, time_each_pose=not strategy.call)
