"""Intervals of means over objects, and of differences to the best: what is claimed, and of what.

Two populations. *These* objects, with other episodes: the variance of the mean is that of episodes
within each object (a stratified mean), and Student's t has Welch and Satterthwaite's degrees of
freedom. Objects *like these*: an object's mean is one observation, and t has one degree of freedom
less than there are objects; nothing follows from one object. Objects differ in skewed ways, of
which few of them tell little: intervals are widened by the share that Edgeworth's expansion asks
for (Hall 1992, The bootstrap and Edgeworth expansion, 2.6) at an assumed skewness.

Differences to the best are simultaneous: the best is chosen after the fact, so that an interval of
one pair would claim too much. Their half width is that of a single pair times the ratio of the 95 %
quantile of the largest of all studentized differences between as many equal entries to that of one
(Tukey's studentized range, with a standard error for each pair). With two entries it is Student's.

Outcomes that are 0 or 1 may all agree by chance, so that their variance says too little. Theirs is
at least that with two more episodes of an object, one of each outcome (of a difference one without
and half a one each way; Agresti and Caffo 2000, Agresti and Min 2005). The interval of a share is
Wilson's (1927), of as many independent outcomes as have that variance (Korn and Graubard 1998).
"""

from functools import lru_cache

import numpy as np

from sweeps.analysis.bootstrap import Estimate, probability_best, replicate_means

LEVEL = 0.95
_SKEWNESS = 0.8
"""Of objects' means, on a log scale where they are positive, and of their differences [est]:
between strategies and sets of objects it varies from 0 to 2."""
NOTHING_KNOWN = 100.0
"""An interval that reaches so many times as far as a positive mean says nothing."""
_BATCH = 100
_AT_ONCE = 20_000  # pairs: what is worked on stays in the processor's cache
_SIMULATED = 128  # entries; of more, the number of pairs is extrapolated
_FREEDOMS = (1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 15.0, 30.0, 80.0, np.inf)


def _edgeworth_widening(skewness: float) -> float:
    """How much wider Student's interval must be, relatively and times the number of observations.

    For observations as skewed, and as long in the tails as a gamma distribution then is.
    """
    q, kurtosis = 1.96, 1.5 * skewness**2
    return (skewness**2 * (q**4 + 2 * q**2 - 3) / 9 - kurtosis * (q**2 - 3) / 6) / 2


_WIDER = _edgeworth_widening(_SKEWNESS)


def small_sample_widening(objects: int) -> float:
    """By which factor intervals of means over so many objects like these are widened."""
    return 1.0 + _WIDER / objects


