"""Error as it falls with touches or robot time: step functions, averaged over objects, episodes.

An episode's error is that of its last body so far, and stays after its end. Rows of a strategy that
was fitted once, at its end, hold no curve: it is that one step. Every entry has points of its own,
where its episodes were refitted: between them its mean stays. At a point episodes that have no fit
yet are left out; where they are more than one in twenty there is no mean (a mean over the quick
ones alone would flatter). Episodes of a unit that failed count as the worst all along: nobody knows
when they would have had a fit. Intervals are those of a leaderboard, at each point by itself;
medians of the table `reach` have them from bootstrap replicates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.bootstrap import (
    INTERVAL,
    REPLICATES,
    Estimate,
    episode_weights,
    object_weights,
    population,
    widening,
)
from sweeps.analysis.entries import (
    Entry,
    LeaderboardError,
    bounds_of,
    entries_of,
    entry_axes,
    paired_blocks,
    prior_column,
    values_of,
)
from sweeps.analysis.interval import ObjectMeans, completed, sensible_ends
from sweeps.analysis.paired import (
    by_episode,
    filled,
    interval_note,
    lost_notes,
    reading_notes,
    unscored_note,
)
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns
from sweeps.spec.errors import choose
from sweeps.text_table import TextTable, number_text
from warpgrasp.core.plain_text import first_few

ERROR = "chamfer_mm"
AXES = {"touches": ("curve_touches", "touches"), "time_s": ("curve_time_s", "robot_time_s")}
POINTS = 48
KNOWN = 0.95
"""Where fewer episodes have a fit there is no mean: of the quick ones alone it would flatter."""
Steps = tuple[np.ndarray, np.ndarray]  # where an episode was refitted, and its error then [mm]


@dataclass(frozen=True)
class Curves:
    """What every episode's curve was, by axis, object, entry and episode, with their weights."""

    entries: tuple[Entry, ...]
    objects: tuple[str, ...]
    steps: dict[str, list[list[list[Steps]]]]
    priors: list[np.ndarray]
    """What the priors of each object's rows score [mm], (entry, row); NaN where it is not known."""
    episodes: list[list[tuple[int, int]]]
    """For each object, of each of its rows the block and the place there."""
    weights: list[np.ndarray]
    """For each object (1 + replicate, episode), small whole numbers."""
    drawn: np.ndarray
    """How often each object is drawn, (1 + replicate, object)."""
    over: str
    """What intervals are of: objects "like-these", or "these" with other episodes."""
    seed: int
    notes: tuple[str, ...]

    @property
    def labels(self) -> list[str]:
        """The entries' names."""
        return [entry.label for entry in self.entries]

    def fits_once(self, entry: int) -> bool:
        """Whether no episode of an entry has more than one body, at its end."""
        bodies = [len(at) for found in self.steps["touches"] for at, _ in found[entry]]
        return bool(bodies) and max(bodies) == 1

    @property
    def lost(self) -> list[str]:
        """Objects on which no episode of any entry has an error."""
        return _lost(self.objects, self.steps)

    @property
    def draws(self) -> int:
        """Episodes of these objects that a median rests on, less one for each object but one."""
        return sum(len(set(own)) - 1 for own in self.episodes) + 1


def read_curves(plan: Plan, stores: Sequence[Store], over: str | None = None) -> Curves:
    """Reads a study's units once; memory grows with the episodes. `over` as in `bootstrap`."""
    axes, _ = entry_axes(plan, None)
    entries = entries_of(plan, axes)
    seed = int(plan.hash, 16)
    steps: dict[str, list[list[list[Steps]]]] = {axis: [] for axis in AXES}
    episodes, objects, priors, missing = [], [], [], 0
    unscored = np.zeros(len(entries), int)
    given = prior_column(ERROR) or ""
    for number, body in enumerate(plan.study.objects):
        mine: dict[str, list[list[Steps]]] = {axis: [[] for _ in entries] for axis in AXES}
        own: list[tuple[int, int]] = []
        of_priors: list[np.ndarray] = []
        for block in paired_blocks(plan, stores, entries, axes, number):
            if block.missing:
                missing += block.missing
                continue
            own += [(block.number, n) for n in range(block.count)]
            of_priors.append(np.array([values_of(rows, given) for rows in block.rows]))
            for axis, of_entries in mine.items():
                for found, rows in zip(of_entries, block.rows, strict=True):
                    found += episode_steps(rows, axis)
        if own:
            objects.append(body.name)
            episodes.append(own)
            priors.append(np.concatenate(of_priors, axis=1))
            if not _lost([body.name], {"touches": [mine["touches"]]}):  # else it is named
                unscored += [sum(not np.isfinite(error).all() for _, error in found)
                             for found in mine["touches"]]
            for axis, of_entries in mine.items():
                steps[axis].append(_failures_filled(of_entries, priors[-1]))
    lost = _lost(objects, steps)
    over = population(over, len(objects) - len(lost))
    drawn = object_weights(seed, len(objects)) if over == "like-these" else np.ones(
        (1 + REPLICATES, len(objects)))
    return Curves(tuple(entries), tuple(objects), steps, priors, episodes,
                  _weights(seed, episodes, over),
                  drawn, over, seed,
                  (*reading_notes(plan, missing, len(objects) - len(lost)),
                   *lost_notes(lost, ERROR),
                   *unscored_note([entry.label for entry in entries], unscored, ERROR),
                   interval_note(over)))


