"""The reference row `given-prior`: every board has it, unranked, and flags what is worse."""

import csv
import io
from pathlib import Path

import fake_episodes
import numpy as np
import pytest
from curved_episodes import wide_text
from studies import SMALL, board, fill, plan_of, run_in

from sweeps.analysis.entries import Reference
from sweeps.analysis.leaderboard import ReferenceMeans, make_leaderboard
from sweeps.analysis.paired import read_paired
from sweeps.report.page import make_report
from sweeps.spec.cell import Cell
from sweeps.spec.errors import SpecError
from sweeps.watch.view import View

SWEPT = SMALL + """
[sweep.grid]
"object.prior_sigma_mm" = [0, 20]
"""
THREE = SMALL + '[[strategy]]\nname = "worst-of-all"\nwaypoints = { kind = "ring", count = 3 }\n'


def rows_of(text: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text.decode())))


def told(cell: Cell, episodes: np.ndarray, device: str = "cpu") -> dict[str, np.ndarray]:
    """The prior is 9.6 mm off in the mean; "mine" 7.1, "ring6" 8.1, and "worst-of-all" 15.1 mm,
    failures not counted."""
    rows = fake_episodes.rows_of(cell, episodes)
    luck = np.array([fake_episodes._uniform(cell, int(e), "luck") for e in episodes])
    prior = 6.6 + 4 * luck + 0.1 * 1e3 * cell.placement.prior_sigma_m
    return rows | {"prior_chamfer_mm": prior, "prior_iou": 1 / (1 + 0.1 * prior)}


SAME = fake_episodes.cell_by_cell(told)


def test_the_reference_row_is_last_unranked_and_what_the_rows_say(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, THREE)
    store = fill(tmp_path, plan, SAME)
    *entries, last = rows_of(make_leaderboard(plan, [store]).csv())
    assert [row["rank"] for row in entries] == ["1", "2", "3"]
    assert (last["rank"], last["strategy"]) == ("NA", "given-prior")
    means: dict[str, list[np.ndarray]] = {}
    for unit in plan.units():
        if unit.cell.strategy.name == "mine":
            rows = store.read(unit)
            assert rows is not None
            means.setdefault(unit.cell.object_name, []).append(rows["prior_chamfer_mm"])
    values = [np.concatenate(parts) for parts in means.values()]
    assert last["chamfer_mm"] == f"{np.mean([v.mean() for v in values]):.3f}"
    # the interval of these objects by hand: a stratified mean
    half = np.sqrt(sum(v.var(ddof=1) / len(v) for v in values)) / len(values)
    width = float(last["chamfer_mm_these_high"]) - float(last["chamfer_mm_these_low"])
    assert width == pytest.approx(2 * 1.98 * half, rel=0.02)
    assert (last["touches"], last["robot_time_s"], last["contacts"]) == ("0.00", "0.00", "0.00")
    assert last["p_best"] == last["recognized"] == last["failure_rate"] == "NA"
    assert (last["n_objects"], last["n_episodes"]) == ("2", "140")
    apart = float(last["chamfer_mm"]) - float(entries[0]["chamfer_mm"])
    assert float(last["delta_to_best_mm"]) == pytest.approx(apart, abs=2e-3)
    assert 0.0 < float(last["iou"]) < 1.0


def test_an_entry_that_is_worse_than_doing_nothing_is_flagged(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, THREE)
    made = make_leaderboard(plan, [fill(tmp_path, plan, SAME)])
    flags = {row["strategy"]: row["worse_than_prior"] for row in rows_of(made.csv())}
    assert flags["mine"] == "no"
    assert flags["worst-of-all"] == "yes"
    assert flags["given-prior"] == "NA"
    lines = [line for line in made.notes if "worse than given-prior" in line]
    assert lines[0].startswith("worst-of-all is worse than given-prior, ")
    assert not any(line.startswith("mine ") for line in lines)
    # more is better: the same flags
    by_iou = rows_of(make_leaderboard(plan, [fill(tmp_path, plan, SAME)], metric="iou").csv())
    assert {row["strategy"]: row["worse_than_prior"] for row in by_iou}["worst-of-all"] == "yes"


