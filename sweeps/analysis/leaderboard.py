"""The leaderboard of a study: strategies ranked by a metric, each with two intervals.

An entry is a strategy, under each setting of the grid and zip axes; Sobol and Latin hypercube
axes are draws of a nuisance and are averaged over: an episode repeated at many points counts once.
Entries are compared on the same objects and episodes. A failed episode counts too, or failing
would pay: it scores what its row has (the prior body) or, where the row has no number, IoU and
coverage 0 and the largest distance that any entry had on that object, or was given. `failure_rate`
is the share of failed episodes.

The last row, `given-prior`, is not ranked (NA): it is what an entry scores that touches nothing
(`entries.references_of`). `worse_than_prior` flags the entries that are worse. An entry without a
value has no rank (empty). Entries of equal means share one.

`_ci_` columns are of objects like these, `_these_` columns of these objects with other episodes;
see `interval`. Differences to the best hold for all entries at once.
"""

import hashlib
from collections.abc import Iterator, Sequence
from math import isclose
from typing import Any

import numpy as np

from sweeps.analysis.entries import (
    CHANCES,
    COSTS,
    FAULTS,
    METRICS,
    ROUNDING,
    SCORES,
    Entry,
    LeaderboardError,
    Reference,
    asked_to_recognize,
    bounds_of,
    check_metric,
    digits_of,
    entries_of,
    entry_axes,
    fault_line,
    fault_of,
    prior_column,
    references_of,
    sign_of,
)
from sweeps.analysis.interval import NOTHING_KNOWN, ObjectMeans, sensible_ends
from sweeps.analysis.paired import (
    MANY_OBJECTS,
    NO_OBJECTS,
    ObjectRows,
    by_episode,
    certain_notes,
    few_episodes_note,
    lost_notes,
    read_objects,
)
from sweeps.run.plan import Plan, same_bodies
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns
from sweeps.text_table import TextTable, number_text

__all__ = ["METRICS", "Leaderboard", "LeaderboardError", "make_leaderboard"]
Leaderboard = TextTable
PLAIN = {"recognized": 4, "touches": 2, "robot_time_s": 2, "failure_rate": 4, "contacts": 2}
"""Columns without an interval, and their digits."""
_DOINGS = ("iou", "touches", "robot_time_s", "contacts", "recognized")
"""Columns by which two entries are told to do the same."""
FEW_CONTACTS = 8.0
"""Contacts of an episode, in the mean, below which hardly any fit is possible."""
MOST_LINES = 6
"""Of notes of one kind; the others are counted."""
MORE = "more like that"
"""How the note ends that counts them."""


class _Faults:
    """What the rows of the entries tell besides numbers."""

    def __init__(self) -> None:
        self.first: dict[str, str] = {}  # of each entry, why its first episode failed
        self.noted: dict[str, list[Any]] = {}  # episodes with notes that touched, all, the first
        self.names_objects: set[str] = set()  # entries that were asked what the objects are
        self.silent: dict[tuple[str, str], list[Any]] = {}  # entry, object: untouched, all, why
        self.units: dict[str, list[int]] = {}  # of each entry, units that failed, and all

    def __call__(self, entry: Entry, rows: Columns) -> None:
        if fault := fault_of(rows):
            self.first.setdefault(entry.label, fault)
        nothing = np.full(len(rows["status"]), "")
        columns = {"note": nothing, "object": nothing, "contacts": nothing == "", **rows}
        for note, status, name, contacts in zip(
                *(columns[c] for c in ("note", "status", "object", "contacts")), strict=True):
            failed = status in FAULTS
            noted = self.noted.setdefault(entry.label, [0, 0, ""])
            noted[1] += 1
            if note and contacts and not failed:
                noted[0] += 1
                noted[2] = noted[2] or note
            count = self.silent.setdefault((entry.label, name), [0, 0, ""])
            count[0] += not (contacts or failed)
            count[1] += 1
            count[2] = count[2] or ("" if contacts or failed else note)
        units = self.units.setdefault(entry.label, [0, 0])
        units[0] += bool((rows["status"] == "unit_failed").all())
        units[1] += 1
        if asked_to_recognize(rows):
            self.names_objects.add(entry.label)

    def failed_units(self) -> list[str]:
        """Entries of which units failed, those with the most first."""
        found = sorted((-failed, label, of) for label, (failed, of) in self.units.items() if failed)
        return [f"{label}: {-failed} of {of} units failed (see logs/*.failed.log); their episodes "
                "count as the worst that any entry had or was given" for failed, label, of in found]

    def notes(self) -> list[str]:
        """Why strategies failed, and what notes say of episodes that touched something."""
        return [*(fault_line(label, why) for label, why in sorted(self.first.items())),
                *(f"strategy {label}: {count} of {of} episodes have a note; the first: {note}"
                  for label, (count, of, note) in sorted(self.noted.items()) if count)]

    def untouched(self) -> list[str]:
        """Where half of an entry's episodes or more touched nothing of an object, and why."""
        found = [(count, label, name, why) for (label, name), (count, of, why)
                 in self.silent.items() if count and 2 * count >= of]
        return [f"{label} touches nothing of {name} in {count} of {self.silent[label, name][1]} "
                 f"episodes; in one {why or 'it did not try'}"
                 for count, label, name, why in sorted(found, key=lambda f: (-f[0], *f[1:3]))]