def _lost(objects: Sequence[str], steps: dict[str, list[list[list[Steps]]]]) -> list[str]:
    """Objects on which no episode of any entry has an error."""
    return [name for name, of_entries in zip(objects, steps["touches"], strict=True)
            if not any(np.isfinite(error).any() for found in of_entries for _, error in found)]


def _weights(seed: int, episodes: Sequence[list[tuple[int, int]]], over: str) -> list[np.ndarray]:
    """Those of the rows, by episode; 1 where objects are drawn, each with all of its episodes."""
    if over == "like-these":
        return [np.ones((1 + REPLICATES, len(own)), np.uint8) for own in episodes]
    found = []
    for number, own in enumerate(episodes):
        _, row = np.unique(own, axis=0, return_inverse=True)
        found.append(episode_weights(seed, number, row.max() + 1)[:, row].astype(np.uint8))
    return found


def episode_steps(rows: Columns, axis: str) -> list[Steps]:
    """Each row's curve; rows without one are a single step at their end."""
    curve, end = AXES[axis]
    if curve in rows and "curve_chamfer_mm" in rows:
        found = [(_numbers(at), _numbers(error))
                 for at, error in zip(rows[curve], rows["curve_chamfer_mm"], strict=True)]
    else:
        found = [(_numbers(()), _numbers(()))] * len(rows["status"])
    ends = zip(found, values_of(rows, end), values_of(rows, ERROR), strict=True)
    return [steps if len(steps[0]) else (np.array([at]), np.array([error]))
            for steps, at, error in ends]


def _numbers(values: object) -> np.ndarray:
    return np.asarray(() if values is None else values, float)


def _failures_filled(of_entries: list[list[Steps]], priors: np.ndarray) -> list[list[Steps]]:
    """An error that is no number counts as the worst on its object, or as the worst prior that was
    given there, as in a leaderboard."""
    errors = [error for found in of_entries for _, error in found]
    every = filled(np.concatenate(errors), None, priors) if errors else np.zeros(0)
    parts = iter(np.split(every, np.cumsum([len(error) for error in errors])[:-1]))
    return [[(np.where(np.isfinite(at), at, np.inf), next(parts)) for at, _ in found]
            for found in of_entries]


def grid_of(curves: Curves, axis: str, entry: int) -> np.ndarray:
    """Where an entry's episodes were refitted; where those places are more than POINTS, the first
    with a mean, places a round step apart, and the end."""
    every = [steps for found in curves.steps[axis] for steps in found[entry]]
    places = np.unique(np.concatenate([at[np.isfinite(at)] for at, _ in every] or [np.zeros(0)]))
    if not len(places):
        return np.zeros(1)
    if len(places) <= POINTS:
        return places
    known, end = _first_known(curves, axis, entry), places[-1]
    size = 10.0 ** np.floor(np.log10(end / POINTS))
    step = next(m * size for m in (1.0, 2.0, 5.0, 10.0) if m * size >= end / POINTS * (1 - 1e-12))
    apart = step * np.arange(1, int(np.ceil(end / step)))
    return np.unique([known, *apart[(apart > known) & (apart < end)], end])


def _first_known(curves: Curves, axis: str, entry: int) -> float:
    """From where an entry has a mean: enough episodes of every object have a fit."""
    first = [np.quantile([at[0] if np.isfinite(at[-1]) else 0.0 for at, _ in found[entry]], KNOWN,
                         method="inverted_cdf")
             for name, found in zip(curves.objects, curves.steps[axis], strict=True)
             if name not in curves.lost]
    return float(max(first, default=0.0))


