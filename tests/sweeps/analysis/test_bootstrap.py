import numpy as np
import pytest
from scipy.stats import norm, poisson, t

from sweeps.analysis.bootstrap import (
    INTERVAL,
    Estimate,
    episode_weights,
    object_weights,
    population,
    probability_best,
    replicate_means,
)


def means_of(data: np.ndarray, over: str | None = None, seed: int = 3) -> np.ndarray:
    """Replicate means of data [object, episode, entry]."""
    return replicate_means(list(data), seed, over)


def estimate(means: np.ndarray) -> Estimate:
    """The data's values with percentile intervals over the replicates."""
    drawn = means[1:][np.isfinite(means[1:]).all(axis=1)]
    if not len(drawn):
        nothing = np.full(means.shape[1], np.nan)
        return Estimate(means[0], nothing, nothing)
    low, high = np.quantile(drawn, INTERVAL, axis=0)
    return Estimate(means[0], low, high)


@pytest.mark.parametrize("over", ["these", "like-these"])
def test_the_first_row_is_the_plain_mean_of_object_means(over: str) -> None:
    data = np.random.default_rng(1).normal(5, 1, (7, 40, 3))
    assert np.allclose(means_of(data, over)[0], data.mean(axis=1).mean(axis=0), rtol=1e-12)


@pytest.mark.parametrize("interaction", [0.0, 2.0])
def test_standard_error_is_that_of_the_textbook_two_level_design(interaction: float) -> None:
    """Var of the mean = (between + within / episodes) / objects, times Student's widening; of
    these objects it is within / episodes / objects, however much they differ."""
    generator = np.random.default_rng(2)
    objects, episodes = 40, 30
    spread: dict[str, list[float]] = {"like-these": [], "these": []}
    for trial in range(12):
        data = (generator.normal(0, interaction, (objects, 1, 1))
                + generator.normal(0, 3.0, (objects, episodes, 1)))
        for over, found in spread.items():
            found.append(means_of(data, over, seed=trial)[1:, 0].std())
    within = 3.0**2 / episodes
    student = t.ppf(0.975, objects - 1) / norm.ppf(0.975)
    assert np.mean(spread["like-these"]) == pytest.approx(
        np.sqrt((interaction**2 + within) / objects) * student, rel=0.07)
    assert np.mean(spread["these"]) == pytest.approx(np.sqrt(within / objects), rel=0.07)


@pytest.mark.parametrize("episodes", [4, 8])
def test_the_spread_over_few_episodes_is_that_of_their_sample(episodes: int) -> None:
    """So many drawn episodes as a Poisson number says have the variance of a sample over it."""
    data = np.random.default_rng(3).normal(0, 1, (5, episodes, 1))
    count = np.arange(1, 60)
    chance = poisson.pmf(count, episodes)
    inverse = (chance / count).sum() / chance.sum()
    student = t.ppf(0.975, 5 * (episodes - 1)) / norm.ppf(0.975)
    spread = [np.nanstd(means_of(data, "these", seed)[1:]) for seed in range(6)]
    assert np.mean(spread) == pytest.approx(
        np.sqrt(data.var(axis=1, ddof=1).sum() * inverse) / 5 * student, rel=0.05)


@pytest.mark.parametrize("between", [pytest.param(0.0, marks=pytest.mark.slow), 1.0])
@pytest.mark.parametrize("objects", [6, pytest.param(10, marks=pytest.mark.slow)])
def test_intervals_hold_the_truth_as_often_as_they_say(objects: int, between: float) -> None:
    """Neither seldom nor always: whether strategies differ between objects (`between`) or not."""
    generator = np.random.default_rng(4)
    trials = 400
    held = {"like-these": 0, "these": 0}
    for trial in range(trials):
        own = generator.normal(0, between, (objects, 1, 1))
        data = own + generator.normal(0, 1, (objects, 4, 1))
        for over, truth in (("like-these", 0.0), ("these", own.mean())):
            found = estimate(means_of(data, over, seed=trial))
            held[over] += bool(found.low[0] <= truth <= found.high[0])
    for over, count in held.items():
        assert 0.915 * trials <= count <= 0.98 * trials, over  # 0.95 give or take three deviations


