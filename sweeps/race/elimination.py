"""The method of a race: rungs, the leader, who is worse, who need not be looked at further.

Entries are compared over the same replicates; a replicate is an episode on each object (or, for
objects like these, one object). An entry's score is its mean, less is better. At every rung one
entry leads, and of each other one a lower bound of its mean minus the leader's is known:

- above zero, even at the level at which all pairs hold together: it is worse, and out for good;
- at least -delta: it is not better than the leader by more than the indifference zone delta
  (`within`), and takes no more episodes while that leader leads;
- below that: it is open, and takes part in the next rung, as does the leader, unless it is ahead.

The race ends when none is open. Then the leader is within delta of the best. For let a* be the best
entry: were the leader b worse by more than delta, or a* out, a bound of a* minus some b would be
above the truth. That happens with a chance of at most 1 - confidence, if each of the N - 1 bounds
has a chance of (1 - confidence) / (N - 1) over all looks together. So the union is over entries and
not over pairs, and neither the choice of the leader nor the time to stop costs anything. That any
entry is called worse than a leader and is not has at most the same chance, since that takes a bound
at 1 / N of this level, for each of N (N - 1) ordered pairs.

Ended early, by a budget, the leader is within minus the lowest bound. The indifference zone is
Bechhofer's (1954, Annals of Mathematical Statistics 25); elimination with common random numbers is
Kim and Nelson's (2001, A fully sequential procedure for indifference-zone selection in simulation,
ACM TOMACS 11).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.race.confidence_sequence import rare_loss, safe_lower, stratified_lower
from sweeps.race.rung_level import level_at_rungs, next_rung

START = 8
"""Replicates of the first rung. See docs/race.md for what fewer would risk."""
CANDIDATES = 8
"""Entries of the lowest means; where the leader leaves as few or fewer open, and another none, that
one leads."""
STAYS = 0.5
"""A leader stays, though another has a lower mean by less than half of `within`, where the race
should need less than this share of the replicates that it needs if the other one leads."""
RARE = 0.2
"""The level for rare losses, as a share of a bound's: few of them, drawn early or late, are looked
at in many rungs. Simulated in docs/race.md."""
MOST_TIMES = 30.0
"""A bound is not taken to need more than this squared times the replicates that it has."""


@dataclass(frozen=True)
class Rules:
    """What a race is to find out, and how."""

    within: float
    """The indifference zone, in units of the score."""
    confidence: float = 0.95
    start: int = START
    bounds: tuple[float, float] | None = None
    """Of scores, which are cut there; with them the bounds of differences are safe, without,
    asymptotic."""
    budget: int | None = None
    """Replicates of all entries together, at most."""
    most: int | None = None
    """Replicates that there are."""
    everyone: bool = False
    """All entries take part in every rung: nobody is eliminated."""
    whole: int = 1
    """Rungs end at multiples of it."""


@dataclass(frozen=True)
class Look:
    """What was known after a rung."""

    number: int
    replicates: np.ndarray
    """Of every entry so far, (entry,)."""
    leader: int
    difference: np.ndarray
    """Each entry's mean minus the leader's over the replicates of both, (entry,)."""
    lower: np.ndarray
    """Its lower bound, (entry,); 0 for the leader; of those that are out at the stricter level."""
    out: np.ndarray
    """Entries that are worse than a leader was, bool (entry,)."""
    open: np.ndarray
    """Entries that may still be better than the leader by more than `within`, bool (entry,)."""

    @property
    def within(self) -> float:
        """The leader is so near to the best, at the race's confidence; infinite if unknown."""
        return max(0.0, float(-self.lower[~self.out].min()))

    @property
    def at_least(self) -> np.ndarray:
        """By how much each entry is worse than the leader at least, (entry,); 0 or less of those
        that are not out: at their level one that is above 0 may well be chance. Of those that an
        earlier leader put out it may be below 0, too."""
        return np.where(self.out, self.lower, np.minimum(self.lower, 0.0))

    @property
    def tied(self) -> np.ndarray:
        """Entries not known to be worse than the leader, bool (entry,)."""
        return ~self.out

    @property
    def total(self) -> int:
        """Replicates of all entries together."""
        return int(self.replicates.sum())


Part = tuple[int, int, int]
"""An entry, and the replicates `start` to `stop` that are asked of it."""


