"""Intervals of means: textbook cases, coverage, and boards of equal entries that claim nothing."""

import numpy as np
import pytest
from doc_blocks import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from sweeps.analysis.bootstrap import Estimate
from sweeps.analysis.entries import bounds_of
from sweeps.analysis.interval import (
    ObjectMeans,
    _simulated,
    critical_difference,
    sensible_ends,
    small_sample_widening,
)
from sweeps.analysis.paired import failure_score, filled


def means_of(data: np.ndarray, chances: bool = False) -> ObjectMeans:
    """The statistics of data [object, episode, entry]."""
    found = ObjectMeans(data.shape[2], 3, chances=chances)
    for values in data:
        found.add(values)
    return found


def test_one_object_is_a_paired_t_test() -> None:
    data = np.random.default_rng(1).normal([3.0, 4.0], 1.0, (1, 12, 2))
    found = means_of(data).differences(0, "these")
    low, high = stats.ttest_rel(data[0, :, 1], data[0, :, 0]).confidence_interval(0.95)
    assert (found.low[1], found.high[1]) == pytest.approx((low, high), rel=1e-9)
    assert np.isnan(means_of(data).differences(0, "like-these").low).all()


def test_objects_like_these_are_a_t_test_of_their_means_widened_for_skewness() -> None:
    wider = []
    for objects in (7, 14):
        data = np.random.default_rng(2).normal([3.0, 4.0], 1.0, (objects, 5, 2))
        found = means_of(data).differences(0, "like-these")
        apart = data.mean(axis=1)[:, 1] - data.mean(axis=1)[:, 0]
        low, high = stats.ttest_1samp(apart, 0.0).confidence_interval(0.95)
        assert found.low[1] + found.high[1] == pytest.approx(low + high, rel=1e-9)
        wider.append(objects * ((found.high[1] - found.low[1]) / (high - low) - 1.0))
    assert wider[0] == pytest.approx(wider[1], rel=1e-9)
    assert 0.5 < wider[0] < 0.75  # Hall's expansion at a skewness of 0.8


def test_intervals_of_means_are_as_the_page_on_leaderboards_says() -> None:
    page = " ".join((ROOT / "docs/leaderboard.md").read_text().split())
    wider = float(page.partition("h is multiplied by 1 + ")[2].partition(" divided")[0])
    assert small_sample_widening(1) == pytest.approx(1.0 + wider, abs=5e-4)
    data = np.random.default_rng(4).uniform(0.1, 0.9, (6, 5, 3))
    objects = data.mean(axis=1)
    mean, spread = objects.mean(axis=0), objects.std(axis=0, ddof=1)
    half = stats.t.ppf(0.975, 5) * spread / np.sqrt(6) * small_sample_widening(6)
    assert "m exp(-h/m) and m exp(h/m)" in page
    found = means_of(data).values("like-these", bounds_of("chamfer_mm"))
    assert found.low == pytest.approx(mean * np.exp(-half / mean), rel=1e-9)
    assert found.high == pytest.approx(mean * np.exp(half / mean), rel=1e-9)
    assert "logit is h / (m (1 - m)) lower and higher" in page
    shares = means_of(data).values("like-these", bounds_of("iou"))
    logit = np.log(mean / (1.0 - mean)) + half / (mean * (1.0 - mean))
    assert shares.high == pytest.approx(1.0 / (1.0 + np.exp(-logit)), rel=1e-9)


