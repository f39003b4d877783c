"""What a race has found, in words, as a table, and against equal allocation."""

from dataclasses import dataclass

import numpy as np

from sweeps.analysis.entries import HIGHER_IS_BETTER, bounds_of, digits_of, sign_of
from sweeps.race.elimination import Look, Race, Rules
from sweeps.race.race_units import RaceUnits
from sweeps.text_table import TextTable, number_text


@dataclass(frozen=True)
class Verdict:
    """The end of a race, or how far it is. Arrays are (entry,)."""

    labels: tuple[str, ...]
    metric: str
    over: str
    objects: int
    """Of the study, or, over objects like these, those that the leader has met."""
    rules: Rules
    looks: tuple[Look, ...]
    means: np.ndarray
    """The winner's mean plus each entry's difference to it over the replicates of both; less is
    better, so the sign may be turned."""
    episodes: np.ndarray
    failure_rate: np.ndarray
    """Each entry's share of failed episodes."""
    faults: dict[str, str]
    """Of entries at fault, what the first of their episodes says."""
    last_rung: np.ndarray
    """The rung in which each entry last took episodes."""
    paired: float
    """What pairing is worth (`Race.paired_over_unpaired`)."""
    equal: float
    """Episodes that equal allocation would take (see `equal_replicates`)."""

    @property
    def last(self) -> Look:
        """The last look."""
        return self.looks[-1]

    @property
    def reached(self) -> bool:
        """Whether the best is known within what was asked."""
        return not self.last.open.any()

    @property
    def within(self) -> float:
        """How near to the best the leader is for certain, at the race's confidence; infinite where
        that says nothing."""
        if self.reached:
            return self.rules.within
        return self.last.within if self.last.within < self.room else float("inf")

    @property
    def room(self) -> float:
        """How much better than the leader's mean any mean can be: no score is below 0, no share
        above 1."""
        best = -1.0 if self.metric in HIGHER_IS_BETTER else 0.0
        return float(self.means[self.last.leader]) - best

    @property
    def at_least(self) -> np.ndarray:
        """`Look.at_least`; NaN of open entries where it says nothing."""
        found = self.last.at_least
        return np.where(self.last.open & (found <= -self.room), np.nan, found)

    @property
    def order(self) -> list[int]:
        """Entries, the leader first, then by their difference to it."""
        key = self.last.difference.copy()
        key[self.last.leader] = -np.inf
        return [int(n) for n in np.argsort(key, kind="stable")]


def verdict_of(race: Race, units: RaceUnits) -> Verdict:
    """What a race has found after its last look."""
    count, last = race.count, race.looks[-1]
    objects = (int(count[last.leader]) if units.over == "like-these"
               else units.objects_each)
    return Verdict(tuple(entry.label for entry in units.entries), units.metric, units.over,
                   objects, race.rules, tuple(race.looks),
                   race.means[last.leader] + last.difference,
                   count * units.episodes_each, units.failure_rate, dict(units.faults),
                   race.last_rung.copy(),
                   race.paired_over_unpaired,
                   equal_replicates(race.spread, last.leader, race.rules)
                   * len(count) * units.episodes_each)


def equal_replicates(spread: np.ndarray, leader: int, rules: Rules) -> float:
    """Replicates of every entry, planned in advance, that would tell the best within as much.

    So many that N - 1 one-sided intervals (Bonferroni) of the differences to one entry are each no
    longer than `within`, at the median spread of such a difference.
    """
    from scipy.special import ndtri

    others = np.delete(spread, leader)
    alpha = (1.0 - rules.confidence) / max(len(others), 1)
    return float(np.ceil((ndtri(alpha) * np.median(others) / rules.within) ** 2))


def amount(value: float, metric: str) -> str:
    """A difference with its unit."""
    unit = metric.rpartition("_")[2] if metric.endswith(("_mm", "_s", "_m")) else ""
    return f"{value:.3g} {unit}".rstrip()


def claim(found: Verdict) -> str:
    """The sentence that a race ends with."""
    if not np.isfinite(found.within):
        return "nothing can be claimed yet"
    where = (f"objects like these {found.objects}" if found.over == "like-these" else
             "this object" if found.objects == 1 else f"these {found.objects} objects")
    cap = max(map(abs, found.rules.bounds or (0.0, 0.0)))
    cut = (f", scores cut at {amount(cap, found.metric)}"
           if 0 < cap < bounds_of(found.metric)[1] else "")
    return (f"within {amount(found.within, found.metric)} of the best of {len(found.labels):,} on "
            f"{where}, {100 * found.rules.confidence:.10g} %{cut}")


def summary(found: Verdict) -> dict[str, str]:
    """The lines that a race prints, by what they tell."""
    last, taken = found.last, int(found.episodes.sum())
    names = [verdict_name(last, entry) for entry in range(len(found.labels))]
    tied, worse, left = (names.count(name) for name in ("tied", "worse", "open"))
    sign = sign_of(found.metric)
    times = found.equal / taken
    return {
        "best": found.labels[last.leader],
        "claim": claim(found),
        found.metric: number_text(sign * found.means[last.leader], digits_of(found.metric)),
        "tied": (f"{tied:,} not known to be worse, {worse:,} worse"
                 + (f", {left:,} open" if left else "")),
        "paired": f"{number_text(found.paired, 2)} of the variance of unpaired differences",
        "episodes": f"{taken:,} in {last.number} rung{'s' * (last.number > 1)}",
        "equal": (f"{found.equal:,.0f} if all had as many, planned for "
                  f"{amount(found.rules.within, found.metric)} with all spreads known "
                  f"({times:.2g} times; computed)"),
    }


def verdict_word(verdict: str) -> str:
    """What is shown for a verdict. A tied entry may be far behind: all that is known is that it is
    not better than the best by more than the margin."""
    return "not better" if verdict == "tied" else verdict or "open"


def verdict_name(look: Look, entry: int) -> str:
    """What is known of an entry: best, worse, open or tied."""
    if entry == look.leader:
        return "best"
    return "worse" if look.out[entry] else "open" if look.open[entry] else "tied"


def race_table(found: Verdict) -> TextTable:
    """A row for each entry, the winner first: what `race.csv` holds."""
    last, metric = found.last, found.metric
    digits = digits_of(metric)
    sign = sign_of(metric)
    rows = tuple((
        str(rank), found.labels[n], number_text(sign * float(found.means[n]), digits),
        number_text(float(last.difference[n]), digits),
        number_text(float(found.at_least[n]), digits), verdict_name(last, n),
        str(found.last_rung[n]), str(found.episodes[n]),
        number_text(float(found.failure_rate[n]), 4))
        for rank, n in enumerate(found.order, 1))
    return TextTable(("rank", "strategy", metric, "worse_by", "worse_by_at_least", "verdict",
                      "last_rung", "n_episodes", "failure_rate"), rows)