class ReferenceMeans:
    """Means over objects of every entry and, after them, of every reference, episode by episode."""

    def __init__(self, references: Sequence[Reference], entries: int, metric: str,
                 seed: int) -> None:
        self.references, self.entries, self.metric = references, entries, metric
        self.means = ObjectMeans(entries + len(references), seed, chances=metric in CHANCES)

    def add(self, values: np.ndarray, of_prior: np.ndarray | None) -> None:
        """An object's episodes of the entries and of their priors, (episode, entry) each."""
        if of_prior is None:
            nothing = 0.0 if self.metric in COSTS else np.nan
            of_prior = np.full(values.shape, nothing)
        self.means.add(np.column_stack([values, *(
            _mean([*of_prior[:, list(r.entries)].T], len(values)) for r in self.references)]))

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
                rounding = ROUNDING * abs(self.means.values("these").value[n])
                found[n] = ("no" if not sign * apart.value[n] > rounding else
                            "yes" if ends[0] > 0.0 else "mean")
        return found

    def columns(self, best: int) -> dict[str, np.ndarray]:
        """The numbers of the references' rows, (reference,) each; entry `best` is the first."""
        own, metric = slice(self.entries, None), self.metric
        found = {}
        for over, name in (("like-these", "ci"), ("these", "these")):
            value = sensible_ends(self.means.values(over, bounds_of(metric)))
            delta = self.means.differences(best, over, simultaneous=False)
            found |= {metric: value.value, f"{metric}_{name}_low": value.low,
                      f"{metric}_{name}_high": value.high, "delta": delta.value,
                      f"delta_{name}_low": delta.low, f"delta_{name}_high": delta.high}
        return {name: values[own] for name, values in found.items()}

    def by_choice(self, best: int, sign: float) -> Iterator[str]:
        """References that are worse than entry `best` only if that was not chosen of them all."""
        for over, name in (("like-these", "delta_ci_"), ("these", "delta_these_")):
            alone, together = (self.means.differences(best, over, all_) for all_ in (False, True))
            for n, reference in enumerate(self.references, self.entries):
                far, near = (min(sign * e.low[n], sign * e.high[n]) for e in (alone, together))
                if far > 0.0 >= near:
                    yield (f"{name} of {reference.label} excludes 0 for one entry alone; the best "
                           f"of {self.entries} may be as good by luck")


