"""What an episode of a batch was, as the robot knows it: its procedures, and what came of them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strategies.procedures.contour_record import ContourExploration
from strategies.procedures.planar_record import PlanarExploration
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from strategies.recovery.contact_verdict import contact_verdicts
from strategies.recovery.evidence import Evidence
from warpgrasp.robot import Grasps


@dataclass(frozen=True)
class Procedure:
    """One exploratory procedure as carried out, for the whole batch."""

    name: str
    """containment, planar or contour."""
    step: int
    felt: Grasps | PlanarExploration | ContourExploration
    took_part: np.ndarray
    """Bool (world,)."""
    slots: int
    """How many slots of the evidence are its own; procedures fill them in order."""
    closing: int = -1
    """Of a containment: which of the truth's closings it is."""
    asked_pose: np.ndarray | None = None
    """Of a containment: the hand poses asked for, (world, probe, 7)."""


@dataclass(frozen=True)
class Exploration:
    """An episode of each world, as the robot knows it."""

    procedures: tuple[Procedure, ...]
    belief: Belief
    """At the end."""
    recovered: Recovered
    status: np.ndarray
    """ok, too_few_contacts, fit_failed, fit_implausible, strategy_failed or not_possible, (world,).
    """
    fault: np.ndarray
    """What the strategy did wrong in each world, with file and line; empty where nothing, (world,).
    """
    stopped: np.ndarray
    """Worlds in which it wanted more than `Budget.steps` steps, bool (world,)."""
    felt: Evidence
    """All that was felt, contacts where they were felt: not placed on any body."""

    @cached_property
    def verdicts(self) -> np.ndarray:
        """The verdict of each contact of the belief, (world, point), as `contact_verdicts` has
        them; found once for all that ask, since they take some hundredths of a second a world."""
        return contact_verdicts(self.recovered, self.belief.evidence, self.belief.links)
