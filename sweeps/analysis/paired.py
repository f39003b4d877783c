"""Every entry's values on every episode, paired: read object by object, or all at once."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import compress

import numpy as np

from sweeps.analysis.bootstrap import REPLICATES, population, replicate_means
from sweeps.analysis.entries import (
    CHANCES,
    COSTS,
    HIGHER_IS_BETTER,
    Entry,
    entries_of,
    entry_axes,
    paired_blocks,
    prior_column,
    ranked_values,
    values_of,
)
from sweeps.analysis.interval import ObjectMeans
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns
from warpgrasp.core.plain_text import first_few

FEW_EPISODES = 48  # of all objects, below which skewed scores make their interval too short
MANY_OBJECTS = 6  # below, the spread between objects is hardly known
NO_OBJECTS = "no object has a value of every entry: nothing can be compared"


@dataclass
class ObjectRows:
    """What every entry has on one object: the blocks that none misses, one below the other."""

    number: int
    name: str
    values: dict[str, np.ndarray] = field(default_factory=dict)
    """By metric (row, entry), NaN where a row has no value."""
    episodes: list[tuple[int, int]] = field(default_factory=list)
    """Of each row: its block, and its place there. Averaged axes repeat an episode."""
    missing: int = 0
    """Units of blocks that were left out."""

    def filled(self, metric: str) -> np.ndarray:
        """(episode, entry): a failed episode as a leaderboard counts it, and an episode of several
        rows as their mean."""
        return by_episode(filled(self.values[metric], failure_score(metric), self.given(metric)),
                          self.episodes)

    def costs(self, metric: str) -> np.ndarray:
        """(episode, entry) of touches, time or path: one that is not known counts as its entry's
        mean on this object, for nobody made it; NaN where the entry has none here."""
        values = self.values[metric]
        return by_episode(np.where(np.isfinite(values), values, self.plain(metric)), self.episodes)

    def all_alike(self, metric: str) -> list[int]:
        """The entries of which all episodes count as the same worst, for none has a value; none of
        them where nothing is known of what that is, or of chances, whose variance is never 0."""
        if metric in CHANCES or not np.isfinite(self.filled(metric)).all():
            return []
        values, score = self.values[metric], failure_score(metric)
        lost = ~np.isfinite(values) if score is None else values == score  # has it by `values_of`
        return [int(n) for n in np.flatnonzero(lost.all(axis=0))]

    def given(self, metric: str) -> np.ndarray:
        """What the priors of the rows score, (row, entry); nothing for a metric that has none."""
        return self.values.get(prior_column(metric) or "", np.zeros((0, 0)))

    def plain(self, metric: str) -> np.ndarray:
        """Each entry's mean of the values there are, (entry,)."""
        values = self.values[metric]
        known = np.isfinite(values)
        total, count = np.where(known, values, 0.0).sum(axis=0), known.sum(axis=0)
        return np.divide(total, count, where=count > 0, out=np.full(len(total), np.nan))


def read_objects(plan: Plan, stores: Sequence[Store], entries: Sequence[Entry],
                 axes: Sequence[int], metrics: Sequence[str],
                 also: Callable[[Entry, Columns], None] | None = None) -> Iterator[ObjectRows]:
    """A study object by object; `also` is shown the rows of every entry and block.

    Beside the metrics, by the first of which entries are ranked, their priors' columns are read.
    """
    columns = {*metrics, *filter(None, map(prior_column, metrics))}
    for number, body in enumerate(plan.study.objects):
        found = ObjectRows(number, body.name)
        parts: dict[str, list[np.ndarray]] = {name: [] for name in columns}
        for block in paired_blocks(plan, stores, entries, axes, number):
            if block.missing:
                found.missing += block.missing
                continue
            found.episodes += [(block.number, n) for n in range(block.count)]
            for name in columns:
                of_rows = ranked_values if name == metrics[0] else values_of
                parts[name].append(np.column_stack([of_rows(rows, name) for rows in block.rows]))
            for entry, rows in zip(entries, block.rows if also else (), strict=False):
                also(entry, rows)  # type: ignore[misc]
        if found.episodes:
            found.values = {name: np.concatenate(part) for name, part in parts.items()}
        yield found