@pytest.mark.parametrize("objects", [
    3, pytest.param(6, marks=pytest.mark.slow), pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize("skewness", [pytest.param(0.0, marks=pytest.mark.slow), 0.8])
def test_objects_as_skewed_as_assumed_are_covered(objects: int, skewness: float) -> None:
    generator = np.random.default_rng(5)
    shape = (4.0 / skewness**2) if skewness else 1e6
    means = generator.gamma(shape, 1.0, (objects, 4000)) - shape
    board = ObjectMeans(4000, 0)
    for each in means:
        board.add(each[None])
    found = board.values("like-these")
    assert 0.945 < np.mean((found.low <= 0.0) & (found.high >= 0.0)) < 0.975


def test_equal_entries_over_few_objects_are_seldom_called_the_best() -> None:
    """Of two equal entries each is first in 95 % of replicates in one board of twenty."""
    boards = np.random.default_rng(8).normal(size=(400, 3, 1, 2))
    first = [means_of(board).p_best(1.0).max() >= 0.95 for board in boards]
    assert 0.06 < np.mean(first) < 0.16


def test_two_objects_of_one_entry_against_a_constant_is_welchs_test() -> None:
    """The mean of two object means is Welch's two-sample interval, one sample negated."""
    generator = np.random.default_rng(3)
    one, other = generator.normal(0, 1, 9), generator.normal(0, 4, 14)
    found = ObjectMeans(1, 3)
    found.add(one[:, None])
    found.add(other[:, None])
    low, high = stats.ttest_ind(one, -other, equal_var=False).confidence_interval(0.95)
    made = found.values("these")
    assert (made.low[0], made.high[0]) == pytest.approx((low / 2, high / 2), rel=1e-9)


@pytest.mark.parametrize("freedom", [2.0, 6.0, 30.0, np.inf])
@pytest.mark.parametrize("entries", [3, 10])
def test_the_critical_difference_bounds_tukeys(entries: int, freedom: float) -> None:
    """With one pooled standard error it would be Tukey's; one for each pair asks for more."""
    found = critical_difference(entries, np.array([freedom]))[0]
    tukey = stats.studentized_range.ppf(0.95, entries, min(freedom, 1e6)) / np.sqrt(2)
    assert found >= tukey * 0.98
    if np.isinf(freedom):
        assert found == pytest.approx(tukey, rel=0.02)
    assert critical_difference(2, np.array([freedom]))[0] == pytest.approx(
        stats.t.ppf(0.975, freedom) if np.isfinite(freedom) else 1.96, rel=1e-4)


def test_of_more_entries_than_are_simulated_all_pairs_are_reckoned_with() -> None:
    drawn = np.random.default_rng(6).standard_normal((6000, 400))
    range_ = np.quantile(np.ptp(drawn, axis=1), 0.95) / np.sqrt(2.0)
    assert _simulated(400, np.inf) == pytest.approx(range_, rel=0.015)


def test_objects_whose_outcomes_all_agree_have_the_error_of_their_episodes() -> None:
    """They do not differ, so of objects like these no less is known, but for Student's t."""
    for objects in (4, 12):
        found = means_of(np.ones((objects, 8, 2)), chances=True)
        like, these = (found.differences(0, over).high[1] for over in ("like-these", "these"))
        assert like / these == pytest.approx(
            stats.t.ppf(0.975, objects - 1) / stats.t.ppf(0.975, 7 * objects))


@pytest.mark.slow
def test_more_entries_and_fewer_degrees_of_freedom_need_more() -> None:
    freedoms = np.array([2.0, 3.5, 5.0, 12.0, 55.0, 400.0, np.inf])
    few, many, most = (critical_difference(n, freedoms) for n in (5, 64, 256))
    assert (few < many).all()
    assert (many < most).all()
    for found in (few, many, most):
        assert (np.diff(found) < 0.02).all()  # the quantiles are simulated


@pytest.mark.parametrize(("entries", "objects", "episodes"),
                         [
                             (2, 6, 8), (6, 3, 8),
                             pytest.param(6, 6, 16, marks=pytest.mark.slow),
                             pytest.param(15, 6, 8, marks=pytest.mark.slow)])
def test_boards_of_equal_entries_hardly_ever_claim_a_difference(
        entries: int, objects: int, episodes: int) -> None:
    generator = np.random.default_rng(entries)
    trials = 300
    claims = {"these": 0, "like-these": 0}
    for _ in range(trials):
        own = generator.exponential(1.0, (objects, 1, 1))  # objects differ, errors are skewed
        board = means_of(own * generator.exponential(1.0, (objects, episodes, entries)))
        best = int(np.argmin(board.values("these").value))
        for over in claims:
            delta = board.differences(best, over)
            claims[over] += bool(((delta.low > 0) | (delta.high < 0)).any())
    assert max(claims.values()) <= 0.05 * trials + 3 * np.sqrt(0.05 * 0.95 * trials)


@pytest.mark.parametrize("episodes", [8, 64])
@pytest.mark.parametrize("objects", [3, 10])
def test_intervals_of_skewed_errors_hold_the_truth(objects: int, episodes: int) -> None:
    """Errors are positive and skewed: a gamma distribution of shape two, objects of its own."""
    generator = np.random.default_rng(objects)
    trials, held = 600, {"these": 0, "like-these": 0}
    for _ in range(trials):
        own = generator.gamma(4.0, 1.0, (objects, 1, 1))
        board = means_of(own * generator.gamma(2.0, 0.5, (objects, episodes, 1)))
        for over, truth in (("these", own.mean()), ("like-these", 4.0)):
            found = board.values(over, (0.0, np.inf))
            held[over] += bool(found.low[0] <= truth <= found.high[0])
    for over, count in held.items():
        assert 0.92 * trials <= count <= 0.985 * trials, over


def test_shares_stay_between_zero_and_one() -> None:
    data = np.array([[[0.0, 1.0, 0.9]] * 3 + [[0.0, 1.0, 0.2]]] * 2)
    data[1, :, 2] += 0.05
    for over in ("these", "like-these"):
        found = means_of(data).values(over, (0.0, 1.0))
        assert ((found.low >= 0) & (found.high <= 1)).all()
        assert found.low[:2].tolist() == found.high[:2].tolist() == [0.0, 1.0]
        assert found.low[2] < found.value[2] < found.high[2]


@pytest.mark.parametrize(("share", "objects", "episodes"), [
    (0.97, 6, 3), (0.97, 6, 1), (0.97, 20, 2), (0.9, 1, 8), (0.97, 1, 32), (0.5, 1, 2), (0.5, 3, 3),
    (0.8, 6, 16)])
def test_intervals_of_chances_hold_the_truth(share: float, objects: int, episodes: int) -> None:
    """Where all episodes agree their variance is zero, and the interval was a point."""
    generator, trials = np.random.default_rng(6), 300
    held = {"these": 0, "like-these": 0}
    for data in generator.random((trials, objects, episodes, 1)) < share:
        for over in held:
            found = means_of(data.astype(float), chances=True).values(over, (0.0, 1.0))
            held[over] += bool(found.low[0] <= share <= found.high[0])
            assert not ((found.low < 0.0) | (found.high > 1.0)).any()
    known = [held[over] for over, count in (("these", episodes), ("like-these", objects))
             if count > 1]
    # Student's quantile of three objects falls short for outcomes as coarse as theirs.
    assert min(known) >= (0.92 if objects != 3 else 0.86) * trials


@pytest.mark.parametrize(("share", "objects", "episodes"), [
    (0.5, 1, 2), (0.5, 3, 3), (0.97, 6, 16)])
def test_entries_of_equal_chances_are_hardly_ever_told_apart(share: float, objects: int,
                                                             episodes: int) -> None:
    generator, trials = np.random.default_rng(7), 300
    claims = 0
    for data in generator.random((trials, objects, episodes, 4)) < share:
        board = means_of(data.astype(float), chances=True)
        best = int(board.values("these").value.argmax())
        claims += any(bool(((apart.low > 0) | (apart.high < 0)).any()) for apart in (
            board.differences(best, over) for over in ("these", "like-these")))
    assert claims <= 0.05 * trials


def test_differences_of_shares_are_one_at_most() -> None:
    board = means_of(np.array([[[1.0, 0.0]] * 2] * 2), chances=True)
    for over in ("these", "like-these"):
        apart = board.differences(0, over)
        assert (np.abs([apart.low[1], apart.high[1]]) <= 1.0).all()


def test_many_outcomes_have_the_interval_of_any_means() -> None:
    data = (np.random.default_rng(9).random((8, 400, 2)) < 0.6).astype(float)
    for over in ("these", "like-these"):
        plain, own = (means_of(data, chances).values(over) for chances in (False, True))
        assert own.low == pytest.approx(plain.low, abs=2e-3)
        assert own.high == pytest.approx(plain.high, abs=2e-3)


def test_ends_beyond_all_reason_are_left_out() -> None:
    """Of two objects as unlike as these an interval reaches from nanometres to kilometres."""
    data = np.array([[[2.0], [2.1]], [[9.0], [9.1]]])
    found = means_of(data).values("like-these", (0.0, np.inf))
    assert found.high[0] > 1e4
    assert np.isnan([sensible_ends(found).low[0], sensible_ends(found).high[0]]).all()
    assert sensible_ends(found).value[0] == pytest.approx(5.55)
    close = means_of(data).values("these", (0.0, np.inf))
    assert sensible_ends(close).high[0] == close.high[0]
    tiny = Estimate(*(np.array([end]) for end in (0.001, 0.0, 0.5)))  # half a millimetre at most
    assert sensible_ends(tiny).high[0] == 0.5


def test_one_episode_has_no_interval() -> None:
    found = means_of(np.full((1, 1, 2), 3.0))
    assert found.values("these").value.tolist() == [3.0, 3.0]
    assert np.isnan(found.values("these").low).all()
    assert np.isnan(found.p_best(1.0)).all()


def test_an_object_that_all_entries_fail_on_is_left_out() -> None:
    data = np.ones((3, 10, 2))
    data[1] = np.nan
    data[2] = 4.0
    found = means_of(data)
    assert found.values("these").value.tolist() == [2.5, 2.5]
    empty = means_of(np.full((2, 4, 2), np.nan))
    for over in ("these", "like-these"):
        assert np.isnan(empty.values(over).low).all()
        assert np.isnan(empty.differences(0, over).high).all()
    assert np.isnan(empty.p_best(1.0)).all()


@settings(max_examples=50)
@given(st.integers(0, 2**32), st.sampled_from(["chamfer_mm", "iou"]), st.data())
def test_failing_never_pays(seed: int, metric: str, data: st.DataObject) -> None:
    """Turning an episode into a failure never betters an entry, unless it was itself the worst."""
    values = np.random.default_rng(seed).exponential(1.0, (3, 8, 2))
    body, episode = data.draw(st.integers(0, 2)), data.draw(st.integers(0, 7))
    values[body, (episode + 1) % 8, 1] = values[body].max() * 2  # another entry did worse
    failed = values.copy()
    failed[body, episode, 0] = np.nan
    before, after = (means_of(np.stack([filled(v, failure_score(metric)) for v in given]))
                     .values("these").value[0] for given in (values, failed))
    assert after <= before if metric == "iou" else after >= before


@pytest.mark.parametrize("chances", [False, True])
def test_an_object_without_episodes_is_none(chances: bool) -> None:
    data = np.random.default_rng(4).integers(0, 2, (3, 6, 2)).astype(float)
    found, with_none = means_of(data, chances), means_of(data[:1], chances)
    with_none.add(np.zeros((0, 2)))
    for values in data[1:]:
        with_none.add(values)
    for over in ("these", "like-these"):
        for one, other in zip(vars(found.values(over)).values(),
                              vars(with_none.values(over)).values(), strict=True):
            np.testing.assert_array_equal(one, other)


def test_the_mean_of_the_first_is_as_much_too_good_as_the_page_says() -> None:
    """Its own interval is that of an entry that was chosen beforehand."""
    page = " ".join((ROOT / "docs/leaderboard.md").read_text().split())
    said = float(page.partition("the interval *these* of the first held in ")[2].partition(" %")[0])
    rng, held, apart = np.random.default_rng(3), [], []
    for _ in range(400):
        own, noise = rng.gamma(4.0, 1.0, (6, 16, 1)), rng.gamma(2.0, 1.0, (6, 16, 30))
        board = means_of(own + noise)
        found = board.values("these", (0.0, np.inf))
        first = int(found.value.argmin())
        held.append(found.low[first] <= 6.0 <= found.high[first])
        apart.append(bool((board.differences(first, "these").low <= 0.0).all()))
    assert 100.0 * np.mean(held) == pytest.approx(said, abs=5.0)
    assert np.mean(apart) >= 0.93