@dataclass(frozen=True)
class Unknown:
    """What is not known of some scores, because episodes failed without one."""

    shares: Sequence[np.ndarray]
    """Of each entry that was asked, how much of a replicate's score it is, (stratum, replicate)."""
    costs: np.ndarray
    """What that counts as now, also in the replicates of earlier rungs: (stratum, 1), or of each
    replicate (stratum, replicate)."""


class Race:
    """A race of some entries, rung by rung: ask, sample, take, until nothing is asked.

    What is asked depends on the scores and the rules alone.
    """

    def __init__(self, entries: int, rules: Rules) -> None:
        self.rules = rules
        self.looks: list[Look] = []
        self._scores: list[np.ndarray] = [np.zeros((0, 0))] * entries
        self._known = list(self._scores)  # the same without what is not known,
        self._shares = list(self._scores)  # and how much of each that is
        self._out = np.zeros(entries, bool)
        self._running = np.ones(entries, bool)
        self.last_rung = np.zeros(entries, int)
        """The rung in which each entry last took part, (entry,)."""

    @property
    def count(self) -> np.ndarray:
        """Replicates of every entry so far, (entry,)."""
        return np.array([values.shape[1] for values in self._scores])

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation of a replicate's difference to the leader, (entry,); 0 for it."""
        leader = self._scores[self.looks[-1].leader]
        found = []
        for values in self._scores:
            shared = min(values.shape[1], leader.shape[1])
            apart = values[:, :shared] - leader[:, :shared]
            found.append(np.sqrt(apart.var(axis=1, ddof=1).sum()) / len(apart))
        return np.array(found)

    @property
    def paired_over_unpaired(self) -> float:
        """The variance of a difference to the leader over the same replicates, over that of as many
        drawn anew for each: the median over entries, NaN where nothing varies."""
        leader = self._scores[self.looks[-1].leader]
        found = []
        for values in self._scores:
            shared = min(values.shape[1], leader.shape[1])
            mine, other = values[:, :shared], leader[:, :shared]
            unpaired = float((mine.var(axis=1) + other.var(axis=1)).sum())
            if values is not leader and unpaired > 0.0:
                found.append(float((mine - other).var(axis=1).sum()) / unpaired)
        return float(np.median(found)) if found else float("nan")

    @property
    def means(self) -> np.ndarray:
        """Every entry's mean over its own replicates, (entry,)."""
        return np.array([values.mean() for values in self._scores])

    def asked(self) -> list[Part]:
        """What the next rung needs; nothing where the race is over or its budget is spent."""
        count = self.count
        stop = np.array([next_rung(int(n), self.rules.start, self.rules.whole) for n in count])
        stop = np.where(self._running, np.minimum(stop, self.rules.most or stop), count)
        stop = _affordable(count, stop, self.rules.budget)
        if stop.max() < 2:
            return []
        return [(int(e), int(count[e]), int(stop[e])) for e in np.flatnonzero(stop > count)]

    def take(self, asked: Sequence[Part], found: Sequence[np.ndarray],
             worst: np.ndarray | None = None, unknown: Unknown | None = None) -> Look:
        """Takes in the scores of what was asked, each (stratum, replicate), less being better.

        `worst` (stratum,) is how bad a replicate may be, though none was so bad yet. What is
        `unknown` is no part of the scores, and counts as much in all rungs, so that entries stay
        paired.
        """
        number = len(self.looks) + 1
        shares = unknown.shares if unknown else [np.zeros_like(values) for values in found]
        for (entry, start, _), values, share in zip(asked, found, shares, strict=True):
            for kept, new in ((self._known, values), (self._shares, share)):
                kept[entry] = (np.concatenate([kept[entry], new], axis=1) if start
                               else np.asarray(new, float))
            self.last_rung[entry] = number
        self._scores = [self._complete(entry, unknown) for entry in range(len(self._known))]
        before = self.looks[-1].leader if self.looks else None
        look = judge(number, self._scores, self._out, self.rules, before, worst)
        self.looks.append(look)
        self._out = look.out
        count = look.replicates
        self._running = look.open.copy()
        self._running[look.leader] = (count[look.open] >= count[look.leader]).any()
        if self.rules.everyone and look.open.any():
            self._running[:] = True
        return look

    def _complete(self, entry: int, unknown: Unknown | None) -> np.ndarray:
        """An entry's scores as they count now, cut at the rules' bounds."""
        values, shares = self._known[entry], self._shares[entry]
        if unknown is not None and shares.any():
            values = values + shares * unknown.costs[:, :shares.shape[1]]
        return np.clip(values, *self.rules.bounds) if self.rules.bounds else values