@dataclass(frozen=True)
class Paired:
    """A study's numbers, as tables and figures use them."""

    entries: tuple[Entry, ...]
    objects: tuple[str, ...]
    """The objects that have episodes; those without are left out."""
    values: dict[str, tuple[np.ndarray, ...]]
    """By metric, for each object (episode, entry); a failed episode counts as in a leaderboard:
    as the worst in the first metric, by which entries are ranked, and in other scores, but not in
    what touches, time and path they took.

    An episode run under several settings is one row: its mean over them."""
    means: dict[str, np.ndarray]
    """By metric, (1 + replicate, entry): the mean over objects, then episodes; row 0 the data. In
    all metrics of the objects where the first one is known: replicates are drawn alike."""
    notes: tuple[str, ...]
    over: str = "like-these"
    """What the replicates are of: objects like these, or these with other episodes."""

    @property
    def labels(self) -> list[str]:
        """The entries' names."""
        return [entry.label for entry in self.entries]

    @property
    def notes_of_data(self) -> tuple[str, ...]:
        """The notes of a table whose intervals `over` does not choose."""
        option = interval_note(self.over)
        return tuple(note for note in self.notes if note != option)

    def statistics(self, metric: str) -> ObjectMeans:
        """The means with intervals that need no replicates."""
        found = ObjectMeans(len(self.entries), 0, chances=metric in CHANCES)
        for values in self.values[metric]:
            found.add(values)
        return found

    def known_objects(self, metric: str) -> int:
        """How many objects have values: of the others every mean is left out."""
        return int(np.isfinite(self.object_means(metric)).all(axis=1).sum())

    def object_means(self, metric: str) -> np.ndarray:
        """Each object's mean over episodes, (object, entry)."""
        return np.array([values.mean(axis=0) for values in self.values[metric]]).reshape(
            len(self.objects), len(self.entries))


def read_paired(plan: Plan, stores: Sequence[Store], metrics: Sequence[str],
                axes: Sequence[int] | None = None, over: str | None = None) -> Paired:
    """Reads a study's units once. Memory grows with the episodes, by 8 bytes a metric and entry.

    `axes` define the entries; by default those of the grid and the zip. Intervals are over `over`
    (see `bootstrap.OVER`), by default over objects like these where there are several.
    """
    axes = entry_axes(plan, None)[0] if axes is None else axes
    entries = entries_of(plan, axes)
    seed = int(plan.hash, 16)
    metrics = tuple(dict.fromkeys(metrics))  # one may be a column of a table besides
    values: dict[str, list[np.ndarray]] = {name: [] for name in metrics}
    objects: list[str] = []
    missing, unscored = 0, np.zeros(len(entries), int)
    for found in read_objects(plan, stores, entries, axes, metrics):
        missing += found.missing
        if not found.episodes:
            continue
        if np.isfinite(found.values[metrics[0]]).any():  # else the object is lost, and named
            unscored += (~np.isfinite(found.values[metrics[0]])).sum(axis=0)
        objects.append(found.name)
        for name in metrics:
            ranked = name == metrics[0] or name not in COSTS
            values[name].append(found.filled(name) if ranked else found.costs(name))
    there = [bool(np.isfinite(found).all()) for found in values[metrics[0]]]
    kept = there if any(there) else [True] * len(there)  # replicates of all are of the same objects
    known = {name: list(compress(found, kept)) for name, found in values.items()}
    nothing = np.full((1 + REPLICATES, len(entries)), np.nan)
    means = {name: nothing if not of_objects else
             (replicate_means if name == metrics[0] else _means_of_each)(of_objects, seed, over)
             for name, of_objects in known.items()}
    lost = [name for name, used in zip(objects, there, strict=True) if not used]
    count = len(objects) - len(lost)
    over = population(over, count)
    return Paired(tuple(entries), tuple(objects),
                  {name: tuple(found) for name, found in values.items()}, means,
                  (*reading_notes(plan, missing, count), *lost_notes(lost, metrics[0]),
                   *unscored_note([entry.label for entry in entries], unscored, metrics[0]),
                   *few_episodes_note(count, sum(map(len, known[metrics[0]]))),
                   interval_note(over)), over)