@pytest.mark.parametrize("episodes", [2, 4, 8, 16])
def test_intervals_over_one_objects_episodes_hold_the_truth(episodes: int) -> None:
    """Two values alone know too little of their spread for the percentiles of a bootstrap."""
    generator = np.random.default_rng(episodes)
    held, trials = 0, 400
    for trial in range(trials):
        found = estimate(means_of(generator.normal(0, 1, (1, episodes, 1)), seed=trial))
        held += bool(found.low[0] <= 0 <= found.high[0])
    assert (0.89 if episodes == 2 else 0.92) * trials <= held <= 0.99 * trials


def test_one_object_has_intervals_of_itself_alone() -> None:
    assert population(None, 1) == "these"
    assert population(None, 2) == "like-these"
    data = np.random.default_rng(7).normal(0, 1, (1, 200, 1))
    assert means_of(data)[1:, 0].std() == pytest.approx(data.std() / np.sqrt(200), rel=0.1)
    assert np.isnan(estimate(means_of(data, "like-these")).low).all()


@pytest.mark.parametrize("over", ["these", "like-these"])
def test_one_episode_has_no_interval(over: str) -> None:
    means = means_of(np.full((1, 1, 2), 3.0), over)
    found = estimate(means)
    assert found.value.tolist() == [3.0, 3.0]
    assert np.isnan([found.low, found.high, probability_best(means, 1.0)]).all()


def test_differences_are_paired() -> None:
    """Two entries that differ by a constant on every episode differ by it for certain."""
    base = np.random.default_rng(5).normal(0, 10, (6, 30, 1))
    for over in ("these", "like-these"):
        means = means_of(np.concatenate([base, base + 0.1], axis=2), over)
        delta = estimate(means - means[:, :1])
        assert np.allclose([delta.value[1], delta.low[1], delta.high[1]], 0.1, rtol=1e-9)
        assert probability_best(means, 1.0).tolist() == [1.0, 0.0]
        assert probability_best(means, -1.0).tolist() == [0.0, 1.0]


def test_ties_share_the_win() -> None:
    data = np.repeat(np.random.default_rng(6).normal(0, 1, (6, 30, 1)), 2, axis=2)
    assert probability_best(means_of(data), 1.0).tolist() == [0.5, 0.5]


def test_ties_that_rounding_alone_breaks_share_the_win() -> None:
    """Shares of ten episodes, of each object 0.3, 0.5 and 0.9 in turn: one won where both were
    equal, and had 0.64 of the replicates."""
    shares = np.array([[3, 9], [5, 3], [9, 5]])
    data = np.arange(10)[None, :, None] < shares[:, None]
    means = means_of(data.astype(float), seed=5)
    apart = np.round(means[1:, 0] - means[1:, 1], 9)
    best = probability_best(means, -1.0)
    assert best[0] == pytest.approx(((apart > 0.0) + 0.5 * (apart == 0.0)).mean())
    assert (apart == 0.0).mean() > 0.1


def test_an_object_without_values_is_left_out() -> None:
    data = np.ones((3, 10, 2))
    data[1] = np.nan
    data[2] = 4.0
    for over in ("these", "like-these"):
        assert means_of(data, over)[0].tolist() == [2.5, 2.5]
        assert np.isnan(estimate(means_of(np.full((2, 4, 2), np.nan), over)).low).all()


def test_weights_depend_on_the_object_alone() -> None:
    weights = episode_weights(9, 1, 64)
    assert (weights == episode_weights(9, 1, 64)).all()
    assert (weights[0] == 1).all()
    assert (weights != episode_weights(9, 0, 64)).any()
    assert weights[1:].mean() == pytest.approx(1, abs=0.02)
    assert weights[1:].var() == pytest.approx(1, abs=0.03)
    assert (object_weights(9, 7).sum(axis=1) == 7).all()