def _affordable(count: np.ndarray, stop: np.ndarray, budget: int | None) -> np.ndarray:
    """How far entries can go with a budget: all that take part by the same share of their step."""
    if budget is None or stop.sum() <= budget:
        return stop
    step = stop - count
    left = max(0, budget - int(count.sum()))
    return count + step * left // max(1, int(step.sum()))


def judge(number: int, scores: Sequence[np.ndarray], out: np.ndarray, rules: Rules,
          before: int | None = None, worst: np.ndarray | None = None) -> Look:
    """The look after a rung. Of the entries with most replicates leads the one of the lowest mean;
    or the leader `before`, where it is about as good and the race should end far sooner; or another
    of the lowest means, if that one leaves none open. A replicate may be as bad as any was so far,
    or `worst` (stratum,)."""
    count = np.array([values.shape[1] for values in scores])
    seen = np.max([values.max(axis=1) for values in scores if values.size], axis=0)
    most = seen if worst is None else np.maximum(seen, worst)
    means = np.array([values.mean() if values.size else np.inf for values in scores])
    may_lead = np.flatnonzero(~out & (count == count.max()))
    best = may_lead[np.argsort(means[may_lead], kind="stable")][:CANDIDATES]
    first = _against(int(best[0]), number, scores, count, out, rules, most)
    if (first.open.any() and before is not None and before != best[0] and before in may_lead
            and means[before] - means[best[0]] < rules.within / 2.0):
        stays = _against(before, number, scores, count, out, rules, most)
        if replicates_left(stays, rules.within) < STAYS * replicates_left(first, rules.within):
            first = stays
    if not 0 < first.open.sum() <= CANDIDATES:
        return first
    others = (_against(int(leader), number, scores, count, out, rules, most) for leader in best
              if leader != first.leader)
    return next((look for look in others if not look.open.any()), first)


def replicates_left(look: Look, within: float) -> float:
    """How many more replicates the open entries should take until none is open, if that leader
    stays and differences are as they seem; bounds close in as one over their root."""
    apart = look.difference[look.open] + within
    half = look.difference[look.open] - look.lower[look.open]
    each = np.divide(half, apart, where=apart > half / MOST_TIMES,
                     out=np.full(len(half), MOST_TIMES))
    return float((look.replicates[look.open] * (np.minimum(each, MOST_TIMES) ** 2 - 1.0)).sum())


def _against(leader: int, number: int, scores: Sequence[np.ndarray], count: np.ndarray,
             out: np.ndarray, rules: Rules, worst: np.ndarray) -> Look:
    """The look if this entry leads."""
    alpha = (1.0 - rules.confidence) / max(len(scores) - 1, 1)
    difference, lower, surely = np.zeros((3, len(scores)))
    others = np.arange(len(scores)) != leader
    for shared in np.unique(np.minimum(count, count[leader])[others]):
        mine = np.flatnonzero(others & (np.minimum(count, count[leader]) == shared))
        apart = np.stack([scores[int(e)][:, :shared] - scores[leader][:, :shared] for e in mine])
        most = float((worst - scores[leader][:, :shared].mean(axis=1)).max())
        difference[mine] = apart.mean(axis=(1, 2))
        lower[mine], surely[mine] = (_lower(apart, level, most, rules)
                                     for level in (alpha, alpha / len(scores)))
    beaten = out | (surely > 0.0)
    return Look(number, count.copy(), leader, difference, np.where(beaten, surely, lower), beaten,
                ~beaten & (lower < -rules.within))


def _lower(apart: np.ndarray, alpha: float, most: float, rules: Rules) -> np.ndarray:
    """Lower bounds of mean differences (case, stratum, replicate). A replicate may rarely be worse
    for the leader, by `most`, whether or not that has been seen.

    What noise and what rare losses may hide is added as the legs of a right triangle: at the level
    of a bound both are not at their worst at once."""
    if rules.bounds is None:
        mean = apart.mean(axis=(1, 2))
        level = level_at_rungs(rules.start, alpha, rules.whole)
        rare = rare_loss(most, apart[0].size, RARE * alpha)
        return mean - np.hypot(mean - stratified_lower(apart, level), rare)
    width = rules.bounds[1] - rules.bounds[0]
    return safe_lower(apart.mean(axis=1), alpha, -width, width)