def on_grid(steps: Steps, grid: np.ndarray) -> np.ndarray:
    """A step function at the grid's points; NaN before the first step."""
    at, error = steps
    last = np.searchsorted(at, grid, side="right") - 1
    return np.where(last >= 0, error[np.maximum(last, 0)], np.nan)


def _throughout(steps: Steps, grid: np.ndarray) -> np.ndarray:
    """As `on_grid`; of an episode that nobody timed, for its unit failed, its error everywhere."""
    at, error = steps
    return on_grid(steps, grid) if np.isfinite(at[-1]) else np.full(len(grid), error[-1])


def mean_curve(curves: Curves, axis: str, entry: int, grid: np.ndarray) -> Estimate:
    """The mean over objects, then episodes, with its interval; NaN where too few have a fit."""
    points = ObjectMeans(len(grid), 0)
    unknown = np.zeros(len(grid))
    for name, found, own in zip(curves.objects, curves.steps[axis], curves.episodes, strict=True):
        if name in curves.lost:
            continue
        values = np.array([_throughout(steps, grid) for steps in found[entry]])
        points.add(by_episode(completed(values), own))
        unknown = np.maximum(unknown, 1.0 - np.isfinite(values).mean(axis=0))
    found = sensible_ends(points.values(curves.over, bounds_of(ERROR)))
    return Estimate(*(np.where(unknown > 1.0 - KNOWN, np.nan, part)
                      for part in (found.value, found.low, found.high)))


BOUNDS_MM = (5.0, 3.0)
FEW = 6  # episodes: the order statistics of fewer do not hold their median with 95 %
_CHUNK = 100  # replicates sorted out at a time


@dataclass(frozen=True)
class Reach:
    """How soon an entry's error is first within a bound."""

    share: float
    """Of episodes that reach the bound."""
    median: float
    """When half of all episodes have reached it; infinite where fewer do."""
    low: float
    high: float


def reach(curves: Curves, axis: str, entry: int, bound_mm: float) -> Reach:
    """The median over episodes, every object weighing the same, with its interval. An episode
    without an error never reaches a bound, also on an object where none has one.

    There is no interval of one object's few episodes; that of few objects is widened as they
    deserve.
    """
    at = [np.array([_first(steps, bound_mm) for steps in found[entry]])
          for found in curves.steps[axis]]
    if not at:
        return Reach(np.nan, np.nan, np.nan, np.nan)
    pooled = np.concatenate(at)
    order = np.argsort(pooled, kind="stable")
    medians = np.empty(1 + REPLICATES)
    for start in range(0, 1 + REPLICATES, _CHUNK):
        rows = slice(start, start + _CHUNK)
        weights = np.concatenate(
            [_shares(own[rows].astype(float)) * curves.drawn[rows, n][:, None]
             for n, own in enumerate(curves.weights)], axis=1)
        gone = np.cumsum(weights[:, order], axis=1)
        half = (gone >= gone[:, -1:] * (0.5 - 1e-12)).argmax(axis=1)
        medians[rows] = np.where(gone[:, -1] > 0, pooled[order][half], np.nan)
    drawn = medians[1:][~np.isnan(medians[1:])]
    low, high = np.quantile(drawn, INTERVAL, method="inverted_cdf")
    no_scale = medians[0] == 0.0  # as of who touches nothing
    if (curves.draws < FEW) if curves.over == "these" else len(at) < 2 or no_scale:
        low = high = np.nan
    elif curves.over == "like-these" and np.isfinite(medians[0]):  # skewed: on a log scale
        low, high = (medians[0] * (end / medians[0]) ** widening(len(at)) for end in (low, high))
    elif curves.over == "like-these":  # fewer than half of all episodes reach it
        low = np.nan
    return Reach(float(np.mean([np.isfinite(part).mean() for part in at])),
                 float(medians[0]), float(low), float(high))


def _shares(weights: np.ndarray) -> np.ndarray:
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, where=total > 0, out=np.zeros_like(weights))


def _first(steps: tuple[np.ndarray, np.ndarray], bound_mm: float) -> float:
    at, error = steps
    there = error <= bound_mm
    return float(at[there.argmax()]) if there.any() else np.inf


def curves_table(curves: Curves) -> TextTable:
    """The table of `warpgrasp table DIR curves`: a line a point of an entry that has a mean."""
    rows = []
    for axis in AXES:
        for n, label in enumerate(curves.labels):
            grid = grid_of(curves, axis, n)
            found = mean_curve(curves, axis, n, grid)
            rows += [(label, axis, f"{at:.6g}", *(number_text(v, 3) for v in values))
                     for at, *values in zip(grid, found.value, found.low, found.high, strict=True)
                     if np.isfinite(values[0])]
    return TextTable(("strategy", "against", "at", "chamfer_mm", "ci_low", "ci_high"),
                     tuple(rows), (*curves.notes, *once_notes(curves)))


