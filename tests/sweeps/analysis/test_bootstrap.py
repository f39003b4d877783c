import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm, t

from sweeps.analysis.bootstrap import (
    MeanOverObjects,
    PlainMean,
    difference_to,
    episode_weights,
    estimate,
    object_weights,
    probability_best,
)


def means_of(data: np.ndarray, failure_score: float | None = None, seed: int = 3,
             block: int = 16) -> np.ndarray:
    """Replicate means of data [object, episode, entry], fed in blocks."""
    mean = MeanOverObjects(data.shape[2], failure_score, seed)
    for n, values in enumerate(data):
        for number, start in enumerate(range(0, len(values), block)):
            mean.add(values[start:start + block], (n, number))
        mean.finish_object()
    return mean.means()


def test_the_first_row_is_the_plain_mean_of_object_means() -> None:
    data = np.random.default_rng(1).normal(5, 1, (7, 40, 3))
    assert np.allclose(means_of(data)[0], data.mean(axis=1).mean(axis=0), rtol=1e-12)


@pytest.mark.parametrize("interaction", [0.0, 2.0])
def test_standard_error_is_that_of_the_textbook_two_level_design(interaction: float) -> None:
    """Var of the mean = (between + within / episodes) / objects, times Student's widening."""
    generator = np.random.default_rng(2)
    objects, episodes = 40, 30
    spread = []
    for trial in range(12):
        data = (generator.normal(0, interaction, (objects, 1, 1))
                + generator.normal(0, 3.0, (objects, episodes, 1)))
        spread.append(means_of(data, seed=trial)[1:, 0].std())
    expected = np.sqrt((interaction**2 + 3.0**2 / episodes) / objects)
    student = t.ppf(0.975, objects - 1) / norm.ppf(0.975)
    assert np.mean(spread) == pytest.approx(expected * student, rel=0.07)


@pytest.mark.parametrize("between", [0.0, 1.0])
@pytest.mark.parametrize("objects", [6, 10])
def test_intervals_hold_the_truth_as_often_as_they_say(objects: int, between: float) -> None:
    """Neither seldom nor always: whether strategies differ between objects (`between`) or not."""
    generator = np.random.default_rng(4)
    held, trials = 0, 400
    for trial in range(trials):
        data = (generator.normal(0, between, (objects, 1, 1))
                + generator.normal(0, 1, (objects, 4, 1)))
        found = estimate(means_of(data, seed=trial))
        held += bool(found.low[0] <= 0 <= found.high[0])
    assert 0.915 * trials <= held <= 0.98 * trials  # 0.95 give or take three deviations


def test_one_object_draws_its_episodes() -> None:
    data = np.random.default_rng(7).normal(0, 1, (1, 200, 1))
    assert means_of(data)[1:, 0].std() == pytest.approx(data.std() / np.sqrt(200), rel=0.1)


@pytest.mark.parametrize("episodes", [2, 4, 8, 16])
def test_intervals_over_one_objects_episodes_hold_the_truth(episodes: int) -> None:
    """Two values alone know too little of their spread for the percentiles of a bootstrap."""
    generator = np.random.default_rng(episodes)
    held, trials = 0, 400
    for trial in range(trials):
        found = estimate(means_of(generator.normal(0, 1, (1, episodes, 1)), seed=trial))
        held += bool(found.low[0] <= 0 <= found.high[0])
    assert (0.89 if episodes == 2 else 0.92) * trials <= held <= 0.99 * trials


def test_one_episode_has_no_interval() -> None:
    means = means_of(np.full((1, 1, 2), 3.0))
    found = estimate(means)
    assert found.value.tolist() == [3.0, 3.0]
    assert np.isnan([found.low, found.high, probability_best(means, 1.0)]).all()


