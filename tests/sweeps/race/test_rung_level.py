"""The level at rungs: against simulated walks, and the tail of a single look."""

import numpy as np
import pytest
from scipy.stats import norm

from sweeps.race.confidence_sequence import asymptotic_multiple
from sweeps.race.rung_level import crossing_probability, level_at_rungs, rungs_from


def crossed(counts: np.ndarray, bounds: np.ndarray, walks: int) -> float:
    """How often simulated walks are above their bound at any of these numbers of draws."""
    steps = np.diff(counts, prepend=0.0)
    rng = np.random.default_rng(5)
    sums = (rng.standard_normal((walks, len(counts))) * np.sqrt(steps)).cumsum(axis=1)
    return float((sums > bounds * np.sqrt(counts)).any(axis=1).mean())


@pytest.mark.parametrize("bound", [1.0, 2.0, 3.0])
def test_the_chance_to_cross_is_that_of_simulated_walks(bound: float) -> None:
    counts = rungs_from(8, 1)[:12]
    bounds = bound + 0.02 * np.arange(12)
    found = crossing_probability(counts, bounds)
    assert found == pytest.approx(crossed(counts, bounds, 200_000), rel=0.06)


def test_one_look_has_its_own_tail_and_bounds_in_vain_are_never_crossed() -> None:
    assert crossing_probability(np.array([8.0]), np.array([2.5])) == pytest.approx(norm.sf(2.5))
    assert crossing_probability(np.array([8.0, 11.0]), np.array([2.5, 60.0])) == pytest.approx(
        norm.sf(2.5))


@pytest.mark.parametrize("alpha", [0.05, 2e-3, 5e-5, 5e-8])
@pytest.mark.parametrize("start", [2, 8])
def test_the_level_is_raised_and_kept(alpha: float, start: int) -> None:
    level = level_at_rungs(start, alpha, 1)
    counts = rungs_from(start, 1)
    bounds = asymptotic_multiple(counts, level)
    chance = crossing_probability(counts, bounds)
    assert 0.7 * alpha < chance < alpha
    one_look = norm.sf(bounds.min())  # beside the rungs
    assert chance + one_look == pytest.approx(alpha, rel=0.01)
    assert 1.5 * alpha < level < 6.0 * alpha


def test_walks_stay_below_the_bound_at_rungs() -> None:
    counts = rungs_from(8, 1)
    bounds = asymptotic_multiple(counts, level_at_rungs(8, 0.02, 1))
    assert 0.012 < crossed(counts, bounds, 100_000) < 0.021