class _Ranking:
    """Sums over the objects of one ranking."""

    def __init__(self, entries: Sequence[Entry], references: Sequence[Reference], metric: str,
                 seed: int) -> None:
        self.entries, self.metric = entries, metric
        self.sign = sign_of(metric)
        self.references = references
        self.means = {name: ObjectMeans(len(entries), seed, chances=name in CHANCES)
                      for name in {metric, "iou"}}
        self.beside_prior = {name: ReferenceMeans(references, len(entries), name, seed)
                             for name in self.means}
        self.plain: dict[str, list[np.ndarray]] = {name: [] for name in PLAIN}
        self.objects = self.episodes = self.first = 0
        self.distinct = 0  # episodes, an episode at many points of an axis counted once
        self.lost: list[str] = []  # objects on which no episode has a value
        self.did: list[bytes] = [b""] * len(entries)  # a digest of all that each entry did

    def add(self, found: ObjectRows) -> None:
        """Takes in an object's rows; one on which no episode has a value does not count."""
        for name, mean in self.means.items():
            values, column = found.filled(name), prior_column(name)
            mean.add(values)
            self.beside_prior[name].add(values, None if column is None else by_episode(
                found.values[column], found.episodes))
        for name, of_objects in self.plain.items():
            of_objects.append(found.plain(name))
        for n, before in enumerate(self.did):
            self.did[n] = hashlib.sha256(before + b"".join(
                found.values[name][:, n].tobytes() for name in _DOINGS)).digest()
        values = found.filled(self.metric)
        if not np.isfinite(values).all():
            self.lost.append(found.name)
            return
        self.objects += 1
        self.episodes += len(found.episodes)
        self.distinct += len(values)

    def rows(self, label: str, faults: _Faults) -> list[tuple[str, ...]]:
        """The rows of a leaderboard, the best first."""
        metric, found = self.metric, self.means[self.metric]
        sign = self.sign
        value = sensible_ends(found.values("like-these", bounds_of(metric)))
        key = np.where(np.isfinite(value.value), sign * value.value, np.inf)
        order = sorted(range(len(self.entries)), key=lambda n: (key[n], self.entries[n].label))
        self.first, these = order[0], sensible_ends(found.values("these", bounds_of(metric)))
        delta, delta_these = (found.differences(order[0], over) for over in ("like-these", "these"))
        iou = self.means["iou"].values("like-these", bounds_of("iou"))
        digits = digits_of(metric)
        columns: dict[str, tuple[np.ndarray, int]] = {
            **{name: (_mean(self.plain[name], len(self.entries)), PLAIN[name]) for name in PLAIN},
            "iou": (iou.value, 4), "iou_ci_low": (iou.low, 4), "iou_ci_high": (iou.high, 4),
            metric: (value.value, digits), f"{metric}_ci_low": (value.low, digits),
            f"{metric}_ci_high": (value.high, digits), _delta(metric): (delta.value, digits),
            "delta_ci_low": (delta.low, digits), "delta_ci_high": (delta.high, digits),
            "p_best": (found.p_best(sign), 3), f"{metric}_these_low": (these.low, digits),
            f"{metric}_these_high": (these.high, digits),
            "delta_these_low": (delta_these.low, digits),
            "delta_these_high": (delta_these.high, digits)}
        rows, worse = [], self.beside_prior[metric].worse(sign)
        rank, before = 0, np.nan
        for place, n in enumerate(order, 1):
            if not isclose(key[n], before, rel_tol=ROUNDING):  # equal means share a rank
                rank, before = place, key[n]
            name = self.entries[n].label
            cells = {column: number_text(values[n], places)
                     for column, (values, places) in columns.items()}
            cells["worse_than_prior"] = worse[n]
            if name not in faults.names_objects:
                cells["recognized"] = "NA"
            known = np.isfinite(value.value[n])
            rows.append(self._row(cells, str(rank) if known else "", name, label))
        return [*rows, *self._reference_rows(order[0], digits, label)]

    def _row(self, cells: dict[str, str], rank: str, name: str, label: str) -> tuple[str, ...]:
        if label:
            name = f"{name[:-1]}, {label}]" if name.endswith("]") else f"{name} [{label}]"
        cells |= {"rank": rank, "strategy": name, "n_objects": str(self.objects),
                  "n_episodes": str(self.episodes)}
        return tuple(cells.get(column, "NA") for column in _header(self.metric))

    def _reference_rows(self, best: int, digits: int, label: str) -> Iterator[tuple[str, ...]]:
        """The rows of the references, where rows of the study tell of them."""
        if not self.beside_prior[self.metric].known:
            return
        of_metric = self.beside_prior[self.metric].columns(best)
        of_iou = self.beside_prior["iou"].columns(best)
        own = {name: (values, digits) for name, values in of_metric.items()} | {
            name: (values, 4) for name, values in of_iou.items() if name.startswith("iou")}
        own[_delta(self.metric)] = own.pop("delta")
        for number, reference in enumerate(self.references):
            cells = {name: number_text(0.0, PLAIN[name])
                     for name in ("touches", "robot_time_s", "contacts")}
            cells |= {name: number_text(values[number], places)
                      for name, (values, places) in own.items()}
            yield self._row(cells, "NA", reference.label, label)

    def worse_than_prior(self) -> list[str]:
        """What there is to say of entries that are worse than what they were given."""
        beside = self.beside_prior[self.metric]
        worse, lines = beside.worse(self.sign), []
        for number, reference in enumerate(self.references):
            for n in (n for n in reference.entries if worse[n] in ("yes", "mean")):
                apart = beside.means.differences(beside.entries + number, "these")
                value = beside.means.values("these").value
                low, high = sorted((self.sign * apart.low[n], self.sign * apart.high[n]))
                sure = ("" if worse[n] == "yes" else ": in the mean, which may be chance")
                says = high - low <= NOTHING_KNOWN * value[n]  # not NaN, nor beyond all reason
                by = f", by {low:.2f} to {high:.2f} on these objects" if says else ""
                lines.append((-float(self.sign * apart.value[n]), (
                    f"{self.entries[n].label} is worse than {reference.label}, {value[n]:.2f} "
                    f"against {value[beside.entries + number]:.2f}{by}{sure}")))
        return [line for _, line in sorted(lines)]

    def alike(self) -> Iterator[str]:
        """Entries that touched, and did the same as another one in every episode."""
        first: dict[bytes, str] = {}
        touches = np.nan_to_num(_mean(self.plain["touches"], len(self.entries)))
        for entry, did, made in zip(self.entries, self.did, touches, strict=True):
            if made > 0.0 and (other := first.setdefault(did, entry.label)) != entry.label:
                yield (f"{entry.label} did the same as {other} in every episode: what differs "
                       "between them changes nothing here")

    def rarely_touching(self) -> Iterator[tuple[str, float]]:
        """Entries with few contacts, and how many they have in the mean."""
        contacts = _mean(self.plain["contacts"], len(self.entries))
        for entry, mean in zip(self.entries, contacts, strict=True):
            if mean < FEW_CONTACTS:
                yield entry.label, float(mean)