class ObjectMeans:
    """Means over objects, then episodes, of every entry, with what their intervals need.

    Objects are added one at a time; of their episodes only sums are kept. Values of `chances` are
    outcomes that are 0 or 1, or means of such.
    """

    def __init__(self, entries: int, seed: int, *, chances: bool = False) -> None:
        self.entries, self.seed, self.chances = entries, seed, chances
        self.objects: list[np.ndarray] = []  # means on each, (entry,)
        self.single: np.ndarray = np.zeros((0, entries))  # the first object's episodes
        self._variance = np.zeros((entries + 1, entries))  # row 0 of values, then of differences
        self._square = np.zeros_like(self._variance)  # with what Satterthwaite's formula adds up
        self._hidden = np.zeros_like(self._variance)  # of chances, beyond what episodes show
        self._shrunk = np.zeros(entries)  # shares with an episode more of each outcome, added up

    def add(self, values: np.ndarray) -> None:
        """Takes in an object's episodes, (episode, entry), all finite; no episodes are no object.

        An object on which nothing has a value (all NaN) is left out.
        """
        if not len(values) or not np.isfinite(values).all():
            return
        count = len(values)
        mean = values.mean(axis=0)
        if not self.objects:
            self.single = values
        self.objects.append(mean)
        apart = values - mean
        # einsum's own loops, not BLAS: sums do not depend on a number of threads
        cov = np.einsum("ne,nf->ef", apart, apart) / max(count - 1, 1) / count
        own = np.diagonal(cov)
        part = np.concatenate([own[None], np.maximum(own[:, None] + own - 2.0 * cov, 0.0)])
        if self.chances:
            least = _least_variance(values)
            self._hidden += np.maximum(least - (part if count > 1 else 0.0), 0.0)
            self._shrunk += (values.sum(axis=0) + 1.0) / (count + 2.0)
            part = np.maximum(part, least)
        self._variance += part if count > 1 else np.nan
        self._square += part**2 / max(count - 1, 1)

    def values(self, over: str, bounds: tuple[float, float] = (-np.inf, np.inf)) -> Estimate:
        """Each entry's mean with its own 95 % interval, within `bounds`."""
        mean = self._mean()
        error, freedom = self._error(over, None)
        if self.chances:
            low, high = _share_ends(mean, error, students_t(freedom),
                                    self._shrunk / max(len(self.objects), 1))
        else:
            low, high = _ends(mean, students_t(freedom) * error, bounds)
        return Estimate(mean, low, high)

    def differences(self, to: int, over: str, simultaneous: bool = True) -> Estimate:
        """Each entry minus entry `to`; intervals hold together unless not `simultaneous`."""
        mean = self._mean()
        error, freedom = self._error(over, to)
        compared = self.entries if simultaneous else 2
        half = critical_difference(compared, freedom) * error
        apart = mean - mean[to]
        most = 1.0 if self.chances else np.inf
        return Estimate(apart, np.maximum(apart - half, -most), np.minimum(apart + half, most))

    def p_best(self, sign: float) -> np.ndarray:
        """The share of bootstrap replicates, widened as few draws deserve, that each entry wins:
        over objects, or of one object over its episodes; `sign` -1 if more is better."""
        one = len(self.objects) < 2
        drawn = [self.single] if one else [mean[None] for mean in self.objects]
        return probability_best(replicate_means(drawn, self.seed), sign)

    def _mean(self) -> np.ndarray:
        if not self.objects:
            return np.full(self.entries, np.nan)
        return np.mean(self.objects, axis=0)

    def _error(self, over: str, to: int | None) -> tuple[np.ndarray, np.ndarray]:
        """Standard errors of the means, or of differences `to` an entry, and degrees of freedom."""
        count, row = len(self.objects), 0 if to is None else 1 + to
        unknown = np.full(self.entries, np.nan), np.full(self.entries, np.nan)
        if over == "these":
            if not count:
                return unknown
            variance, square = self._variance[row], self._square[row]
            freedom = np.divide(variance**2, square, where=square > 0,
                                out=np.full(self.entries, np.inf))
            return np.sqrt(variance) / count, freedom
        if count < 2:
            return unknown
        means = np.array(self.objects)
        apart = means if to is None else means - means[:, [to]]
        error = apart.std(axis=0, ddof=1) / np.sqrt(count) * small_sample_widening(count)
        return (np.sqrt(error**2 + self._hidden[row] / count**2),
                np.full(self.entries, count - 1.0))


def _least_variance(values: np.ndarray) -> np.ndarray:
    """Variances of an object's mean outcomes (episode, entry), with an episode more of each: row 0
    of the entries, then of their differences to each."""
    count = len(values)
    total, product = values.sum(axis=0), np.einsum("ne,nf->ef", values, values)
    square = np.diagonal(product)
    own = (square + 1.0) / (count + 2.0) - ((total + 1.0) / (count + 2.0)) ** 2
    apart = ((square[:, None] + square - 2.0 * product + 1.0) / (count + 2.0)
             - ((total[:, None] - total) / (count + 2.0)) ** 2)
    np.fill_diagonal(apart, 0.0)
    return np.concatenate([own[None], apart]) / count


def _share_ends(share: np.ndarray, error: np.ndarray, quantile: np.ndarray, centre: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray]:
    """Ends of Wilson's interval for as many outcomes as have that error, of shares by `centre`."""
    square = quantile**2 * error**2 / (centre * (1.0 - centre))  # over their number
    middle = (share + square / 2.0) / (1.0 + square)
    half = np.sqrt(square * (share * (1.0 - share) + square / 4.0)) / (1.0 + square)
    return np.maximum(middle - half, 0.0), np.minimum(middle + half, 1.0)


def _ends(mean: np.ndarray, half: np.ndarray, bounds: tuple[float, float]
          ) -> tuple[np.ndarray, np.ndarray]:
    """Ends of intervals, by the delta method on the scale on which a bounded mean is symmetric.

    Errors are skewed to the right: on the scale of the mean itself intervals of few episodes are
    too short above. A positive mean has them on a log scale, a share on a logit scale.
    """
    low, high = bounds
    if low == 0.0 and high == np.inf:
        factor = np.exp(np.divide(half, mean, where=mean > 0, out=np.zeros_like(mean)))
        return mean / factor, mean * factor
    if (low, high) == (0.0, 1.0):
        inside = mean * (1.0 - mean)
        factor = np.exp(np.divide(half, inside, where=inside > 0, out=np.zeros_like(mean)))
        return (mean / (mean + (1.0 - mean) * factor),
                mean * factor / (mean * factor + 1.0 - mean))
    return mean - half, mean + half


