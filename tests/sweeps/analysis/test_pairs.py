"""Tests of pairs of entries, against scipy, definitions and cases worked by hand."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from curved_episodes import wide_study, wide_text
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from sweeps.analysis.confusion import confusion_table, read_confusion
from sweeps.analysis.curves import (
    curves_table,
    read_curves,
)
from sweeps.analysis.entries import Entry, LeaderboardError
from sweeps.analysis.objects import ALSO, object_rows, objects_table
from sweeps.analysis.paired import Paired, read_paired
from sweeps.analysis.pairs import (
    Pair,
    _power,
    compare_pairs,
    episodes_test,
    holm,
    objects_test,
    pairs_table,
    variance_ratio,
)


@settings(max_examples=100)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_holm_is_the_closed_test_of_bonferroni(p: list[float]) -> None:
    """A hypothesis is rejected when every intersection that holds it is: Holm's own proof."""
    def by_definition(n: int) -> float:
        subsets = [s for size in range(1, len(p) + 1) for s in combinations(range(len(p)), size)
                   if n in s]
        return min(1.0, max(len(s) * min(p[k] for k in s) for s in subsets))

    assert np.allclose(holm(np.array(p)), [by_definition(n) for n in range(len(p))])


def test_holm_passes_over_what_has_no_p() -> None:
    found = holm(np.array([0.01, np.nan, 0.04]))
    assert found[[0, 2]].tolist() == [0.02, 0.04]
    assert np.isnan(found[1])


def test_tests_on_one_object_are_those_of_scipy() -> None:
    generator = np.random.default_rng(1)
    first, second = generator.normal(0, 1, (2, 30))
    assert episodes_test([first - second]) == pytest.approx(
        stats.ttest_rel(first, second).pvalue, rel=1e-9)
    differences = generator.normal(0.4, 1, 9)
    ranks = stats.rankdata(np.abs(differences))
    observed = min(ranks[differences > 0].sum(), ranks[differences < 0].sum())
    every = np.array([sum(r for r, up in zip(ranks, f"{n:09b}", strict=True) if up == "1")
                      for n in range(2**9)])  # all signs, equally likely
    assert objects_test(differences) == pytest.approx(min(1.0, 2 * (every <= observed).mean()))


@pytest.mark.parametrize("kind", ["continuous", "whole numbers", "mostly none"])
@pytest.mark.parametrize("objects", [1, 2, 6, 13])
def test_the_signed_rank_test_is_the_exact_one(objects: int, kind: str) -> None:
    rng = np.random.default_rng(objects)
    for _ in range(4):
        differences = rng.normal(0.5, 1.0, objects)
        if kind != "continuous":
            differences = np.round(differences * (2.0 if kind == "whole numbers" else 0.5))
        apart = differences[differences != 0.0]
        ranks = stats.rankdata(np.abs(apart))
        up = np.arange(2 ** len(apart))[:, None] >> np.arange(len(apart)) & 1
        far = np.abs(2.0 * up @ ranks - ranks.sum())  # of all signs, which are equally likely
        mine = np.abs(np.sign(apart) @ ranks)
        assert objects_test(differences) == pytest.approx((far >= mine - 1e-9).mean())


@pytest.mark.parametrize("without", [0, 8, 30])
def test_objects_without_a_difference_prove_nothing(without: int) -> None:
    """Six objects that agree have a p of 1/32 at least; with eight more without a difference the
    normal approximation gave 0.014."""
    assert objects_test(np.append(np.zeros(without), np.full(6, 0.5))) == 2.0**-5


def test_differences_that_do_not_vary_are_tested_by_their_signs() -> None:
    """Two episodes that happen to differ by the same are no proof."""
    assert episodes_test([np.array([1.0, 1.0])]) == 0.5
    assert episodes_test([np.full(4, -2.0), np.zeros(3), np.full(2, -1.0)]) == 2.0**-5
    assert episodes_test([np.zeros(4)]) == 1.0
    mixed = episodes_test([np.full(8, 2.0), np.full(8, -1.0)])  # for one, then for the other
    assert mixed == 1.0


