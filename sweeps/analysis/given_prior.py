"""The reference row `given-prior`: what an entry scores that touches nothing, on the same episodes.

Every row of a study holds the scores of the prior that its strategy was given (the columns
`prior_...`), so the reference needs no episodes of its own. Where swept keys change the prior there
is a reference for each of their settings. It has no rank.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.entries import Entry, bounds_of, value_text
from sweeps.analysis.interval import ObjectMeans
from sweeps.run.plan import Plan
from sweeps.spec.strategies import REFERENCE

SCORES = ("chamfer_mm", "hausdorff95_mm", "iou", "coverage5mm")
"""Metrics that the prior has, in columns of their own."""
COSTS = ("touches", "robot_time_s", "arm_path_m")
_TELLING = ("object.", "stereo.")
"""Tables whose keys change what is given, or on which objects."""


@dataclass(frozen=True)
class Reference:
    """A prior that some entries were given."""

    label: str
    entries: tuple[int, ...]


def references_of(plan: Plan, entries: Sequence[Entry]) -> list[Reference]:
    """The references of a study's entries, in the order of the entries."""
    axes = [n for n, axis in enumerate(plan.study.axes)
            if any(key.startswith(_TELLING) for key in axis.keys)]
    groups: dict[tuple[str, ...], list[int]] = {}
    for number, entry in enumerate(entries):
        told = tuple(
            f"{key}={value_text(value)}" for n in axes if n in entry.points
            for key, value in zip(plan.study.axes[n].keys,
                                  plan.study.axes[n].values[entry.points[n]], strict=True))
        groups.setdefault(told, []).append(number)
    return [Reference(REFERENCE + (f" [{', '.join(told)}]" if told else ""), tuple(numbers))
            for told, numbers in groups.items()]


def prior_column(metric: str) -> str | None:
    """The column of rows that holds the prior's score; None where there is none."""
    return f"prior_{metric}" if metric in SCORES else None


class ReferenceMeans:
    """Means over objects of every entry and, after them, of every reference, episode by episode."""

    def __init__(self, references: Sequence[Reference], entries: int, metric: str,
                 seed: int) -> None:
        self.references, self.entries, self.metric = references, entries, metric
        self.means = ObjectMeans(entries + len(references), seed)

    def add(self, values: np.ndarray, of_prior: np.ndarray | None) -> None:
        """An object's episodes of the entries and of their priors, (episode, entry) each."""
        if of_prior is None:
            nothing = 0.0 if self.metric in COSTS else np.nan
            of_prior = np.full(values.shape, nothing)
        self.means.add(np.column_stack([values, *(
            _mean_of_known(of_prior[:, list(r.entries)]) for r in self.references)]))

    @property
    def known(self) -> bool:
        """Whether any object has the prior's score."""
        return bool(self.means.objects)

    def worse(self, sign: float) -> list[str]:
        """Whether each entry is worse than its prior: "no"; "mean" if only its mean is; "yes" if
        the interval of the difference on these objects excludes 0, too; "NA" if not known.

        The interval holds for all entries together. `sign` is -1 if more is better.
        """
        found = ["NA"] * self.entries
        if not self.known or self.metric not in SCORES:
            return found
        for number, reference in enumerate(self.references):
            apart = self.means.differences(self.entries + number, "these")
            for n in reference.entries:
                ends = sorted((sign * apart.low[n], sign * apart.high[n]))
                found[n] = ("no" if not sign * apart.value[n] > 0.0 else
                            "yes" if ends[0] > 0.0 else "mean")
        return found

    def columns(self, best: int) -> dict[str, np.ndarray]:
        """The numbers of the references' rows, (reference,) each; entry `best` is the first."""
        own, metric = slice(self.entries, None), self.metric
        found = {}
        for over, name in (("like-these", "ci"), ("these", "these")):
            value = self.means.values(over, bounds_of(metric))
            delta = self.means.differences(best, over, simultaneous=False)
            found |= {metric: value.value, f"{metric}_{name}_low": value.low,
                      f"{metric}_{name}_high": value.high, "delta": delta.value,
                      f"delta_{name}_low": delta.low, f"delta_{name}_high": delta.high}
        return {name: values[own] for name, values in found.items()}


def _mean_of_known(values: np.ndarray) -> np.ndarray:
    """Of each row; entries of one reference were given the same prior, or failed without one."""
    known = np.isfinite(values)
    return np.divide(np.where(known, values, 0.0).sum(1), known.sum(1), where=known.any(1),
                     out=np.full(len(values), np.nan))
