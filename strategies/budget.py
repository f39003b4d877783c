"""When an episode has had enough: by touches, by robot time, or by how sure it is."""

from dataclasses import dataclass

import numpy as np

from strategies.belief import Belief

MOST_STEPS = 64
"""Steps of a planner that goes by what it finds, for it might never end."""


@dataclass(frozen=True)
class Budget:
    """Limits of one episode; a world at any of them is asked for nothing more."""

    touches: int | None = None
    """Guarded closings and pad touches. A batch of grasps is cut so as not to pass it by more than
    the last hand pose."""
    robot_time_s: float | None = None
    """Looked at between steps."""
    volume_ratio: float | None = None
    """Stop when the 90 % interval of the volume, upper over lower bound, is below this (> 1)."""
    steps: int | None = MOST_STEPS
    """Steps in which the world wanted something; None where a strategy is known to end."""


def within_budget(budget: Budget, belief: Belief) -> np.ndarray:
    """Worlds that may go on, bool (world,)."""
    on = np.ones(belief.worlds, bool)
    if budget.touches is not None:
        on &= belief.touches < budget.touches
    if budget.robot_time_s is not None:
        on &= belief.time_s < budget.robot_time_s
    if budget.volume_ratio is not None and belief.step and belief.fitted.any():
        low, high = belief.uncertainty.volume_interval_m3().T
        on &= ~(belief.fitted & (high <= budget.volume_ratio * low))
    return on