def test_the_stratified_test_holds_its_level() -> None:
    """Objects of very different spread and a true difference of zero: p below 5 % is rare."""
    generator = np.random.default_rng(2)
    found = np.array([episodes_test([generator.normal(0, spread, 12) for spread in (1, 5, 20)])
                      for _ in range(2000)])
    assert (found < 0.05).mean() == pytest.approx(0.05, abs=0.015)
    assert np.isnan(episodes_test([np.array([1.0])]))
    assert objects_test(np.zeros(4)) == 1.0


def test_pairs_agree_with_the_values_themselves(paired: Paired) -> None:
    pairs = compare_pairs(paired, "chamfer_mm")
    assert [(p.first, p.second) for p in pairs] == [("s", "sx"), ("s", "sxx"), ("sx", "sxx")]
    by_hand = np.mean([v[:, 0].mean() - v[:, 1].mean() for v in paired.values["chamfer_mm"]])
    assert pairs[0].difference == pytest.approx(by_hand)
    assert pairs[0].like_these[0] < pairs[0].difference < pairs[0].like_these[1] < 0
    assert pairs[0].wins == 6
    assert pairs[0].p_objects == 2 * 0.5**6
    table = pairs_table(paired, "chamfer_mm")
    assert "cannot fall below 0.094: a claim about other objects needs 7" in table.notes[-1]
    assert "with 1 object and 1 comparison p_objects_holm" in _power(1, 1, fewer=False)[0]
    against = compare_pairs(paired, "chamfer_mm", "best")
    assert [(p.first, p.second) for p in against] == [("sx", "s"), ("sxx", "s")]
    with pytest.raises(LeaderboardError, match="did you mean sxx"):
        compare_pairs(paired, "chamfer_mm", "sxxx")


def test_differences_that_rounding_alone_tells_apart_are_equal() -> None:
    """Two objects of four that are better by one episode in ten and two that are worse had a p of
    0.5, since 0.8 - 0.7 is not 0.1; four episodes that differ by a third each had one of 6e-47."""
    def found(*values: np.ndarray) -> Pair:
        entries = Entry(0, "a", {}), Entry(1, "b", {})
        return compare_pairs(Paired(entries, ("o",) * len(values), {"iou": values},
                                    {"iou": np.zeros((1, 2))}, ()), "iou")[0]

    shares = np.array([[7, 8], [1, 0], [1, 0], [7, 8]]) / 10
    assert found(*(np.tile(share, (2, 1)) for share in shares)).p_objects == 1.0
    assert found(np.array([[1, 2], [4, 5], [7, 8], [2, 3]]) / 3).p_episodes == 2.0**-3


