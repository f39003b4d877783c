"""Paired tests between entries, corrected for their number by Holm's method.

Two questions, two tests. *Would it be so on other objects?* The objects' mean differences are
compared by Wilcoxon's signed-rank test: with k objects its p is at least 2^(1-k), so that fewer
than six can prove nothing at 5 %. *Is it so on these objects?* The mean over objects of the mean
differences over episodes is compared with its standard error within the objects (a paired t-test
stratified by object, Welch and Satterthwaite's degrees of freedom); an episode averaged over swept
points is one, at its mean.

The best of a leaderboard is chosen after the fact. Its comparisons therefore count as chosen from
all pairs; those with an entry that was named beforehand count by themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sweeps.analysis.entries import ROUNDING, LeaderboardError, digits_of, sign_of
from sweeps.analysis.paired import Paired
from sweeps.spec.errors import choose
from sweeps.text_table import TextTable, number_text
from warpgrasp.core.plain_text import counted

LEVEL = 0.05


@dataclass(frozen=True)
class Pair:
    """One comparison: `first` minus `second`, with its interval and its p-values."""

    first: str
    second: str
    difference: float
    like_these: tuple[float, float]
    """The 95 % interval of this pair alone, for objects like these."""
    these: tuple[float, float]
    """The same for these objects, with other episodes."""
    wins: int
    """Objects on which `first` is better."""
    p_objects: float
    p_episodes: float
    variance_ratio: float
    """Of the mean difference between paired and unpaired episodes; below 1, pairing helps."""


def compare_pairs(paired: Paired, metric: str, against: str | None = None) -> list[Pair]:
    """Every pair of entries, or each entry against one (`best`: the one of the best mean)."""
    exact, of_objects = paired.statistics(metric), paired.object_means(metric)
    sign = sign_of(metric)
    found = []
    for a, b in _chosen(paired.labels, sign * paired.means[metric][0], against):
        like, these = (exact.differences(b, over, simultaneous=False)
                       for over in ("like-these", "these"))
        differences = _apart(of_objects[:, a], of_objects[:, b])
        episodes = [_apart(values[:, a], values[:, b]) for values in paired.values[metric]]
        found.append(Pair(
            paired.labels[a], paired.labels[b], float(like.value[a]),
            (float(like.low[a]), float(like.high[a])), (float(these.low[a]), float(these.high[a])),
            int((sign * differences < 0).sum()),
            objects_test(differences), episodes_test(episodes),
            variance_ratio([values[:, a] for values in paired.values[metric]],
                           [values[:, b] for values in paired.values[metric]])))
    return found


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """First minus second, in steps of what rounding makes of means: tests ask which differences
    are equal, and 0.3 - 0.2 is not 0.2 - 0.1."""
    step = ROUNDING * float(np.nan_to_num(np.abs([first, second])).max(initial=0.0))
    return np.round((first - second) / step) * step if step > 0.0 else first - second


def _chosen(labels: Sequence[str], key: np.ndarray, against: str | None) -> list[tuple[int, int]]:
    if against is None:
        return list(combinations(range(len(labels)), 2))
    if against == "best":
        if not np.isfinite(key).any():
            raise LeaderboardError("--against best: no entry has a value on any episode, so that "
                                   "none is best")
        other = int(np.nanargmin(key))
    elif against in labels:
        other = list(labels).index(against)
    else:
        raise LeaderboardError(f"--against: no entry {against!r}; "
                               f"{choose(against, ['best', *labels])}")
    return [(n, other) for n in range(len(labels)) if n != other]


def objects_test(differences: np.ndarray) -> float:
    """Wilcoxon's signed-rank test of the objects' differences, two-sided; NaN without objects.

    It is exact: all signs of the ranks that there are are equally likely. Objects without a
    difference tell nothing; equal differences share a rank.
    """
    apart = differences[np.isfinite(differences)]
    if not len(apart):
        return float("nan")
    apart = apart[apart != 0.0]
    size = np.abs(apart)
    above = np.sort(size)
    # Twice the mean rank of equal ones, a whole number.
    rank = np.searchsorted(above, size) + np.searchsorted(above, size, side="right") + 1
    chance = np.ones(1)  # of each sum of the ranks of positive differences
    for each in rank:
        chance = (np.pad(chance, (0, each)) + np.pad(chance, (each, 0))) / 2.0
    least = min(int(rank[apart > 0.0].sum()), int(rank[apart < 0.0].sum()))
    return float(min(1.0, 2.0 * chance[:least + 1].sum()))


def episodes_test(differences: Sequence[np.ndarray]) -> float:
    """A paired t-test stratified by object, two-sided; NaN where the spread is not known. Where all
    episodes of each object differ by the same it is the sign test."""
    from scipy.stats import binomtest, t

    groups = [group[np.isfinite(group)] for group in differences]
    groups = [group for group in groups if len(group)]
    if not groups or min(map(len, groups)) < 2:
        return float("nan")
    mean = float(np.mean([group.mean() for group in groups]))
    parts = np.array([group.var(ddof=1) / len(group) for group in groups]) / len(groups) ** 2
    variance = float(parts.sum())
    if variance == 0.0:
        signs = np.sign(np.concatenate(groups))
        return float(binomtest(int((signs > 0).sum()), max(int((signs != 0).sum()), 1)).pvalue
                     if signs.any() else 1.0)
    freedom = variance**2 / sum(part**2 / (len(group) - 1)
                                for part, group in zip(parts, groups, strict=True))
    return float(2.0 * t.sf(abs(mean) / np.sqrt(variance), freedom))


def variance_ratio(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> float:
    """What common random numbers are worth: the variance of the mean difference over the same
    episodes, over that of as many episodes drawn anew for each entry.

    `first` and `second` hold an array of episodes an object. NaN where neither varies.
    """
    paired = unpaired = 0.0
    for one, other in zip(first, second, strict=True):
        known = np.isfinite(one) & np.isfinite(other)
        count = int(known.sum())
        if count > 1:
            one, other = one[known], other[known]
            paired += float((one - other).var(ddof=1)) / count
            unpaired += float(one.var(ddof=1) + other.var(ddof=1)) / count
    return paired / unpaired if unpaired else float("nan")


def holm(p: np.ndarray, chosen_from: int | None = None) -> np.ndarray:
    """Holm's adjusted p-values (1979); NaN stays NaN and does not count.

    Where these comparisons were chosen from more, `chosen_from` is the number of all: each then has
    at least the value that it has among all of them.
    """
    adjusted = np.full(len(p), np.nan)
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known], kind="stable")]
    count = len(order) + ((chosen_from or len(p)) - len(p))
    scaled = p[order] * (count - np.arange(len(order)))
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return adjusted


def pairs_table(paired: Paired, metric: str, against: str | None = None) -> TextTable:
    """The table of `warpgrasp table DIR pairs`."""
    pairs = compare_pairs(paired, metric, against)
    digits = digits_of(metric)
    entries = len(paired.labels)
    count = entries * (entries - 1) // 2 if against in (None, "best") else len(pairs)
    of_objects = holm(np.array([pair.p_objects for pair in pairs]), count)
    of_episodes = holm(np.array([pair.p_episodes for pair in pairs]), count)
    known = paired.known_objects(metric)
    rows = tuple(
        (pair.first, pair.second, number_text(pair.difference, digits),
         *(number_text(end, digits) for end in (*pair.like_these, *pair.these)),
         f"{pair.wins}/{known}", _p(pair.p_objects), _p(of_objects[n]),
         _p(pair.p_episodes), _p(of_episodes[n]), number_text(pair.variance_ratio, 2))
        for n, pair in enumerate(pairs))
    header = ("strategy", "other", f"{metric}_difference", "ci_low", "ci_high", "these_low",
              "these_high", "wins", "p_objects", "p_objects_holm", "p_episodes", "p_episodes_holm",
              "paired_over_unpaired")
    return TextTable(header, rows, (
        *paired.notes_of_data,
        *_power(known, count, fewer=count > entries - 1),
        *([f"{pairs[0].second} was found to be the best after the fact: _holm counts all "
           f"{count} pairs"] if against == "best" and count > len(pairs) else [])))


def _p(value: float) -> str:
    return "NA" if not np.isfinite(value) else f"{value:.3g}"


def _power(objects: int, pairs: int, fewer: bool) -> list[str]:
    """What the signed-rank test cannot show, however clear the difference; `fewer` says whether
    there could be fewer comparisons."""
    smallest = min(pairs * 2.0 ** (1 - objects), 1.0)
    if not pairs or smallest <= LEVEL:
        return []
    enough = int(np.ceil(1 + np.log2(pairs / LEVEL)))
    or_fewer = ", or fewer comparisons (--against an entry chosen beforehand)" if fewer else ""
    return [f"with {counted(objects, 'object')} and {counted(pairs, 'comparison')} p_objects_holm "
            f"cannot fall below {smallest:.2g}: a claim about other objects needs {enough} "
            f"objects{or_fewer}"]
