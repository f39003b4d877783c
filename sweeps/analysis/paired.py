"""Every entry's value on every episode, paired, with the means that intervals are drawn from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.bootstrap import MeanOverObjects
from sweeps.analysis.entries import (
    HIGHER_IS_BETTER,
    Entry,
    entries_of,
    entry_axes,
    paired_blocks,
    values_of,
)
from sweeps.analysis.leaderboard import MANY_OBJECTS
from sweeps.run.plan import Plan
from sweeps.run.store import Store


@dataclass(frozen=True)
class Paired:
    """A study's numbers, as tables and figures use them."""

    entries: tuple[Entry, ...]
    objects: tuple[str, ...]
    """The objects that have episodes; those without are left out."""
    values: dict[str, tuple[np.ndarray, ...]]
    """By metric, for each object (episode, entry); a failed episode counts as in a leaderboard.

    An episode run under several settings is one row: its mean over them."""
    means: dict[str, np.ndarray]
    """By metric, (1 + replicate, entry): the mean over objects, then episodes; row 0 the data."""
    notes: tuple[str, ...]

    @property
    def labels(self) -> list[str]:
        """The entries' names."""
        return [entry.label for entry in self.entries]

    def object_means(self, metric: str) -> np.ndarray:
        """Each object's mean over episodes, (object, entry)."""
        return np.array([values.mean(axis=0) for values in self.values[metric]]).reshape(
            len(self.objects), len(self.entries))


def read_paired(plan: Plan, stores: Sequence[Store], metrics: Sequence[str],
                axes: Sequence[int] | None = None) -> Paired:
    """Reads a study's units once. Memory grows with the episodes, by 8 bytes a metric and entry.

    `axes` define the entries; by default those of the grid and the zip.
    """
    axes = entry_axes(plan, None)[0] if axes is None else axes
    entries = entries_of(plan, axes)
    sums = {name: MeanOverObjects(len(entries), failure_score(name), int(plan.hash, 16))
            for name in metrics}
    values: dict[str, list[np.ndarray]] = {name: [] for name in metrics}
    objects: list[str] = []
    missing = 0
    for number, body in enumerate(plan.study.objects):
        parts: dict[str, list[np.ndarray]] = {name: [] for name in metrics}
        episodes: list[tuple[int, int]] = []  # of each row: block, place in it
        for block in paired_blocks(plan, stores, entries, axes, number):
            if block.missing:
                missing += block.missing
                continue
            episodes += [(block.number, n) for n in range(block.count)]
            for name in metrics:
                table = np.column_stack([values_of(rows, name) for rows in block.rows])
                parts[name].append(table)
                sums[name].add(table, (number, block.number))
        for mean in sums.values():
            mean.finish_object()
        if episodes:
            objects.append(body.name)
            for name in metrics:
                rows = filled(np.concatenate(parts[name]), failure_score(name))
                values[name].append(by_episode(rows, episodes))
    return Paired(tuple(entries), tuple(objects),
                  {name: tuple(found) for name, found in values.items()},
                  {name: mean.means() for name, mean in sums.items()},
                  tuple(reading_notes(plan, missing, len(objects))))


def failure_score(metric: str) -> float | None:
    """What an episode without a value counts as; None: as the worst that any entry had."""
    return 0.0 if metric in HIGHER_IS_BETTER else None


def filled(values: np.ndarray, score: float | None) -> np.ndarray:
    """One object's values with a number for the episodes that have none."""
    good = np.isfinite(values)
    worst = float(values[good].max(initial=-np.inf)) if good.any() else np.nan
    return np.where(good, values, worst if score is None else score)


def by_episode(rows: np.ndarray, episodes: Sequence[tuple[int, int]]) -> np.ndarray:
    """The mean of each episode's rows, in the order of episodes."""
    _, own, counts = np.unique(episodes, axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(counts), rows.shape[1]))
    np.add.at(sums, own, rows)
    return sums / counts[:, None]


def reading_notes(plan: Plan, missing: int, objects: int) -> Iterator[str]:
    """What a reader should know about what was read."""
    if missing:
        yield (f"{missing} of {plan.unit_count} units are missing; blocks of episodes that not "
               "every entry has are left out")
    if objects < MANY_OBJECTS:
        yield (f"{objects} object{'' if objects == 1 else 's'}: below {MANY_OBJECTS} nothing can "
               "be claimed about other objects, not even when one entry wins on all of them")
