"""The scorer of a batch of worlds, each with one of some bodies before it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fit.rows import joined, rows_of
from strategies.recovered import Recovered
from sweeps.metrics import Scores, score_recovered, scores_again
from warpgrasp.body import Body


@dataclass(frozen=True)
class Scorer:
    """True bodies and where they stand."""

    bodies: Sequence[Body]
    which: np.ndarray
    """Body of each world, rising, (world,)."""
    body_pose: np.ndarray
    """(world, 7)."""
    device: str = "cpu"

    def worlds(self) -> Iterator[tuple[Body, slice]]:
        """Each body with its worlds."""
        ends = np.searchsorted(self.which, np.arange(len(self.bodies)), side="right")
        begins = [0, *ends[:-1]]
        for body, begin, end in zip(self.bodies, begins, ends, strict=True):
            yield body, slice(int(begin), int(end))

    def score(self, recovered: Recovered) -> Scores:
        """Scores of every world, see `sweeps.metrics.score_recovered`."""
        return joined([
            score_recovered(rows_of(recovered, rows), body, self.body_pose[rows],
                            device=self.device) for body, rows in self.worlds()])

    def score_again(self, recovered: Recovered, before: Recovered, scores: Scores) -> Scores:
        """Scores of every world, given those of the bodies `before`."""
        return joined([
            scores_again(rows_of(recovered, rows), rows_of(before, rows), rows_of(scores, rows),
                         body, self.body_pose[rows], device=self.device)
            for body, rows in self.worlds()])
