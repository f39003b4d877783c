"""A race over a space: what is proposed, in which order, and that the last race has other seeds."""

import contextlib
import csv
import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from studies import write_spec

from sweeps.cli import main as cli
from sweeps.race.proposals import Proposals
from sweeps.run import worker
from sweeps.run.plan import plan_study, study_of
from sweeps.run.store import Store, plan_of
from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec
from sweeps.spec.search import with_points

SPEC = """\
schema = 1
seed = 7
objects = ["block", "wedge"]
[[strategy]]
name = "ant"
waypoints = { kind = "ring", count = 6 }
[search]
trials = 12
round = 6
finalists = 4
episodes = 8
"sensors.tendon_threshold_N" = { low = 1.0, high = 30.0 }
"strategy.count" = { low = 3, high = 6, step = 1 }
"strategy.closings" = [["together"], ["curl40", "base_then_curl"]]
"strategy.tilt_deg" = { low = 40, high = 70.0, when = { "strategy.count" = [5, 6] } }
"""
"""Of the stand-in, the lower the threshold the better; nothing else matters."""
ONE = SPEC.split('"sensors')[0]
FAKE = "fake_episodes:run_episodes"


@pytest.fixture(autouse=True)
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("optuna")
    monkeypatch.setattr(worker, "EPISODES", FAKE)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A search to its end, and what it printed."""
    pytest.importorskip("optuna")
    folder, printed = tmp_path_factory.mktemp("search"), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr(worker, "EPISODES", FAKE)
        assert search(write_spec(folder, SPEC), folder / "whole") == 0
    return folder / "whole", printed.getvalue()


def search(spec: Path, out: Path, *words: str, within: str = "0.5") -> int:
    return cli.run(["race", str(spec), "-o", str(out), "--within", within, *words])


def rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text().splitlines()))


def test_a_search_from_the_spec_to_the_claim(whole: tuple[Path, str]) -> None:
    out, printed = whole
    assert "within 0.5 mm of the best of 4 on these 2 objects, 95 %" in printed
    assert "12 proposals in 2 rounds" in printed
    found = rows(out / "search.csv")
    assert [row["round"] for row in found] == ["1"] * 6 + ["2"] * 6
    for row in found:
        assert 1.0 <= float(row["sensors.tendon_threshold_N"]) <= 30.0
        assert row["strategy.count"] in ("3", "4", "5", "6")
        assert row["strategy.closings"] in ("together", "curl40 base_then_curl")
        assert (row["strategy.tilt_deg"] != "") == (row["strategy.count"] in ("5", "6"))
    finalists = [float(row["chamfer_mm"]) for row in found if row["finalist"] == "yes"]
    assert sorted(finalists) == sorted(float(row["chamfer_mm"]) for row in found)[:4]
    race = rows(out / "race.csv")
    assert len(race) == 4
    least = min(found, key=lambda row: float(row["sensors.tendon_threshold_N"]))
    assert f"tendon_threshold_N={float(least['sensors.tendon_threshold_N']):.6g}" in " ".join(
        row["strategy"] for row in race)


def test_finalists_have_the_most_where_more_is_better(tmp_path: Path) -> None:
    assert search(write_spec(tmp_path, SPEC), tmp_path / "out", "--metric", "iou",
                  within="0.05") == 0
    found = rows(tmp_path / "out/search.csv")
    finalists = [float(row["iou"]) for row in found if row["finalist"] == "yes"]
    assert sorted(finalists) == sorted(float(row["iou"]) for row in found)[-4:]
    assert min(finalists) > 0.0


def test_the_last_race_has_seeds_of_its_own(whole: tuple[Path, str]) -> None:
    out = whole[0]
    seeds: dict[int, int] = {}
    from pyarrow import parquet

    for file in (out / "units").iterdir():
        table = parquet.read_table(file)
        seed = table["seed"].to_pylist()[0]
        seeds[seed] = seeds.get(seed, 0) + table.num_rows
    assert len(seeds) == 2
    assert 7 in seeds
    found, race = rows(out / "search.csv"), rows(out / "race.csv")
    assert seeds.pop(7) == sum(int(row["n_episodes"]) for row in found)
    assert sum(seeds.values()) == sum(int(row["n_episodes"]) for row in race)


@pytest.mark.slow
def test_workers_and_interruptions_change_no_byte(tmp_path: Path,
                                                  whole: tuple[Path, str]) -> None:
    spec, one = write_spec(tmp_path, SPEC), whole[0]
    assert search(spec, tmp_path / "two", "--workers", "2") == 0
    files = sorted((one / "units").iterdir())
    shutil.copytree(one, tmp_path / "part")
    for file in files[::3]:
        (tmp_path / "part" / "units" / file.name).unlink()
    assert search(spec, tmp_path / "part") == 0
    for other in ("two", "part"):
        assert sorted(f.name for f in (tmp_path / other / "units").iterdir()) == [
            f.name for f in files]
        for name in ("race.csv", "race.svg", "search.csv", *(f"units/{f.name}" for f in files)):
            assert (tmp_path / other / name).read_bytes() == (one / name).read_bytes()


def test_a_budget_keeps_half_for_the_last_race(tmp_path: Path,
                                               capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ("--budget-episodes", "300")
    assert search(write_spec(tmp_path, SPEC), out, *words, within="0.01") == 0
    found, race = rows(out / "search.csv"), rows(out / "race.csv")
    assert sum(int(row["n_episodes"]) for row in found) <= 150
    assert sum(int(row["n_episodes"]) for row in (*found, *race)) <= 300
    assert search(tmp_path / "spec.toml", tmp_path / "few", "--budget-episodes", "20") == 2
    assert "half of it is for proposals" in capsys.readouterr().err


def test_a_proposal_takes_as_many_episodes_as_the_search_says(tmp_path: Path) -> None:
    """Also where the race of a round could go on: of ends so near, none is known to be best."""
    out, text = tmp_path / "out", SPEC.replace("high = 30.0", "high = 1.5")
    assert search(write_spec(tmp_path, text), out, "--start", "4", "--budget-episodes", "300",
                  within="0.01") == 0
    found = rows(out / "search.csv")
    assert max(int(row["n_episodes"]) for row in found) == 8 * 2
    assert sum(int(row["n_episodes"]) for row in found) <= 150


def test_whole_numbers_are_proposed_without_a_step_too(tmp_path: Path) -> None:
    text = SPEC.replace("high = 6, step = 1", "high = 6")
    study = read_spec(write_spec(tmp_path, text))
    assert study.search == read_spec(write_spec(tmp_path, SPEC)).search
    with pytest.raises(SpecError, match=r"\[search\]: strategy.count: is 4.5"):
        with_points(study, study.search, [{"strategy.count": 4.5}])


def test_the_same_proposals_of_a_round_are_one_entry(tmp_path: Path) -> None:
    study = read_spec(write_spec(tmp_path, ONE + '"strategy.count" = [5, 6]'))
    proposals = Proposals(study.search, 3)
    points = proposals.ask(12)
    assert sorted(point["strategy.count"] for point in points) == [5, 6]
    proposals.tell([float(point["strategy.count"]) for point in points])
    told = [(trial.params["strategy.count"], trial.value) for trial in proposals.study.trials]
    assert sorted(set(told)) == [(0, 5.0), (1, 6.0)]
    assert len(told) == proposals.tried == 12


def test_entries_proposed_again_count_once_against_the_budget(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    """Two entries in all: each round proposes both, whose episodes are there from the first on."""
    text = ONE.replace("trials = 12", "trials = 60") + '"strategy.count" = [5, 6]'
    out = tmp_path / "out"
    assert search(write_spec(tmp_path, text), out, "--budget-episodes", "400") == 0
    assert {row["n_episodes"] for row in rows(out / "search.csv")} == {"16"}
    assert len(rows(out / "search.csv")) > 10
    assert "rounds took 32 episodes" in capsys.readouterr().out


@pytest.mark.parametrize(("trials", "rounds"), [(9, [4, 5]), (5, [2, 3])])
def test_a_last_trial_joins_the_round_before(tmp_path: Path, trials: int, rounds: list[int],
                                             capsys: pytest.CaptureFixture[str]) -> None:
    text = SPEC.replace("trials = 12", f"trials = {trials}").replace(
        "round = 6", f"round = {rounds[0]}")
    assert search(write_spec(tmp_path, text), tmp_path / "out") == 0
    capsys.readouterr()
    assert cli.run(["check", str(tmp_path / "spec.toml")]) == 0
    assert f"at most {trials * 8 * 2} episodes, and those of the last" in capsys.readouterr().out
    found = [row["round"] for row in rows(tmp_path / "out/search.csv")]
    assert [found.count(number) for number in ("1", "2", "3")] == [*rounds, 0]


def test_nothing_races_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ONE + '"strategy.aim" = { low = 0.3, high = 0.30000001 }'
    assert search(write_spec(tmp_path, text), tmp_path / "out") == 2
    assert "[search]: all proposals are the same entry" in capsys.readouterr().err


def test_no_round_begins_after_the_time(tmp_path: Path,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    out, text = tmp_path / "out", SPEC.replace('["block", "wedge"]', '["block"]')
    assert search(write_spec(tmp_path, text), out, "--budget-minutes", "0.0001") == 0
    assert {row["round"] for row in rows(out / "search.csv")} == {"1"}
    printed = capsys.readouterr()
    assert "6 proposals in 1 round took" in printed.out
    assert "of the best of 4 on this object, 95 %" in printed.out


def test_the_sampler_learns_where_it_is_good(tmp_path: Path) -> None:
    study = read_spec(write_spec(tmp_path, SPEC))
    proposals, scores = Proposals(study.search, 3), []
    for _ in range(8):
        points = proposals.ask(10)
        scores.append([abs(point["sensors.tendon_threshold_N"] - 12.0) for point in points])
        proposals.tell(scores[-1])
    assert np.mean(scores[-2:]) < 0.5 * np.mean(scores[0])
    again = Proposals(study.search, 3)
    assert [abs(p["sensors.tendon_threshold_N"] - 12.0) for p in again.ask(10)] == scores[0]


def test_what_was_not_proposed_stays_as_it_is(tmp_path: Path) -> None:
    study = read_spec(write_spec(tmp_path, SPEC))
    points = [{"strategy.count": 5, "strategy.tilt_deg": 47.5}, {"strategy.count": 3}]
    made = with_points(study, study.search, points)
    cells = [made.cell(0, 0, n) for n in range(2)]
    assert [cell.strategy.waypoints[0].count for cell in cells] == [5, 3]  # type: ignore[attr-defined]
    assert cells[0].strategy.waypoints[0].tilt_rad == pytest.approx(np.radians(47.5))  # type: ignore[attr-defined]
    assert cells[1].strategy.waypoints[0].tilt_rad == (  # type: ignore[attr-defined]
        study.strategies[0].waypoints[0].tilt_rad)  # type: ignore[attr-defined]
    assert cells[1].setting == {"strategy.count": 3}


def test_a_folder_keeps_the_search(tmp_path: Path) -> None:
    plan = plan_study(read_spec(write_spec(tmp_path, SPEC)))
    store = Store(tmp_path / "out")
    store.open_for(plan, None, "cpu")
    assert plan_of(store).study.search == plan.study.search
    assert plan_study(study_of(plan.resolved)).hash == plan.hash


def test_without_optuna_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(__import__("sys").modules, "optuna", None)
    assert search(write_spec(tmp_path, SPEC), tmp_path / "out") == 2
    assert "pip install '.[search]'" in capsys.readouterr().err


@pytest.mark.parametrize(("line", "message"), [
    ('"strategy.nothing" = { low = 1, high = 2 }', "unknown key 'strategy.nothing'"),
    ('"strategy.aim" = { low = 1, high = 0.5 }', "should have numbers low < high"),
    ('"strategy.aim" = { low = 0.2, high = 0.5, step = 0 }', "and step > 0"),
    ('"strategy.aim" = 0.5', "should be a range such as"),
    ('"strategy.aim" = []', "should be a list of at least one value"),
    ('"strategy.aim" = { low = 0.2, high = 0.5, when = { "strategy.x" = [1] } }',
     "'strategy.x' is no factor above this one"),
    ('"strategy.aim" = { low = 0.2, high = 0.5, when = 3 }', "should name values of factors above"),
    ('"strategy.aim" = { low = 0.2, high = inf, step = 0.1 }', "should have numbers low < high"),
    ('"strategy.touches" = { low = 3, high = 6.0, step = 1 }', "is 6.0; should be a whole"),
    ('[sweep.grid]\n"contact.friction" = [0.2, 0.5]', "search: proposes entries of one strategy"),
    ('[[strategy]]\nname = "ring6"', "search: proposes entries of one strategy"),
    ("finalists = 1", "finalists: is 1; should be a whole number from 2"),
    ('"contact.friction" = { low = 0, high = 1, when = { "strategy.count" = [99] } }',
     "strategy.count is never 99"),
    ('"fit.rounds" = { low = 1, high = 4, step = 2 }\n'
     '"strategy.aim" = { low = 0.2, high = 0.5, when = { "fit.rounds" = [2] } }',
     "fit.rounds is never 2; should be one of the choices of the factor above, or of its steps"),
    ('"strategy.aim" = { low = 0.2, high = 0.5, when = { "sensors.tendon_threshold_N" = [6] } }',
     "sensors.tendon_threshold_N is never 6"),
    ('"strategy.aim" = [0.2, 1, 1.0]', "strategy.aim': holds the same value twice"),
    ('"hand.kind" = ["utah_mit", "nope"]', "no hand 'nope'"),
    ('hand = ["utah_mit", "nope"]', "search.hand: no hand 'nope'"),
    ('hand = ["utah_mit", "leap"]\n"hand.kind" = ["allegro"]', "hand.kind is a factor already"),
    ('hand = ["utah_mit", "leap"]\n'
     '"contact.friction" = { low = 0, high = 1, when = { hand = ["allegro"] } }',
     "hand.kind is never 'allegro'"),
    ('"hand.kind" = ["utah_mit", "mine.toml"]', "a search proposes those that ship"),
    ('"arm.kind" = ["puma560", "nope"]', "no arm 'nope'"),
    ('"hand.flexion_low_deg" = [[-10, 0, 0], [95, 0, 0]]',
     "with hand.flexion_low_deg = (95, 0, 0): flexion_low_deg should be below flexion_high_deg"),
    ('"strategy.order" = [["planar"], ["containment"]]\n"errors.scale" = { low = 1, high = 10 }',
     "with errors.scale = 10: pad_gain_pct times scale is 100 %"),
    ('"strategy.order" = [["planar"], ["containment"]]\n"pads.floor_N" = { low = 0, high = 3 }',
     "with pads.floor_N = 3: taxels feel from 3 N on: wants less than the full scale, 1.2 N"),
    ('"fit.reconstruct" = ["chosen", "nonsense"]', "fit.reconstruct: is 'nonsense'"),
    ('[sweep.grid]\n"strategy.count" = [4, 5]', "strategy.count is swept already in [sweep]"),
])
def test_refusals(tmp_path: Path, line: str, message: str) -> None:
    text = SPEC.replace("finalists = 4\n", "") if line.startswith("finalists") else SPEC
    text = text + line + "\n" if not line.startswith("finalists") else text.replace(
        "[search]\n", f"[search]\n{line}\n")
    with pytest.raises(SpecError) as caught:
        read_spec(write_spec(tmp_path, text))
    assert message in str(caught.value)


def test_a_space_of_too_many_ends_is_refused(tmp_path: Path) -> None:
    """Every point was checked: it took hours."""
    lines = "".join(f'"pads.{key}" = [{", ".join(str(20 + n / 10) for n in range(40))}]\n'
                    for key in ("length_mm", "width_mm", "wrap_deg", "rest_ohm"))
    with pytest.raises(SpecError, match=r"pads.length_mm, pads.width_mm, pads.wrap_deg: has 64,000 "
                       "combinations .* should be 20,000 at most"):
        read_spec(write_spec(tmp_path, SPEC.replace("[search]\n", (
            'order = ["containment", "planar"]\n[search]\n')) + lines))


@pytest.mark.parametrize("line", ['"strategy.count" = [5]', '"strategy.count" = [5, 5]',
                                  '"strategy.count" = { low = 5, high = 6, step = 2 }'])
def test_a_space_of_one_point_is_refused(tmp_path: Path, line: str) -> None:
    with pytest.raises(SpecError, match="search: is a space of one point"):
        read_spec(write_spec(tmp_path, ONE + line))


def test_a_sweep_of_a_search_is_refused(tmp_path: Path,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    assert cli.run(["sweep", str(spec), "-o", str(tmp_path / "out")]) == 2
    assert "[search] is for `warpgrasp race`" in capsys.readouterr().err