def test_episodes_met_under_many_settings_are_not_more_episodes() -> None:
    """Pose and noise are the same there: where the setting changes nothing, nothing is learned."""
    values = np.random.default_rng(8).normal(0, 1, (16, 2))
    once, often = MeanOverObjects(2, None, 3), MeanOverObjects(2, None, 3)
    once.add(values, (0, 0))
    for _ in range(32):
        often.add(values, (0, 0))
    for mean in (once, often):
        mean.finish_object()
    assert np.allclose(once.means(), often.means(), rtol=1e-12, equal_nan=True)


def test_objects_without_data_are_not_drawn() -> None:
    """Where the rest is not finished yet, intervals are those of a study of what there is."""
    data = np.random.default_rng(9).normal(5, 1, (3, 20, 2))
    for there in (1, 2, 3):
        mean = MeanOverObjects(2, None, 3)
        for n, values in enumerate(data):
            if n < there:
                mean.add(values, (n, 0))
            mean.finish_object()
        found = estimate(mean.means())
        assert np.array_equal(mean.means(), means_of(data[:there], block=20), equal_nan=True)
        assert (found.high - found.low > 0.1).all()


def test_differences_are_paired() -> None:
    """Two entries that differ by a constant on every episode differ by it for certain."""
    base = np.random.default_rng(5).normal(0, 10, (6, 30, 1))
    means = means_of(np.concatenate([base, base + 0.1], axis=2))
    delta = difference_to(means, 0)
    assert np.allclose([delta.value[1], delta.low[1], delta.high[1]], 0.1, rtol=1e-9)
    assert probability_best(means, 1.0).tolist() == [1.0, 0.0]
    assert probability_best(means, -1.0).tolist() == [0.0, 1.0]


def test_ties_share_the_win() -> None:
    data = np.repeat(np.random.default_rng(6).normal(0, 1, (6, 30, 1)), 2, axis=2)
    assert probability_best(means_of(data), 1.0).tolist() == [0.5, 0.5]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32), st.data())
def test_failing_never_pays(seed: int, data: st.DataObject) -> None:
    """Turning an episode into a failure never betters an entry, unless it was itself the worst."""
    values = np.random.default_rng(seed).exponential(1.0, (3, 8, 2))
    body, episode = data.draw(st.integers(0, 2)), data.draw(st.integers(0, 7))
    values[body, (episode + 1) % 8, 1] = values[body].max() * 2  # another entry did worse
    failed = values.copy()
    failed[body, episode, 0] = np.nan
    assert means_of(failed)[0, 0] >= means_of(values)[0, 0]
    assert means_of(failed, 0.0)[0, 0] <= means_of(values, 0.0)[0, 0]


def test_an_object_that_all_entries_fail_on_is_left_out() -> None:
    data = np.ones((3, 10, 2))
    data[1] = np.nan
    data[2] = 4.0
    assert means_of(data)[0].tolist() == [2.5, 2.5]
    assert np.isnan(means_of(np.full((2, 4, 2), np.nan))).all()
    assert np.isnan(estimate(means_of(np.full((2, 4, 2), np.nan))).low).all()


def test_weights_depend_on_their_place_alone() -> None:
    weights = episode_weights(9, (1, 3), 64)
    assert (weights == episode_weights(9, (1, 3), 64)).all()
    assert (weights[0] == 1).all()
    for place in ((0, 3), (1, 0)):
        assert (weights != episode_weights(9, place, 64)).any()
    assert weights[1:].mean() == pytest.approx(1, abs=0.02)
    assert weights[1:].var() == pytest.approx(1, abs=0.03)
    assert (object_weights(9, 7).sum(axis=1) == 7).all()


def test_a_plain_mean_passes_over_what_was_not_measured() -> None:
    mean = PlainMean(2)
    mean.add(np.array([[1.0, np.nan], [3.0, np.nan]]))
    mean.finish_object()
    mean.add(np.array([[4.0, np.nan]]))
    mean.finish_object()
    assert mean.means()[0] == 3.0
    assert np.isnan(mean.means()[1])