def test_a_note_gives_no_range_that_says_nothing(tmp_path: Path) -> None:
    """Of twelve entries with two episodes of one object it was thousands of millimetres."""
    @fake_episodes.cell_by_cell
    def apart(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        return told(cell, episodes) | {
            "chamfer_mm": 20.0 + 10.0 * (-1.0) ** episodes * len(cell.strategy.name)}

    plan = plan_of(tmp_path, wide_text(12, 1, 2))
    made = make_leaderboard(plan, [fill(tmp_path, plan, apart)])
    lines = [line for line in made.notes if "worse than given-prior" in line]
    assert lines
    assert not any(" on these objects" in line for line in lines)


def test_rounding_makes_no_entry_worse_than_its_prior(tmp_path: Path) -> None:
    @fake_episodes.cell_by_cell
    def nothing(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        rows = told(cell, episodes)
        return rows | {"chamfer_mm": rows["prior_chamfer_mm"] * (1.0 + 1e-15)}

    plan = plan_of(tmp_path)
    made = make_leaderboard(plan, [fill(tmp_path, plan, nothing)])
    assert {row["worse_than_prior"] for row in rows_of(made.csv())[:2]} == {"no"}
    assert not any("worse than given-prior" in line for line in made.notes)


def test_a_mean_that_is_worse_by_chance_is_told_from_one_that_is_surely_worse(
        tmp_path: Path) -> None:
    @fake_episodes.cell_by_cell
    def noisy(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        rows = told(cell, episodes)
        wild = np.where(episodes % 2, 9.0, -9.0) - 2.8
        return rows | {"prior_chamfer_mm": rows["prior_chamfer_mm"] + wild}

    plan = plan_of(tmp_path)
    made = make_leaderboard(plan, [fill(tmp_path, plan, noisy)])
    assert {row["worse_than_prior"] for row in rows_of(made.csv())[:2]} == {"mean"}
    assert any("in the mean, which may be chance" in line for line in made.notes)


def test_each_setting_of_the_prior_has_its_own_reference(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, SWEPT)
    store = fill(tmp_path, plan, SAME)
    *_, exact, rough = rows_of(make_leaderboard(plan, [store]).csv())
    assert exact["strategy"] == "given-prior [object.prior_sigma_mm=0]"
    assert rough["strategy"] == "given-prior [object.prior_sigma_mm=20]"
    assert float(rough["chamfer_mm"]) - float(exact["chamfer_mm"]) == pytest.approx(2.0, abs=2e-3)
    pooled = rows_of(make_leaderboard(plan, [store], by=["strategy"]).csv())
    assert [row["strategy"] for row in pooled if row["rank"] == "NA"] == ["given-prior"]
    each = rows_of(make_leaderboard(plan, [store], by=["strategy", "object"]).csv())
    assert [row["strategy"] for row in each if row["rank"] == "NA"] == [
        "given-prior [object=block]", "given-prior [object=wedge]"]


def test_the_best_of_many_that_gain_nothing_is_not_called_better_than_nothing() -> None:
    """Of thirty entries that score as their prior does, the first is better than it by luck: the
    interval of the reference's difference, which is of one entry alone, excludes 0 in half of the
    boards. A note says so, unless the gain holds for all of them."""
    rng, count = np.random.default_rng(5), 30
    alone = untold = 0
    for gain in [0.0] * 60 + [3.0]:
        beside = ReferenceMeans([Reference("given-prior", tuple(range(count)))], count,
                                "chamfer_mm", 0)
        for _ in range(6):
            prior = np.repeat(rng.gamma(4.0, 2.5, (16, 1)), count, axis=1)
            values = prior + rng.normal(0.0, 2.0, prior.shape)
            values[:, 0] -= gain
            beside.add(values, prior)
        best = int(beside.means.values("these").value[:count].argmin())
        excludes = bool(beside.columns(best)["delta_these_low"][0] > 0.0)
        told = any(line.startswith("delta_these_ of given-prior excludes 0 for one entry alone")
                   for line in beside.by_choice(best, 1.0))
        assert excludes or not told
        if gain:
            assert excludes
            assert not told
        else:
            alone += excludes
            untold += excludes and not told
    assert alone > 20
    assert untold <= 0.05 * 60 + 5


def test_a_board_says_that_its_first_may_be_better_than_the_prior_by_luck(tmp_path: Path) -> None:
    @fake_episodes.cell_by_cell
    def lucky(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        rows = told(cell, episodes)
        own = np.where(episodes % 2, 1.0, -1.0) * len(cell.strategy.name)
        return rows | {"status": np.full(len(episodes), "ok", object),
                       "chamfer_mm": rows["prior_chamfer_mm"] + own - 0.7}

    plan = plan_of(tmp_path, THREE)
    made = make_leaderboard(plan, [fill(tmp_path, plan, lucky)])
    last = rows_of(made.csv())[-1]
    assert float(last["delta_these_low"]) > 0.0
    assert any(note.startswith("delta_these_ of given-prior excludes 0 for one entry alone; the "
                               "best of 3 ") for note in made.notes)


def test_costs_of_doing_nothing_are_nothing_and_flag_nobody(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan, SAME)
    *entries, last = rows_of(make_leaderboard(plan, [store], metric="robot_time_s").csv())
    assert last["robot_time_s"] == "0.000"
    assert {row["worse_than_prior"] for row in entries} == {"NA"}


def test_failing_scores_no_better_than_doing_nothing(tmp_path: Path) -> None:
    """Units of one entry fail; all others are better than the prior in every episode."""
    @fake_episodes.cell_by_cell
    def far(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        rows = told(cell, episodes)
        return rows | {"prior_chamfer_mm": rows["prior_chamfer_mm"] + 20.0}

    plan = plan_of(tmp_path, THREE)
    store = fill(tmp_path, plan, far)
    for unit in plan.units():
        if unit.cell.strategy.name == "mine":
            store.path(unit).unlink()
            store.log(unit).write_text("hung")
    made = make_leaderboard(plan, [store])
    scores = {row["strategy"]: row["chamfer_mm"] for row in rows_of(made.csv())}
    assert float(scores["mine"]) > float(scores["given-prior"]) > 20.0
    assert any(line.startswith("mine: 4 of 4 units failed") for line in made.notes)
    assert read_paired(plan, [store], ["chamfer_mm"]).means["chamfer_mm"][0, 1] == pytest.approx(
        float(scores["mine"]), abs=1e-3)
    shown = {row.label: row.mean for row in View(tmp_path, "chamfer_mm").state().rows}
    assert shown["mine"] == pytest.approx(float(scores["mine"]), abs=1e-3)


def test_any_number_of_workers_gives_the_same_bytes(tmp_path: Path) -> None:
    boards = []
    for workers in (1, 2):
        plan = plan_of(tmp_path / str(workers), SMALL)
        run_in(tmp_path / str(workers), plan, "given_episodes", workers)
        boards.append(board(plan, tmp_path / str(workers)))
    assert boards[0] == boards[1]
    assert b"\nNA,given-prior," in boards[0]


def test_the_report_has_the_reference_row_and_warns(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, THREE)
    text = make_report(plan, [fill(tmp_path, plan, SAME)], views=False).decode()
    assert ">given-prior<" in text
    assert "worst-of-all is worse than given-prior" in text
    assert "Of the 2 others" in text


def test_a_strategy_may_not_have_the_name_of_the_reference(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="given-prior"):
        plan_of(tmp_path, SMALL.replace('name = "mine"', 'name = "given-prior"'))
