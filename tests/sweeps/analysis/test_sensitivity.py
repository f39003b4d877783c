"""The sensitivity study: its spec is a study, its table tells a swap from noise."""

import json

import numpy as np
import pytest
from scipy.stats import t, ttest_1samp
from studies import SMALL, fill, plan_of, write_spec

from sweeps.analysis.sensitivity import (
    BRACKETS,
    SWEPT,
    _lead,
    _scores,
    _sure,
    _swapped,
    check_study,
    sensitivity_spec,
    sensitivity_table,
)
from sweeps.cli.main import run
from sweeps.run import worker
from sweeps.run.plan import Plan, cell_hash, plan_study
from sweeps.run.store import Store
from sweeps.spec.reader import read_spec


def test_the_spec_varies_one_constant_a_setting(tmp_path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(sensitivity_spec())
    plan = plan_study(read_spec(file))
    check_study(plan, file)
    study = plan.study
    assert study.setting_count == 1 + sum(len(b.rows) for b in BRACKETS)
    base, _ = study.setting(0)
    for number in range(1, study.setting_count):
        edge, _ = study.setting(number)
        assert sum(edge[key] != base[key] for key in edge if key != SWEPT) == 1


def test_a_constant_is_varied_in_truth_in_belief_and_in_both(tmp_path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(sensitivity_spec(BRACKETS[3:4], ("ring6", "column9"), ("block",), 2))
    study = read_spec(file)
    cells = [study.cell(0, 0, n) for n in range(study.setting_count)]
    radii = [(c.hand.link_radius_m, (c.true or c).hand.link_radius_m) for c in cells]
    assert radii == pytest.approx(np.array([
        (8, 8), (6, 6), (8, 6), (6, 8), (10, 10), (8, 10), (10, 8)]) / 1e3)
    assert all(c.sensors == cells[0].sensors for c in cells)
    assert len({cell_hash(c, study.objects[0]) for c in cells}) == len(cells)


def test_defaults_are_the_tables() -> None:
    from sweeps.spec.cell import SECTIONS
    from sweeps.spec.units import spec_fields

    for bracket in BRACKETS:
        section, name = bracket.key.split(".")
        default = spec_fields(SECTIONS[section])[name].spec_default
        assert np.allclose(default, bracket.default), bracket.key


def test_only_sure_swaps_count() -> None:
    rng = np.random.default_rng(0)
    base = rng.normal(0.0, 0.1, (2, 3, 16)) + np.array([1.0, 2.0])[:, None, None]
    assert _swapped(base, base[::-1], ("a", "b"), 1e-4) == "a > b"
    assert _swapped(base, base, ("a", "b"), 1e-4) == "none"
    assert _swapped(base, base + rng.normal(0.0, 9.0, base.shape), ("a", "b"), 1e-4) == "none"


def test_what_is_sure_depends_on_how_much_is_compared() -> None:
    """Six pairs of four strategies in seventy settings; objects of equal spread have 15 degrees
    each, of ends that are far apart those of one object."""
    assert _sure(np.zeros((70, 4, 6, 16))) == pytest.approx(0.05 / 2 / 420)
    episodes = np.tile(np.random.default_rng(4).normal(0.4, 1.0, 16), (6, 1))
    lead, chance = _lead(episodes)
    assert chance == pytest.approx(t.sf(lead, 90))
    episodes[1:] *= 1e-6
    lead, chance = _lead(episodes)
    assert (lead, chance) == pytest.approx(
        [*ttest_1samp(episodes[0], 0.0, alternative="greater")], rel=1e-4)


@pytest.mark.slow
def test_hardly_any_table_swaps_strategies_that_are_equal() -> None:
    """By default they are far apart, in sixty settings equal; one object has twenty times the
    spread. With the degrees of freedom of all objects half of the tables had a swap."""
    rng, wrong, names = np.random.default_rng(1), 0, tuple("abcd")
    spread = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 20.0])[:, None]
    for _ in range(40):
        scores = spread * rng.normal(size=(61, 4, 6, 8))
        scores[0] += np.array([0.0, 600.0, 1200.0, 1800.0])[:, None, None]
        wrong += any(_swapped(scores[0], values, names, _sure(scores)) != "none"
                     for values in scores[1:])
    assert wrong <= 4  # two in the mean, at most


def test_objects_count_alike_whatever_their_episodes() -> None:
    """Worse by 3 mm in the two episodes of one object, better by 1 in the sixteen of another."""
    apart = np.full((2, 16), np.nan)
    apart[0] = -1.0 + 0.05 * np.random.default_rng(0).normal(size=16)
    apart[1, :2] = 3.0, 3.1
    assert _lead(apart)[0] > 0.0


def fails(store: Store, plan: Plan, strategy: int, setting: int, body: int) -> None:
    """Makes a unit of the study one that failed."""
    cell = plan.study.cell(strategy, body, setting)
    unit = plan.unit(cell, cell_hash(cell, plan.study.objects[body]), 0)
    store.path(unit).unlink()
    store.log(unit).write_text("hung")


def test_episodes_that_fail_count_as_the_worst(tmp_path) -> None:
    """Else a strategy would be the better, the more of its hard episodes fail."""
    plan = plan_of(tmp_path / "spec", f"{SMALL}[sweep.zip]\n{THRESHOLD}")
    store = fill(tmp_path / "out", plan)
    (_, before), _ = sensitivity_table(plan, store)
    best = [s.name for s in plan.study.strategies].index(before[4])
    for body in range(2):
        fails(store, plan, best, 1, body)
    (_, after), notes = sensitivity_table(plan, store)
    assert after[4] != before[4]
    assert float(after[6]) > float(before[6])
    assert any(note.endswith(f"episodes of {before[4]} have no score and count as the worst on "
                             "their object") for note in notes)