def completed(values: np.ndarray) -> np.ndarray:
    """Values (row, point) with their point's mean where they have none, and as far from it
    elsewhere as leaves the variance of that mean what it is; 0 where a point has no value."""
    good = np.isfinite(values)
    rows, known = len(values), good.sum(axis=0)
    mean = np.divide(np.where(good, values, 0.0).sum(axis=0), known, where=known > 0,
                     out=np.zeros(values.shape[1]))
    wider = np.sqrt(np.divide(rows * (rows - 1), known * (known - 1.0), where=known > 1,
                              out=np.ones(values.shape[1])))
    # what is complete stays as it is, bit for bit: its mean is a leaderboard's
    return np.where(good, np.where(known < rows, mean + wider * (values - mean), values), mean)


def sensible_ends(found: Estimate) -> Estimate:
    """The estimate as a table shows it: without ends where they are beyond all reason, such as
    kilometres for a mean of millimetres."""
    senseless = (found.high > 1.0) & (found.high > NOTHING_KNOWN * found.value)
    return Estimate(found.value, *(np.where(senseless, np.nan, end)
                                   for end in (found.low, found.high)))


def students_t(freedom: np.ndarray, comparisons: int = 1) -> np.ndarray:
    """The two-sided 95 % quantile of Student's t, for so many comparisons at once (Bonferroni)."""
    # Not scipy.stats, whose import takes longer than all else that a sweep's parent does.
    from scipy.special import ndtri, stdtrit

    high = 1.0 - (1.0 - LEVEL) / (2 * comparisons)
    return np.where(np.isfinite(freedom), stdtrit(freedom, high), ndtri(high))


def critical_difference(entries: int, freedom: np.ndarray) -> np.ndarray:
    """How many standard errors apart two of so many equal entries are, at most, in 95 % of boards.

    For each pair's degrees of freedom, shape (pair,): simulated at a few and interpolated in their
    reciprocal. Of two entries it is Student's t.
    """
    if entries <= 2:
        return students_t(freedom)
    share = 1.0 / np.clip(freedom, _FREEDOMS[0], np.inf)
    nodes = 1.0 / np.array(_FREEDOMS)[::-1]
    after = np.clip(np.searchsorted(nodes, share), 1, len(nodes) - 1)
    needed = sorted({*after.tolist(), *(after - 1).tolist()})
    high = [np.log(_simulated(entries, _FREEDOMS[::-1][n])) for n in needed]
    return np.where(np.isnan(freedom), np.nan, np.exp(np.interp(share, nodes[needed], high)))


@lru_cache
def _simulated(entries: int, freedom: float) -> float:
    """The quantile from independent normal entries, to two digits."""
    count = min(entries, _SIMULATED)
    generator = np.random.Generator(np.random.Philox(count))
    batches = int(np.clip(4000 // count, 20, 400))
    largest = np.concatenate([_largest(generator, count, freedom) for _ in range(batches)])
    found = float(np.quantile(largest, LEVEL))
    if entries > count:
        found = _more_pairs(found, freedom, (entries / count) ** 2)
    return float(np.ceil(100 * found) / 100)


def _largest(generator: np.random.Generator, count: int, freedom: float) -> np.ndarray:
    """The largest studentized difference of each of some boards, (board,)."""
    mean = generator.standard_normal((_BATCH, count))
    if np.isinf(freedom):
        return np.ptp(mean, axis=1) / np.sqrt(2.0)
    noise = generator.standard_normal((_BATCH, int(freedom), count))
    square = np.empty(_BATCH)
    boards = max(1, _AT_ONCE // count**2)
    for first in range(0, _BATCH, boards):
        some = slice(first, first + boards)
        variance = np.matmul(noise[some].transpose(0, 2, 1), noise[some])  # times `freedom`
        own = np.diagonal(variance, axis1=1, axis2=2).copy()
        variance *= -2.0
        variance += own[:, :, None]
        variance += own[:, None]
        variance[:, np.arange(count), np.arange(count)] = 1.0
        np.maximum(variance, 1e-30 * freedom, out=variance)
        apart = mean[some, :, None] - mean[some, None]
        apart *= apart
        apart /= variance
        square[some] = apart.max(axis=(1, 2))
    return np.sqrt(freedom * square)


def _more_pairs(found: float, freedom: float, times: float) -> float:
    """The quantile for so many times as many pairs, each as likely to be far apart."""
    from scipy.special import ndtr, ndtri, stdtr, stdtrit

    if np.isinf(freedom):
        return float(-ndtri(ndtr(-found) / times))
    return float(-stdtrit(freedom, stdtr(freedom, -found) / times))
