"""The picture of a race: legible for two entries and for two hundred, the same bytes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from drawn_text import looks_right, texts

from sweeps.figures.style import VERDICTS, encode
from sweeps.race.elimination import Race, Rules
from sweeps.race.picture import draw_race
from sweeps.race.verdict import (
    Verdict,
    claim,
    equal_replicates,
    race_table,
    summary,
    verdict_name,
    verdict_word,
)
from sweeps.watch.page import watch_page


def verdict(entries: int, rules: Rules, metric: str = "chamfer_mm") -> Verdict:
    """A race of drawn scores."""
    rng = np.random.default_rng(entries)
    means = 4.0 + np.sort(rng.gamma(1.5, 2.0, entries))
    scores = means[:, None, None] + rng.normal(0.0, 1.5, (entries, 6, 700))
    race = Race(entries, rules)
    while asked := race.asked():
        race.take(asked, [scores[e, :, a:b] for e, a, b in asked])
    labels = tuple(f"ring [strategy.count={n // 20}, strategy.closings=(curl40 base_then_curl), "
                   f"sensors.tendon_threshold_N={n}]" for n in range(entries))
    last = race.looks[-1]
    return Verdict(labels, metric, "these", 6, rules, tuple(race.looks),
                   race.means[last.leader] + last.difference, race.count * 6,
                   np.zeros(len(labels)), {}, race.last_rung,
                   race.paired_over_unpaired, 1e5)


@pytest.mark.parametrize(("entries", "rules"), [
    (2, Rules(0.5)), (4, Rules(1.0, budget=288)),
    pytest.param(5, Rules(0.25), marks=pytest.mark.slow), (200, Rules(1.0)),
    pytest.param(200, Rules(0.05, budget=4000), marks=pytest.mark.slow)])
def test_the_picture_is_legible(entries: int, rules: Rules) -> None:
    found = verdict(entries, rules)
    drawn = draw_race(found)
    looks_right(drawn)
    assert any(claim(found) in text for text, _ in texts(drawn))
    assert encode(draw_race(found), "svg") == encode(draw_race(found), "svg")


def test_ticks_of_a_small_race_are_its_rungs() -> None:
    found = verdict(4, Rules(1.0, budget=4 * 6 * 12))
    upper, lower = draw_race(found).axes
    rungs = [int(look.replicates.max()) for look in found.looks]
    assert len(rungs) > 1
    assert [int(label.get_text()) for label in lower.get_xticklabels()] == rungs
    assert "4" in [label.get_text() for label in upper.get_yticklabels()]
    highest = float(found.last.difference.max())
    ticks = lower.get_yticks()
    assert ticks[-1] >= highest
    assert sum(ticks > 0.0) > 2
    for axes in (upper, lower):
        assert "log scale" in axes.get_ylabel()
    assert "log scale" in lower.get_xlabel()
    assert "chamfer distance [mm]" in lower.get_ylabel()


def test_verdicts_have_the_colours_of_the_page_that_is_watched() -> None:
    css = watch_page("race").decode()
    found = verdict(4, Rules(1.0, budget=288))
    lower = draw_race(found).axes[1]
    shown = {str(line.get_label()).partition(" (")[0]: str(line.get_color())
             for line in lower.get_lines() if not str(line.get_label()).startswith("_")}
    last = found.last
    assert len(shown) > 1
    assert shown.keys() == {verdict_word(verdict_name(last, n)) for n in range(4)}
    for name, colour in shown.items():
        of_page = re.search(rf"--{'tied' if name == 'not better' else name}: (#\w+);", css)
        assert of_page
        assert of_page[1].lower() == colour.lower()
    assert len({colour.lower() for colour in VERDICTS.values()}) == 4


def test_one_rung_is_one() -> None:
    found = verdict(2, Rules(9.0))
    assert len(found.looks) == 1
    assert summary(found)["episodes"].endswith(" in 1 rung")
    margin = f"planned for {found.rules.within:g} mm with all spreads known ("
    assert margin in summary(found)["equal"]  # also where a budget supports less


@pytest.mark.parametrize(("percent", "told"), [(57.0, "57 %"), (99.9, "99.9 %"),
                                               (99.99999, "99.99999 %")])
def test_a_claim_is_not_more_certain_than_what_was_asked_for(percent: float, told: str) -> None:
    """99.99999 was printed as 100."""
    found = replace(verdict(2, Rules(9.0)), rules=Rules(9.0, percent / 100.0))
    assert claim(found).endswith(f" 6 objects, {told}")


@pytest.mark.parametrize(("metric", "mean", "room"), [("chamfer_mm", 4.0, 4.0), ("iou", -0.6, 0.4)])
def test_no_mean_can_be_better_than_all_that_can_be(metric: str, mean: float, room: float) -> None:
    """The mean of a share has its sign turned: less is better."""
    found = verdict(2, Rules(9.0))
    assert replace(found, metric=metric, means=np.full(2, mean)).room == pytest.approx(room)


def test_a_table_ranks_by_the_difference_to_the_winner() -> None:
    found = verdict(50, Rules(0.5))
    rows = race_table(found).rows
    assert rows[0][5] == "best"
    behind = [float(row[3]) for row in rows[1:]]
    assert behind == sorted(behind)
    assert all(float(row[3]) > 0 for row in rows if row[5] == "worse")
    assert {row[5] for row in rows} == {"best", "tied", "worse"}


def test_equal_allocation_is_that_of_a_table_of_sample_sizes() -> None:
    """(z s / within)^2 with z of 20 one-sided comparisons at 5 %: 2.807 (0.9975)."""
    spread = np.array([0.0, *[2.0] * 20])
    assert equal_replicates(spread, 0, Rules(0.5)) == np.ceil((2.80703 * 4.0) ** 2)
