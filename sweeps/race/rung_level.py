"""The level at which bounds of the mixture may be looked at after every rung.

The asymptotic bound (`confidence_sequence`) holds after every single draw. A race looks after rungs
only, each a third longer than the last, and the bound is then crossed some three times less often
than its level says. So its level is raised until the chance that a Gaussian walk crosses it at any
rung is what is wanted. The chance is computed as for group-sequential tests (Armitage, McPherson
and Rowe 1969, Repeated significance tests on accumulating data, JRSS A 132): the density of what
has not crossed is carried from rung to rung by quadrature. One look beside the rungs is paid for,
too: a budget may end a race within a rung, and objects may run out there.
"""

from functools import lru_cache

import numpy as np

from sweeps.race.confidence_sequence import asymptotic_multiple

GROWTH = 1.35
"""Of the replicates from rung to rung."""
FARTHEST = 200_000
"""Replicates of an entry, up to which rungs are counted."""
_NODES, _LOWEST = 120, -9.0
_STEPS = 14


def next_rung(stop: int, start: int, whole: int) -> int:
    """Replicates after the rung that follows `stop`; rungs end at multiples of `whole`."""
    return -(-max(start, int(np.ceil(GROWTH * stop))) // whole) * whole


def rungs_from(start: int, whole: int) -> np.ndarray:
    """Replicates after each rung, from the first of `start` on."""
    found = [next_rung(0, start, whole)]
    while found[-1] < FARTHEST:
        found.append(next_rung(found[-1], start, whole))
    return np.array(found, float)


def crossing_probability(counts: np.ndarray, bounds: np.ndarray) -> float:
    """The chance that a Gaussian walk, in standard errors, is above its bound after any of these
    numbers of draws."""
    from scipy.special import ndtr

    node, weight = np.polynomial.legendre.leggauss(_NODES)
    crossed = float(ndtr(-bounds[0]))
    place, share = _rule(node, weight, bounds[0])
    left = share * np.exp(-0.5 * place**2) / np.sqrt(2.0 * np.pi)
    for before, after, bound in zip(counts, counts[1:], bounds[1:], strict=False):
        keep = np.sqrt(before / after)
        spread = np.sqrt(1.0 - keep**2)
        crossed += float((left * ndtr((keep * place - bound) / spread)).sum())
        further, share = _rule(node, weight, bound)
        density = np.exp(-0.5 * ((further[:, None] - keep * place) / spread) ** 2)
        left = share * (density * left).sum(axis=1) / (spread * np.sqrt(2.0 * np.pi))
        place = further
    return crossed


def _rule(node: np.ndarray, weight: np.ndarray, bound: float) -> tuple[np.ndarray, np.ndarray]:
    """Gauss and Legendre's rule below a bound."""
    half = (bound - _LOWEST) / 2.0
    return _LOWEST + half * (node + 1.0), half * weight


@lru_cache
def level_at_rungs(start: int, alpha: float, whole: int) -> float:
    """The level of the mixture whose bound is crossed at the rungs, or at one look beside them,
    with a chance of at most `alpha`."""
    from scipy.special import ndtr

    counts = rungs_from(start, whole)
    low, high = np.log(alpha), np.log(min(10.0 * alpha, 0.45))
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        bounds = asymptotic_multiple(counts, float(np.exp(middle)))
        chance = crossing_probability(counts, bounds) + float(ndtr(-bounds.min()))
        low, high = (middle, high) if chance <= alpha else (low, middle)
    return float(np.exp(low))