def make_leaderboard(plan: Plan, stores: Sequence[Store], metric: str = "chamfer_mm",
                     by: Sequence[str] | None = None) -> Leaderboard:
    """Reads a study's units once; memory grows with the episodes of one object."""
    check_metric(metric)
    axes, per_object = entry_axes(plan, by)
    entries = entries_of(plan, axes)
    references = references_of(plan, entries)
    faults, seed, missing = _Faults(), int(plan.hash, 16), 0
    rankings: dict[str, _Ranking] = {}
    alike: list[tuple[str, str]] = []
    for found in read_objects(plan, stores, entries, axes, (metric, "iou", *PLAIN), faults):
        missing += found.missing
        label = f"object={found.name}" if per_object else ""
        ranking = rankings.setdefault(label, _Ranking(entries, references, metric, seed))
        if found.episodes:
            ranking.add(found)
            alike += [(entries[n].label, found.name) for n in found.all_alike(metric)]
    rows = [row for label, ranking in rankings.items() for row in ranking.rows(label, faults)]
    measured = max(ranking.objects for ranking in rankings.values())
    most = max(ranking.distinct for ranking in rankings.values())
    lost = [name for ranking in rankings.values() for name in ranking.lost]
    notes = [*_notes(plan, missing, measured), *few_episodes_note(measured, most),
             *few_lines([*same_bodies(plan.study)]),
             *few_lines([*lost_notes(lost, metric)]),
             *few_lines([*certain_notes(alike, metric)]),
             *few_lines(faults.failed_units()),
             *few_lines(faults.notes())]
    for label, ranking in rankings.items():
        where = f" ({label})" if label else ""
        notes += few_lines([
            f"{name} hardly ever touches{where}: {mean:.1f} contacts an episode in the mean"
            for name, mean in ranking.rarely_touching()])
        notes += few_lines([line + where for line in ranking.worse_than_prior()])
        notes += few_lines([line + where for line in ranking.beside_prior[metric].by_choice(
            ranking.first, ranking.sign)])
        notes += few_lines([line + where for line in ranking.alike()])
    notes += few_lines(faults.untouched())
    return Leaderboard(_header(metric), tuple(rows), tuple(notes))


def few_lines(lines: list[str]) -> list[str]:
    """The first of many notes of one kind, and how many there are."""
    more = len(lines) - MOST_LINES
    return lines if more <= 1 else [*lines[:MOST_LINES], f"and {more} {MORE}"]


def _mean(of_objects: Sequence[np.ndarray], entries: int) -> np.ndarray:
    """The mean over the objects that have a value, (entry,)."""
    values = np.array(of_objects).reshape(len(of_objects), entries)
    known = np.isfinite(values)
    return np.divide(np.where(known, values, 0.0).sum(axis=0), known.sum(axis=0),
                     where=known.any(axis=0), out=np.full(entries, np.nan))


def _delta(metric: str) -> str:
    return "delta_to_best_mm" if metric.endswith("_mm") else "delta_to_best"


def _header(metric: str) -> tuple[str, ...]:
    iou = ("iou", "iou_ci_low", "iou_ci_high") if metric != "iou" else ()
    rest = tuple(name for name in PLAIN if name != metric)
    return ("rank", "strategy", metric, f"{metric}_ci_low", f"{metric}_ci_high", _delta(metric),
            "delta_ci_low", "delta_ci_high", "p_best", *iou, *rest, "n_objects", "n_episodes",
            f"{metric}_these_low", f"{metric}_these_high", "delta_these_low", "delta_these_high",
            "worse_than_prior")


def _notes(plan: Plan, missing: int, count: int) -> Iterator[str]:
    if missing:
        yield (f"{missing} of {plan.unit_count} units are missing; blocks of episodes that not "
               "every entry has are left out")
    if count == 0:
        yield NO_OBJECTS
    elif count < MANY_OBJECTS:
        of = "one object" if count == 1 else f"{count} objects"
        yield (f"the ranking is of {of}: how entries would do on others is hardly known below "
               f"{MANY_OBJECTS}")