def test_units_that_are_missing_are_left_out_of_all_settings(tmp_path) -> None:
    plan = plan_of(tmp_path / "spec", f"{SMALL}[sweep.zip]\n{THRESHOLD}")
    store = fill(tmp_path / "out", plan)
    cell = plan.study.cell(0, 0, 1)
    store.path(plan.unit(cell, cell_hash(cell, plan.study.objects[0]), 0)).unlink()
    scores, notes = _scores(plan, store)
    there = np.isfinite(scores).sum(axis=-1)
    assert (there == [6, 70]).all()
    assert notes[-1].startswith("1 units are missing")


def test_one_episode_tells_nothing_of_chance(tmp_path) -> None:
    text = SMALL.replace("episodes_per_cell = 70", "episodes_per_cell = 1")
    plan = plan_of(tmp_path / "spec", f"{text}[sweep.zip]\n{THRESHOLD}")
    _, notes = sensitivity_table(plan, fill(tmp_path / "out", plan))
    assert notes[1] == "fewer than two episodes do not tell which tau is chance"


def test_where_nothing_has_a_score_there_is_no_best(tmp_path) -> None:
    plan = plan_of(tmp_path / "spec", f"{SMALL}[sweep.zip]\n{THRESHOLD}")
    store = Store(tmp_path / "out")
    store.open_for(plan, None, "cpu")
    for unit in plan.units():
        store.log(unit).write_text("hung")
    rows, notes = sensitivity_table(plan, store)
    assert [row[3:8] for row in rows] == [("NA", "NA", "NA", "NA", "none")] * 2
    assert len([note for note in notes if note.endswith("nothing has a score there")]) == 2


SPEC = SMALL.replace("= 70", "= 3") + "[sweep.zip]\n"
THRESHOLD = '"sensors.tendon_threshold_N" = [6.0, 3.0]\n'


@pytest.mark.parametrize(("text", "says"), [
    (SPEC + THRESHOLD + '"hand.link_radius_mm" = [8.0, 10.0]',
     "sweep: setting 2 changes sensors.tendon_threshold_N and hand.link_radius_mm; each should"),
    (SPEC.partition('[[strategy]]\nname = "mine"')[0] + "[sweep.zip]\n" + THRESHOLD,
     "strategy: is one; a ranking needs two"),
    (SPEC + THRESHOLD.replace("6.0, 3.0", "3.0, 6.0"), "sweep: sensors.tendon_threshold_N is 3 in "
     "the first setting; should be the default there"),
    (SPEC + '"strategy.closings" = [["curl40"], ["base_then_curl"]]', "sweep: strategy.closings"),
    (SPEC + '"hand.link_radius_mm" = [8.0, 10.0, 8.0]\n"contact.friction" = [0.5, 0.5, 1.0]\n'
     '"robot.swept" = ["both", "truth", "belief"]', "sweep: setting 3 changes contact.friction "
     "where robot.swept is belief; should be both"),
    (SPEC.removesuffix("[sweep.zip]\n"), "sweep: is of one setting; should be one [sweep.zip]"),
])
def test_a_spec_of_another_kind_is_refused(tmp_path, capsys, text, says) -> None:
    out = tmp_path / "out"
    assert run(["sensitivity", "-o", str(out), "--spec", str(write_spec(tmp_path, text))]) == 2
    assert says in capsys.readouterr().err
    assert not (out / "units").exists()


def test_a_constant_may_be_a_text_and_episodes_are_as_asked(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    spec = write_spec(tmp_path, SPEC + '"sensors.contact_estimator" = ["intrinsic", "fingertip"]')
    assert run(["sensitivity", "-o", str(tmp_path / "out"), "--spec", str(spec), "--episodes", "40",
                "--json"]) == 0
    printed = capsys.readouterr()
    row = json.loads(printed.out)[1]
    assert (row["constant"], row["value"]) == ("sensors.contact_estimator", "fingertip")
    assert isinstance(row["mean_change_mm"], float)
    assert "2 objects x 40 episodes" in printed.err


def test_names_break_no_table(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    text = SPEC.replace('"ring6"', '"=a|b"\nwaypoints = { kind = "ring", count = 6 }') + THRESHOLD
    assert run(["sensitivity", "-o", str(tmp_path / "out"), "--spec",
                str(write_spec(tmp_path, text))]) == 0
    assert "(default),,both,1.00,'=a|b," in (tmp_path / "out/sensitivity.csv").read_text()
    assert "| =a\\|b |" in (tmp_path / "out/sensitivity.md").read_text()


def test_a_directory_of_another_study_is_left_as_it_is(tmp_path, capsys) -> None:
    plan, folder = plan_of(tmp_path / "spec"), tmp_path / "out"
    folder.mkdir()
    Store(folder).open_for(plan, None, "cpu")
    before = sorted(folder.rglob("*"))
    assert run(["sensitivity", "-o", str(folder)]) == 3
    assert "belongs to another spec" in capsys.readouterr().err
    assert sorted(folder.rglob("*")) == before


@pytest.mark.slow
def test_the_command_prints_a_row_a_setting(tmp_path, capsys) -> None:
    few = sensitivity_spec(BRACKETS[:1], ("ring6", "column9"), ("block",), 2)
    spec = tmp_path / "few.toml"
    spec.write_text(few)
    assert run(["sensitivity", "-o", str(tmp_path / "out"), "--spec", str(spec)]) == 0
    assert "hand.link_length_mm" in capsys.readouterr().out
    assert (tmp_path / "out" / "sensitivity.csv").read_text().count("\n") == 8