def once_notes(curves: Curves) -> list[str]:
    """Which entries have no curve, and what gives them one."""
    names = [label for n, label in enumerate(curves.labels) if curves.fits_once(n)]
    return [f"{first_few(names)}: fitted once, at the end, so that there is no curve; sequences of "
            "grasps have one with refit_every = 1 of their [[strategy]]"] if names else []


def reach_table(curves: Curves) -> TextTable:
    """The table of `warpgrasp table DIR reach`: touches and seconds to 5 mm and 3 mm."""
    rows = []
    for bound in BOUNDS_MM:
        for n, label in enumerate(curves.labels):
            touches, time = (reach(curves, axis, n, bound) for axis in AXES)
            rows.append((label, f"{bound:g}", number_text(touches.share, 4),
                         *(number_text(v, 0) for v in (touches.median, touches.low, touches.high)),
                         *(number_text(v, 1) for v in (time.median, time.low, time.high))))
    return TextTable(("strategy", "within_mm", "share", "touches", "touches_ci_low",
                      "touches_ci_high", "robot_time_s", "robot_time_s_ci_low",
                      "robot_time_s_ci_high"), tuple(rows), curves.notes)


HEADER = ("strategy", "other", "chamfer_mm_then", "chamfer_mm_difference", "ci_low", "ci_high",
          "wins")


def same_time_table(curves: Curves, against: str | None) -> TextTable:
    """Every strategy minus `against` (`best`: the one of the best mean at its end), at the time its
    episodes ended. Raises LeaderboardError."""
    if against is None or against not in ("best", *curves.labels):
        asked = "is needed" if against is None else f"is {against!r}"
        raise LeaderboardError(f"same-time: --against {asked}; should be best or an entry's name; "
                               f"{choose(against, ['best', *curves.labels])}")
    if not curves.objects:
        raise LeaderboardError("same-time: no block of episodes is finished for every strategy "
                               "yet; `warpgrasp status` says how far it is")
    other = int(np.argmin(_last_means(curves))) if against == "best" else curves.labels.index(
        against)
    then, difference, objects = errors_then(curves, other)
    rows = []
    for entry, label in enumerate(curves.labels):
        if entry != other:
            wins = f"{int((objects[:, entry] < objects[:, other]).sum())}/{len(objects)}"
            rows.append((label, curves.labels[other], number_text(then[entry], 3),
                         *(number_text(float(v[entry]), 3)
                           for v in (difference.value, difference.low, difference.high)), wins))
    return TextTable(HEADER, tuple(rows), curves.notes)


def _last_means(curves: Curves) -> np.ndarray:
    """Each entry's mean error at the end, over objects (entry,); infinite where there is none."""
    means = [[np.mean([error[-1] for _, error in found]) for found in of_entries]
             for of_entries in curves.steps["time_s"]]
    known = np.isfinite(means)
    total = np.where(known, means, 0.0).sum(axis=0)
    return np.divide(total, known.sum(axis=0), out=np.full(len(total), np.inf),
                     where=known.any(axis=0))


def errors_then(curves: Curves, other: int) -> tuple[np.ndarray, Estimate, np.ndarray]:
    """Mean errors (entry,), differences to `other` with intervals, and the objects' mean errors
    (object, entry), at the time `other` ended [mm].

    Before its first fit an episode has its prior, as it was given. A unit that failed has none
    either: its episodes count as the worst that any entry then had, or was given.
    """
    found = ObjectMeans(len(curves.labels), 0)
    for steps, priors, own in zip(curves.steps["time_s"], curves.priors, curves.episodes,
                                  strict=True):
        errors = np.array([[_error_at(mine, end[0][-1]) for mine, end in
                            zip(of_entry, steps[other], strict=True)] for of_entry in steps])
        errors = np.where(np.isfinite(errors), errors, priors)
        found.add(by_episode(filled(errors, None, priors).T, own))
    means = np.array(found.objects).reshape(-1, len(curves.labels))
    difference = found.differences(other, curves.over, simultaneous=False)
    return found.values(curves.over).value, difference, means


def _error_at(steps: Steps, time_s: float) -> float:
    return float(on_grid(steps, np.array([time_s]))[0])
