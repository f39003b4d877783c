"""Bounds that hold at every look: against simulated walks, formulas, and Student's distribution."""

import numpy as np
import pytest
from scipy.stats import norm, t

from sweeps.race.confidence_sequence import (
    asymptotic_multiple,
    rare_loss,
    safe_lower,
    stratified_lower,
    students_multiple,
)

LOOKS = 2000


def walks(seed: int, count: int) -> np.ndarray:
    """Means of normal draws of mean 0 and known spread 1 after every draw, (walk, draw)."""
    drawn = np.random.default_rng(seed).standard_normal((count, LOOKS))
    return drawn.cumsum(axis=1) / np.arange(1, LOOKS + 1)


@pytest.mark.parametrize("alpha", [0.2, 0.05, 0.01])
def test_walks_hardly_ever_cross_the_bound(alpha: float) -> None:
    count = np.arange(1, LOOKS + 1)
    bound = asymptotic_multiple(count, alpha) / np.sqrt(count)
    crossed = (walks(1, 3000) > bound).any(axis=1).mean()
    fixed = (walks(1, 3000) > norm.isf(alpha) / np.sqrt(count)).any(axis=1).mean()
    assert 0.3 * alpha < crossed < alpha  # valid, and not idle
    assert fixed > 2 * alpha  # an interval for one look would not do


def test_the_bound_is_near_that_of_one_look() -> None:
    for alpha in (0.05, 1e-3, 5e-5):
        ratio = asymptotic_multiple(np.array([64]), alpha) / norm.isf(alpha)
        assert 1.0 < ratio < 1.8


def test_students_multiple_has_the_same_tail() -> None:
    multiple, freedom = np.array([2.0, 4.0, 5.5]), np.array([3.0, 7.5, 42.0])
    found = students_multiple(multiple, freedom)
    assert np.allclose(t.sf(found, freedom), norm.sf(multiple))
    assert np.isinf(students_multiple(np.array([2.0]), np.array([0.0])))
    assert np.allclose(students_multiple(multiple, np.full(3, 1e9)), multiple)


def test_a_stratified_bound_is_made_of_its_strata() -> None:
    values = np.random.default_rng(2).gamma(2.0, 1.0, (3, 4, 9)) * [[[1.0], [2.0], [4.0], [0.1]]]
    found = stratified_lower(values, 0.01)
    for case, lower in zip(values, found, strict=True):
        errors = [np.var(draws, ddof=1) / 9 / 16 for draws in case]
        freedom = sum(errors) ** 2 / sum(error**2 / 8 for error in errors)
        multiple = -t.ppf(norm.sf(asymptotic_multiple(np.array(9), 0.01)), freedom)
        assert lower == pytest.approx(case.mean() - multiple * np.sqrt(sum(errors)))
    assert np.isinf(stratified_lower(values[:, :, :1], 0.01)).all()
    assert (stratified_lower(values * 0.0, 0.01) == 0.0).all()


@pytest.mark.parametrize("strata", [1, 3])
def test_draws_that_all_agree_may_hide_a_rare_loss(strata: int) -> None:
    """At every look together, the chance that more is lost unseen than is allowed for is alpha."""
    share, alpha = 0.05, 0.1
    lost = np.random.default_rng(6).random((4000, strata, 60)) < share
    wrong = np.zeros(4000, bool)
    for count in range(2, 61):
        unseen = ~lost[:, :, :count].any(axis=(1, 2))
        wrong |= unseen & (rare_loss(1.0, strata * count, alpha) < share)
    assert 0.8 * alpha < wrong.mean() < 1.1 * alpha


def test_a_rare_loss_follows_the_rule_of_three() -> None:
    assert rare_loss(9.0, 300, 0.05) == pytest.approx(9.0 * 3.0 / 300, rel=0.01)
    assert rare_loss(9.0, 1, 0.05) == pytest.approx(9.0 * 0.95)


def test_safe_bounds_hold_for_rare_losses() -> None:
    """One in twenty draws carries all: bounds by the standard error fail, safe ones do not."""
    drawn = (np.random.default_rng(3).random((2000, 300)) < 0.95).astype(float)
    safe = safe_lower(drawn, 0.05, 0.0, 1.0)
    assert (safe > 0.95).mean() <= 0.05
    early = np.stack([stratified_lower(drawn[:, None, :count], 0.05) > 0.95
                      for count in (4, 8, 12)]).any(axis=0)
    assert early.mean() > 0.3


@pytest.mark.parametrize("count", [1, 2, 90])
def test_safe_bounds_are_those_of_the_theorem_draw_by_draw(count: int) -> None:
    """Each bet, mean and variance are of the draws before; the highest bound so far counts."""
    drawn, alpha = np.random.default_rng(7).beta(0.9, 0.3, (4, count)), 0.2
    for draws, found in zip(drawn, safe_lower(drawn, alpha, 0.0, 1.0), strict=True):
        mean, variance, best = 0.5, 0.25, 0.0
        bets, won, paid = 0.0, 0.0, np.log(1.0 / alpha)
        for n, draw in enumerate(draws, 1):
            bet = min(0.5, np.sqrt(2.0 * np.log(1.0 / alpha) / (variance * n * np.log(1.0 + n))))
            paid += 4.0 * (draw - mean) ** 2 * (-np.log(1.0 - bet) - bet) / 4.0
            bets, won = bets + bet, won + bet * draw
            best = max(best, (won - paid) / bets)
            mean = (0.5 + draws[:n].sum()) / (n + 1)
            means = [(0.5 + draws[:k].sum()) / (k + 1) for k in range(1, n + 1)]
            variance = (0.25 + ((draws[:n] - means) ** 2).sum()) / (n + 1)
        assert found == pytest.approx(best)


def test_safe_bounds_close_in_and_scale() -> None:
    drawn = np.random.default_rng(4).uniform(0.0, 1.0, (1, 4000))
    few, many = (safe_lower(drawn[:, :count], 0.01, 0.0, 1.0)[0] for count in (50, 4000))
    assert few < many < 0.5
    assert many > 0.5 - 0.05
    scaled = safe_lower(20.0 * drawn - 10.0, 0.01, -10.0, 10.0)[0]
    assert scaled == pytest.approx(20.0 * many - 10.0)