def _means_of_each(of_objects: Sequence[np.ndarray], seed: int, over: str | None) -> np.ndarray:
    """`replicate_means` of every entry over the objects where it has values; NaN, and no other's
    loss, for one that has none anywhere."""
    whole = _objects_filled(of_objects)
    known = np.isfinite(whole[0].sum(axis=0))
    found = np.full((1 + REPLICATES, whole[0].shape[1]), np.nan)
    found[:, known] = replicate_means([values[:, known] for values in whole], seed, over)
    return found


def _objects_filled(of_objects: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Where an entry has nothing on an object, its mean over the objects where it has: so the mean
    over all is that over those, and no other entry loses the object."""
    means = np.array([values.mean(axis=0) for values in of_objects])
    known = np.isfinite(means)
    mean = np.divide(np.where(known, means, 0.0).sum(axis=0), known.sum(axis=0),
                     where=known.any(axis=0), out=np.full(means.shape[1], np.nan))
    return [np.where(np.isfinite(values), values, mean) for values in of_objects]


def lost_notes(objects: Sequence[str], metric: str) -> Iterator[str]:
    """What a reader should know of objects on which no episode has a value."""
    for name in objects:
        yield (f"no entry has any {metric} on {name}, where all of them failed or nothing has one; "
               f"means and intervals of {metric} leave it out")


def unscored_note(labels: Sequence[str], unscored: np.ndarray, metric: str) -> Iterator[str]:
    """How many rows of each entry, (entry,), have no value, those with the most first: a difference
    may be one of how often entries fail."""
    told = [f"{unscored[n]} of {labels[n]}" for n in np.argsort(-unscored, kind="stable")
            if unscored[n]]
    if told:
        yield (f"episodes without {metric} count as the worst on their object: "
               f"{first_few(told)}")


def certain_notes(alike: Sequence[tuple[str, str]], metric: str) -> Iterator[str]:
    """What a reader should know of entries, and objects, of which all episodes count as the same:
    an interval takes for certain what does not vary."""
    for label in dict.fromkeys(label for label, _ in alike):
        objects = first_few([name for own, name in alike if own == label])
        yield (f"{label}: all episodes on {objects} count as the same worst {metric}, which its "
               "interval of these objects takes for certain")


def interval_note(over: str) -> str:
    """What the intervals of a table claim."""
    return ("intervals are of these objects, with other episodes" if over == "these" else
            "intervals are of objects like these (--over these: of these, with other episodes)")


def failure_score(metric: str) -> float | None:
    """What an episode without a value counts as; None: as the worst that any entry had or was
    given."""
    return 0.0 if metric in HIGHER_IS_BETTER else None


def filled(values: np.ndarray, score: float | None, given: np.ndarray | None = None
           ) -> np.ndarray:
    """One object's values with a number for the episodes that have none, if any is known.

    That is `score`, or without it the largest of these values and of the priors' that were
    `given`: or failing would score better than doing nothing.
    """
    good = np.isfinite(values)
    known = values[good]
    if given is not None:
        known = np.concatenate([known, given[np.isfinite(given)]])
    if not len(known):
        return np.full_like(values, np.nan)
    return np.where(good, values, known.max() if score is None else score)


def by_episode(rows: np.ndarray, episodes: Sequence[tuple[int, int]]) -> np.ndarray:
    """The mean of each episode's rows, in the order of episodes."""
    _, own, counts = np.unique(episodes, axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(counts), rows.shape[1]))
    np.add.at(sums, own, rows)
    return sums / counts[:, None]


def few_episodes_note(objects: int, episodes: int) -> Iterator[str]:
    """A warning where the interval of these objects rests on few episodes of all of them."""
    if 0 < objects < episodes < FEW_EPISODES:
        of = "one object" if objects == 1 else f"{objects} objects"
        yield (f"{of}, {episodes} episodes in all: below {FEW_EPISODES} the interval of these "
               "objects holds less often than 95 % if a few are far worse than the rest")


def reading_notes(plan: Plan, missing: int, objects: int) -> Iterator[str]:
    """What a reader should know about what was read."""
    if missing:
        yield (f"{missing} of {plan.unit_count} units are missing; blocks of episodes that not "
               "every entry has are left out")
    if objects == 0:
        yield NO_OBJECTS
    elif objects < MANY_OBJECTS:
        yield (f"{objects} object{'' if objects == 1 else 's'}: below {MANY_OBJECTS} nothing can "
               "be claimed about other objects, not even when one entry wins on all of them")
