"""What an episode of a batch was, as the robot knows it: its procedures, and what came of them."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from strategies.procedures.contour_record import ContourExploration
from strategies.procedures.planar_record import PlanarExploration
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from strategies.recovery.contact_verdict import known_gaps, verdicts_by_gap
from strategies.recovery.evidence import Evidence
from warpgrasp.robot import Grasps

if TYPE_CHECKING:
    from strategies.reconstruct.free_form import Reconstruction


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
    ended: np.ndarray
    """Worlds that an error of the strategy ended, which may have been about another one of them,
    bool (world,)."""

    rebuilt: "Reconstruction | None" = None
    """Bodies that stand in place of `recovered` in some worlds, where they were asked for."""

    @cached_property
    def placed(self) -> Evidence:
        """All that was felt, contacts as placed on the body that stands in each world."""
        evidence = self.belief.evidence
        return evidence if self.rebuilt is None else self.rebuilt.places(evidence)

    def gaps(self, points_m: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """How far points (world, point, 3) are from the body that stands in each world [m],
        (world, point); infinite where that is the given prior."""
        model = known_gaps(self.recovered, points_m, mask)
        return model if self.rebuilt is None else self.rebuilt.gaps(model, points_m, mask)

    @cached_property
    def verdicts(self) -> np.ndarray:
        """The verdict of each contact of `placed`, (world, point), as `verdicts_by_gap` has them;
        found once for all that ask, since they take some hundredths of a second a world."""
        of_model = np.ones(len(self.status), bool)
        of_model[list(self.rebuilt.placed if self.rebuilt is not None else ())] = False
        return verdicts_by_gap(self.gaps(self.placed.points_m, self.placed.mask), self.placed,
                               self.belief.links, of_model)