def test_the_best_is_compared_as_chosen_from_all_pairs() -> None:
    """Of boards of equal entries about one in twenty calls an entry worse than the first."""
    draw, wrong, boards, entries = np.random.default_rng(8), 0, 150, 16
    for _ in range(boards):
        values = draw.normal(size=(3, 12, entries))
        best = int(values.mean(axis=(0, 1)).argmin())
        p = np.array([episodes_test([v[:, n] - v[:, best] for v in values])
                      for n in range(entries) if n != best])
        wrong += np.nanmin(holm(p, entries * (entries - 1) // 2)) < 0.05
    assert wrong / boards < 0.08  # and 0.2 by the comparisons shown alone


def test_holm_of_some_comparisons_is_no_less_than_among_all() -> None:
    every = np.random.default_rng(2).uniform(size=15) ** 3
    assert (holm(every[:5], 15) >= holm(every)[:5] - 1e-15).all()
    assert np.allclose(holm(every, 15), holm(every))


def test_a_table_against_the_best_counts_all_pairs(paired: Paired) -> None:
    best, named = (pairs_table(paired, "chamfer_mm", name) for name in ("best", "s"))
    at = best.header.index("p_episodes_holm")
    raw = np.array([pair.p_episodes for pair in compare_pairs(paired, "chamfer_mm", "best")])
    assert [row[at] for row in best.rows] == [f"{p:.3g}" for p in holm(raw, 3)]
    assert [row[at] for row in named.rows] == [f"{p:.3g}" for p in holm(raw)]
    assert best.notes[-1] == "s was found to be the best after the fact: _holm counts all 3 pairs"
    assert best.notes[-1] not in named.notes


def test_where_more_is_better_tables_are_mirrored(paired: Paired) -> None:
    mirrored = Paired(paired.entries, paired.objects, paired.values | {
        "iou": tuple(1.0 - v / 100.0 for v in paired.values["chamfer_mm"])}, {
        "iou": 1.0 - paired.means["chamfer_mm"] / 100.0}, ())
    for error, share in zip(compare_pairs(paired, "chamfer_mm", "best"),
                            compare_pairs(mirrored, "iou", "best"), strict=True):
        assert (share.first, share.second, share.wins) == (error.first, error.second, error.wins)
        assert share.difference == pytest.approx(-error.difference / 100.0)
    for error, share in zip(object_rows(paired, "chamfer_mm"), object_rows(mirrored, "iou"),
                            strict=True):
        assert [share.median, share.p90] == pytest.approx(
            [1.0 - error.median / 100.0, 1.0 - error.p90 / 100.0])


def test_a_row_of_an_object_is_of_one_entrys_episodes(paired: Paired) -> None:
    for row in object_rows(paired, "chamfer_mm"):
        body, entry = paired.objects.index(row.object), paired.labels.index(row.label)
        own, *also = (paired.values[name][body][:, entry] for name in ("chamfer_mm", *ALSO))
        assert row.mean == pytest.approx(own.mean())
        assert row.also == pytest.approx([values.mean() for values in also])
        assert np.sort(own)[13] <= row.p90 <= np.sort(own)[14]  # of sixteen


def test_an_identical_copy_is_never_told_apart(paired: Paired) -> None:
    twin = Paired(paired.entries[:2], paired.objects,
                  {"iou": tuple(v[:, [0, 0]] for v in paired.values["chamfer_mm"])},
                  {"iou": paired.means["chamfer_mm"][:, [0, 0]]}, ())
    (pair,) = compare_pairs(twin, "iou")
    assert (pair.difference, pair.wins) == (0.0, 0)
    assert pair.like_these == pair.these == (0.0, 0.0)
    assert (pair.p_objects, pair.p_episodes) == (1.0, 1.0)


def test_few_objects_are_told(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4))
    paired = read_paired(plan, [store], ["chamfer_mm", *ALSO])
    for table in (pairs_table(paired, "chamfer_mm"), objects_table(paired, "chamfer_mm"),
                  curves_table(read_curves(plan, [store])),
                  confusion_table(read_confusion(plan, [store]))):
        assert "2 objects: below 6 nothing can be claimed" in " ".join(table.notes)
    fewer = "or fewer comparisons (--against an entry chosen beforehand)"
    named = pairs_table(paired, "chamfer_mm", paired.labels[0])
    assert fewer not in " ".join(named.notes)
    assert (fewer in " ".join(pairs_table(paired, "chamfer_mm").notes)) == (
        len(paired.entries) > 2)


def test_the_worth_of_common_random_numbers_is_their_covariance() -> None:
    draw = np.random.default_rng(3)
    shared, own, other = draw.normal(size=(3, 4000))
    first, second = shared + own, shared + other  # Var(a-b) = 2, Var(a) + Var(b) = 4
    assert variance_ratio([first], [second]) == pytest.approx(0.5, abs=0.02)
    assert variance_ratio([own], [other]) == pytest.approx(1.0, abs=0.05)
    assert variance_ratio([first], [-first]) == pytest.approx(2.0)
    assert variance_ratio([first], [first]) == 0.0
    assert np.isnan(variance_ratio([np.ones(5)], [np.ones(5)]))


def test_episodes_without_a_score_are_told(tmp_path: Path) -> None:
    """Units of one entry failed: that is what its differences are of."""
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4))
    for unit in plan.units():
        if unit.cell.strategy.name == "sx":
            store.path(unit).unlink()
            store.log(unit).write_text("it broke")
    notes = pairs_table(read_paired(plan, [store], ["chamfer_mm"]), "chamfer_mm").notes
    told, = (note for note in notes if "without chamfer_mm" in note)
    assert told.startswith("episodes without chamfer_mm count as the worst on their object: "
                           "8 of sx")
