"""`warpgrasp compare A B`: known shifts are found, equal studies do not differ, others are told."""

import csv
import json
from pathlib import Path
from typing import Any

import fake_episodes
import numpy as np
import pytest
from scipy import stats
from studies import SMALL, fill, plan_of

from sweeps.analysis.entries import LeaderboardError
from sweeps.analysis.interval import small_sample_widening
from sweeps.cli import main as cli
from sweeps.compare.matching import changes, shared_by
from sweeps.compare.shift import Differences, measure_shift
from sweeps.run.unit_file import Columns
from sweeps.run.worker import RunCells
from sweeps.spec.cell import Cell

KEY = "sensors.tendon_threshold_N"
GROWN = SMALL.replace("cell = 70", "cell = 130").replace('"wedge"', '"wedge", "funnel"') + (
    '[[strategy]]\nname = "another"\nwaypoints = { kind = "ring" }\n')


def swept(values: str) -> str:
    return SMALL + f'[sweep.grid]\n"{KEY}" = {values}\n'


def shifted(by: float, spread: float) -> RunCells:
    """The stand-ins, with `mine` worse by so many mm, more or less."""
    def rows(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
        found = fake_episodes.rows_of(cell, episodes)
        if cell.strategy.name == "mine":
            noise = [fake_episodes._uniform(cell, int(e), "shift") - 0.5 for e in episodes]
            found["chamfer_mm"] = found["chamfer_mm"] + by + spread * np.array(noise)
        return found

    return fake_episodes.cell_by_cell(rows)


def made(folder: Path, text: str = SMALL, episodes: Any = fake_episodes.run_episodes) -> Path:
    fill(folder, plan_of(folder, text), episodes)
    return folder


def compared(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    """What the command prints as JSON, its rows by their names."""
    capsys.readouterr()
    assert cli.run(["compare", *map(str, words), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    found["table"] = {row.pop("strategy"): {name: float(value) for name, value in row.items()}
                      for row in found.get("table", ())}
    return found


@pytest.mark.parametrize("over", ["these", "like-these"])
def test_a_known_shift_is_found_with_its_sign_and_size(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], over: str) -> None:
    one, other = made(tmp_path / "a"), made(tmp_path / "b", episodes=shifted(0.8, 1.0))
    table = compared(capsys, one, other, "--over", over)["table"]
    mine, same, both = (table[name] for name in ("mine", "ring6", "(all of these)"))
    assert mine["ci_low"] < 0.8 < mine["ci_high"]
    if over == "these":
        assert mine["ci_low"] > 0.5
    assert (same["b_minus_a"], same["ci_low"], same["ci_high"]) == (0.0, 0.0, 0.0)
    assert both["b_minus_a"] == pytest.approx(mine["b_minus_a"] / 2, abs=1e-3)
    assert mine["b_minus_a"] == pytest.approx(mine["chamfer_mm_b"] - mine["chamfer_mm_a"],
                                              abs=2e-3)
    back = compared(capsys, other, one, "--over", over)["table"]["mine"]
    assert (back["b_minus_a"], back["ci_low"], back["ci_high"]) == (
        -mine["b_minus_a"], -mine["ci_high"], -mine["ci_low"])


def test_equal_episodes_do_not_differ_at_all(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also where a key was changed that did nothing."""
    one = made(tmp_path / "a")
    other = made(tmp_path / "b", SMALL + "[sensors]\ntension_noise_N = 0.2\n")
    found = compared(capsys, one, other)
    assert found["changes"] == ["sensors.tension_noise_N: 0.3 -> 0.2"]
    assert found["shared"]["paired"]
    for row in found["table"].values():
        assert (row["b_minus_a"], row["ci_low"], row["ci_high"]) == (0.0, 0.0, 0.0)
        assert (row["n_objects"], row["n_episodes_a"], row["n_episodes_b"]) == (2, 140, 140)


@pytest.mark.parametrize(("mine", "theirs"), [(40.0, 40.0), (40.0, 30.0), (30.0, 40.0)])
def test_what_failed_counts_as_what_was_given_where_that_is_worse(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], mine: float, theirs: float) -> None:
    """In either study: both together have one worst."""
    def given(prior: float) -> RunCells:
        return fake_episodes.cell_by_cell(lambda cell, episodes, device: fake_episodes.rows_of(
            cell, episodes) | {"prior_chamfer_mm": np.full(len(episodes), prior)})

    one, plan = made(tmp_path / "a", episodes=given(mine)), plan_of(tmp_path / "b")
    store = fill(tmp_path / "b", plan, given(theirs))
    for unit in plan.units():
        if unit.cell.strategy.name == "mine":
            store.path(unit).unlink()
            store.log(unit).write_text("hung")
    assert compared(capsys, one, store.folder)["table"]["mine"]["chamfer_mm_b"] == 40.0


def test_a_study_that_has_grown_is_compared_on_what_was_there(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = made(tmp_path / "a"), made(tmp_path / "b", GROWN)
    found = compared(capsys, one, other)
    assert found["changes"] == ["episodes_per_cell: 70 -> 130", "objects.funnel: only in B",
                                "strategies.another: only in B"]
    assert found["shared"]["strategies"] == ["ring6", "mine"]
    assert found["shared"]["objects"] == ["block", "wedge"]
    assert found["shared"]["episodes_a"] == found["shared"]["episodes_b"] == 140
    assert {row["b_minus_a"] for row in found["table"].values()} == {0.0}


def test_episodes_without_a_score_are_told(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """That units failed is why an entry got worse; only the episodes that both have are counted."""
    one, other = made(tmp_path / "a", SMALL.replace("cell = 70", "cell = 8")), tmp_path / "b"
    plan = plan_of(other)
    store = fill(other, plan)
    for unit in plan.units():
        if unit.cell.strategy.name == "mine":
            store.path(unit).unlink()
            store.log(unit).write_text("it broke")
    notes = [note for note in compared(capsys, one, other)["notes"] if "without a score" in note]
    assert notes[-1] == ("mine: episodes without a score count as the worst on their object: "
                         "1 of A, 16 of B")


def test_blocks_that_are_missing_are_left_out_and_told(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = made(tmp_path / "a"), tmp_path / "b"
    plan = plan_of(other)
    store = fill(other, plan)
    gone = next(unit for unit in plan.units()
                if unit.cell.object_name == "wedge" and unit.start > 0)
    store.path(gone).unlink()
    found = compared(capsys, one, other)
    assert found["shared"]["episodes_a"] == 70 + 64
    assert any("1 units are missing" in note for note in found["notes"])


@pytest.mark.parametrize(("text", "said"), [
    (SMALL.replace('"block", "wedge"', '"funnel"'), "share no object of the same content: "
     "A has block, wedge; B has funnel"),
    (SMALL.replace('"ring6"', '"ring18"').replace('"mine"', '"theirs"'),
     "share no strategy under the same setting: A has ring6, mine; B has ring18, theirs"),
    (swept("[3.0, 9.0]"), "B has ring6 [sensors.tendon_threshold_N=3]")])
def test_studies_that_share_nothing_say_so(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str) -> None:
    one, other = made(tmp_path / "a"), made(tmp_path / "b", text)
    assert cli.run(["compare", str(one), str(other)]) == 2
    assert said in capsys.readouterr().err


def test_an_object_of_the_same_name_and_other_content_is_not_shared(tmp_path: Path) -> None:
    egg = '{ name = "wedge", superquadric = { size_mm = [30, 30, 45], exponents = [1.0, 1.0] } }'
    one, other = plan_of(tmp_path / "a"), plan_of(tmp_path / "b", SMALL.replace('"wedge"', egg))
    assert shared_by(one, other).objects == ("block",)


def test_nothing_finished_in_both_is_said(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = made(tmp_path / "a"), made(tmp_path / "b")
    for file in (other / "units").iterdir():
        file.unlink()
    assert cli.run(["compare", str(one), str(other)]) == 2
    assert "is finished in both" in capsys.readouterr().err


@pytest.mark.parametrize(("one", "other", "labels"), [
    ("[3.0, 6.0]", "[6.0, 9.0]", ["[sensors.tendon_threshold_N=6]"]),
    (None, "[3.0, 6.0]", ["[sensors.tendon_threshold_N=6]"]),  # 6 is the default
    ("[3.0, 9.0]", "[9.0]", ["[sensors.tendon_threshold_N=9]"]),
    (None, "[9.0]", [""]), ("[3.0]", "[9.0]", [""]),
    ("[3.0, 9.0]", "[9.0, 3.0]",
     ["[sensors.tendon_threshold_N=3]", "[sensors.tendon_threshold_N=9]"])])
def test_entries_are_matched_by_the_values_of_what_is_swept(
        tmp_path: Path, one: str | None, other: str | None, labels: list[str]) -> None:
    plans = [plan_of(tmp_path / name, SMALL if values is None else swept(values))
             for name, values in (("a", one), ("b", other))]
    found = shared_by(*plans)
    assert [match.label for match in found.matches] == [
        f"{name} {label}".strip() for name in ("ring6", "mine") for label in labels]
    assert len(shared_by(*plans[::-1]).matches) == len(found.matches)


def test_what_one_study_sweeps_is_matched_with_the_others_table(tmp_path: Path) -> None:
    fixed = plan_of(tmp_path / "a", SMALL + "[sensors]\ntendon_threshold_N = 3.0\n")
    several = plan_of(tmp_path / "b", swept("[3.0, 6.0]"))
    for one, other in ((fixed, several), (several, fixed)):
        assert [match.label for match in shared_by(one, other).matches] == [
            f"{name} [{KEY}=3]" for name in ("ring6", "mine")]


def test_swept_keys_of_strategies_are_matched_too(tmp_path: Path) -> None:
    one = plan_of(tmp_path / "a")  # ring6 has 35 degrees, mine 70
    other = plan_of(tmp_path / "b", SMALL + '[sweep.grid]\n"strategy.tilt_deg" = [35, 70]\n')
    assert [match.label for match in shared_by(one, other).matches] == [
        "ring6 [strategy.tilt_deg=35]", "mine [strategy.tilt_deg=70]"]


@pytest.mark.parametrize("noise", ["seed", "stream"])
def test_other_noise_is_not_paired(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                   noise: str) -> None:
    """Of one entry on one object the interval is Welch's."""
    first = SMALL.replace(', "wedge"', "").replace('name = "ring6"\n[[strategy]]\n', "")
    text = (first.replace("seed = 7", "seed = 8") if noise == "seed" else
            first.replace('name = "mine"', 'name = "mine"\nnoise_stream = 1'))
    one = made(tmp_path / "a", first)
    other = made(tmp_path / "b", text, shifted(0.8, 1.0))
    found = compared(capsys, one, other, "--over", "these", "--metric", "touches")
    assert not found["shared"]["paired"]
    assert any("not paired" in note for note in found["notes"])
    assert cli.run(["compare", str(one), str(other)]) == 0
    assert "of B, none of them paired" in capsys.readouterr().out
    plans = [plan_of(folder, spec) for folder, spec in ((one, first), (other, text))]
    values = [np.concatenate([fake_episodes.rows_of(
        u.cell, np.arange(u.start, u.stop))["touches"] for u in plan.units()]) for plan in plans]
    test = stats.ttest_ind(values[1], values[0], equal_var=False)
    low, high = test.confidence_interval(0.95)
    row, = found["table"].values()
    assert row["b_minus_a"] == pytest.approx(values[1].mean() - values[0].mean(), abs=1e-3)
    assert (row["ci_low"], row["ci_high"]) == pytest.approx((low, high), abs=1e-3)


def test_intervals_are_t_tests_corrected_for_their_number(tmp_path: Path) -> None:
    plan, later = plan_of(tmp_path / "a"), plan_of(tmp_path / "b")
    sides = ((plan, [fill(tmp_path / "a", plan)]),
             (later, [fill(tmp_path / "b", later, shifted(0.3, 2.0))]))
    shift = measure_shift(*sides, shared_by(plan, later), "chamfer_mm", "like-these")
    apart = np.random.default_rng(1).normal(0.4, 1.0, (5, 12, 2))
    found = Differences()
    for values in apart:
        found.add([(values, np.ones(2, bool), True)])
    low, high = stats.ttest_1samp(apart.mean(axis=1)[:, 1], 0.0).confidence_interval(1 - 0.05 / 3)
    like = found.estimate("like-these")
    assert like.low[1] + like.high[1] == pytest.approx(low + high)
    assert like.high[1] - like.low[1] == pytest.approx((high - low) * small_sample_widening(5))
    for over in ("like-these", "these"):
        assert found.estimate(over).value[2] == pytest.approx(apart.mean())
    single = Differences()
    single.add([(apart[0, :, :1], np.ones(1, bool), True)])
    low, high = stats.ttest_1samp(apart[0, :, 0], 0.0).confidence_interval(0.95)
    one = single.estimate("these")
    assert (one.low[0], one.high[0]) == pytest.approx((low, high))
    assert np.isnan(single.estimate("like-these").low).all()
    assert shift.objects == 2


@pytest.mark.parametrize("over", ["these", "like-these"])
def test_of_equal_studies_hardly_any_claims_a_difference(over: str) -> None:
    generator = np.random.default_rng(3)
    claims, trials = 0, 400
    for _ in range(trials):
        found = Differences()
        for own in generator.exponential(1.0, 6):
            one, other = own * generator.gamma(2.0, 0.5, (2, 16, 8))
            found.add([(other - one, np.ones(8, bool), True)])
        made = found.estimate(over)
        claims += bool(((made.low > 0) | (made.high < 0)).any())
    assert claims <= 0.05 * trials + 3 * np.sqrt(0.05 * 0.95 * trials)


@pytest.mark.parametrize("paired", [True, False])
def test_outcomes_that_happen_to_agree_do_not_say_that_nothing_changed(paired: bool) -> None:
    generator, held, trials = np.random.default_rng(4), 0, 200
    for _ in range(trials):
        found = Differences(chances=True)
        for _ in range(3):
            one = generator.random((4, 1))
            other = one if paired else generator.random((4, 1))
            a, b = (one < 0.97).astype(float), (other < 0.87).astype(float)
            both = np.ones(1, bool)
            found.add([(b - a, both, True)] if paired else [(-a, both, False), (b, both, False)])
        made = found.estimate("these")
        held += bool(made.low[0] <= -0.1 <= made.high[0])
    assert held >= 0.93 * trials


def test_the_mean_of_many_shares_is_known_better_than_one() -> None:
    found, both = Differences(chances=True), np.ones(16, bool)
    for _ in range(6):
        found.add([(np.zeros((8, 16)), both, True)])
    made = found.estimate("these")
    width = made.high - made.low
    assert width[-1] < 0.5 * width[0]
    assert (np.abs([made.low, made.high]) <= 1.0).all()


def test_objects_whose_outcomes_all_agree_have_the_error_of_their_episodes() -> None:
    """They do not differ, so of objects like these no less is known, but for Student's t."""
    found = Differences(chances=True)
    for _ in range(6):
        found.add([(np.zeros((8, 1)), np.ones(1, bool), True)])
    like, these = (found.estimate(over).high[0] for over in ("like-these", "these"))
    assert like / these == pytest.approx(stats.t.ppf(0.975, 5) / stats.t.ppf(0.975, 7 * 6))


def test_failing_counts_as_the_worst_of_both(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    @fake_episodes.cell_by_cell
    def failing(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
        found = fake_episodes.rows_of(cell, episodes)
        if cell.strategy.name == "mine":
            found["chamfer_mm"] = np.where(episodes % 2 == 0, np.nan, found["chamfer_mm"])
        return found

    one, other = made(tmp_path / "a"), made(tmp_path / "b", episodes=failing)
    table = compared(capsys, one, other)["table"]
    assert table["mine"]["b_minus_a"] > 0
    assert table["ring6"]["b_minus_a"] == 0.0


def test_two_versions_of_a_spec_need_no_rows(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, text in (("a", SMALL), ("b", GROWN.replace("count = 3", "count = 4"))):
        plan_of(tmp_path / name, text)
    files = [str(tmp_path / name / "spec.toml") for name in ("a", "b")]
    assert cli.run(["compare", *files]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "changes from A to B"
    assert "  strategies.mine.waypoints[0].count: 3 -> 4" in printed
    assert cli.run(["compare", files[0], files[0]]) == 0
    assert capsys.readouterr().out == "the specs of A and B are the same\n"
    assert cli.run(["compare", *files, "-o", str(tmp_path / "c.csv")]) == 2
    assert "needs two studies" in capsys.readouterr().err
    assert cli.run(["compare", files[0], str(tmp_path / "none.toml")]) == 2


def test_many_changes_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = "".join(f'[[strategy]]\nname = "s{n}"\nwaypoints = {{ kind = "ring" }}\n'
                   for n in range(60))
    plan_of(tmp_path / "a")
    plan_of(tmp_path / "b", SMALL + more)
    assert cli.run(["compare", *(str(tmp_path / n / "spec.toml") for n in "ab")]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert (len(printed), printed[-1]) == (52, "  ... 10 more")


def test_swept_keys_are_told_by_name(tmp_path: Path) -> None:
    one, other = plan_of(tmp_path / "a", swept("[3.0]")), plan_of(tmp_path / "b", swept("[3.0, 6]"))
    assert changes(one, other) == [f"sweep.{KEY}: [3.0] -> [3.0, 6]"]
    assert changes(plan_of(tmp_path / "c"), one) == [f"sweep.{KEY}: absent -> [3.0]"]


def test_the_table_is_printed_and_written(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = made(tmp_path / "a"), made(tmp_path / "b", GROWN)
    file = tmp_path / "shift.csv"
    assert cli.run(["compare", str(one), str(other), "--metric", "iou", "-o", str(file)]) == 0
    printed = capsys.readouterr()
    assert "strategies.another: only in B" in printed.out
    assert "140 pairs of the same object, number and noise" in printed.out
    assert "the 3 intervals hold together" in printed.err
    with file.open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["strategy"] for row in rows] == ["ring6", "mine", "(all of these)"]
    assert all(row["b_minus_a"] == "0.0000" for row in rows)


def test_a_leaderboard_of_two_studies_names_the_command(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = made(tmp_path / "a"), made(tmp_path / "b", GROWN)
    for command in (["leaderboard"], ["rows", "-o", str(tmp_path / "r.csv")]):
        assert cli.run([*command, str(one), str(other)]) == 3
        said = capsys.readouterr().err
        assert f"`warpgrasp compare {one} {other}`" in said
        assert "objects.funnel" in said


def test_a_metric_that_there_is_not_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LeaderboardError, match="no metric"):
        cli.app(["compare", "a", "b", "--metric", "beauty"], exit_on_error=False,
                result_action="return_value")
