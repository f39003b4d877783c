"""The command: what it prints and leaves, resumed, damaged, with any number of workers."""

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from json_rows import assert_same_cells, csv_rows
from places import ROOT
from studies import write_spec

from sweeps.cli import main as cli
from sweeps.race.race_units import RaceUnits
from sweeps.run import worker
from sweeps.run.plan import Plan, Unit, plan_study
from sweeps.run.store import Store
from sweeps.run.unit_file import DamagedUnit, read_unit
from sweeps.spec.reader import read_spec

SPEC = """\
schema = 1
seed = 7
episodes_per_cell = 4
objects = ["block", "wedge", "funnel"]
""" + "".join(f"""[[strategy]]
name = "{name}"
waypoints = {{ kind = "ring", count = 6 }}
""" for name in ("ant", "bee", "cow", "dog", "horse", "elephant"))
"""Of the stand-in, strategies whose names are equally long are equally good; each has its luck."""
FILES = ("race.csv", "race.svg", "resolved.json")
FAKE = "fake_episodes:run_episodes"


@pytest.fixture(autouse=True)
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", FAKE)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A race to its end, its spec beside it; and what it printed."""
    folder = tmp_path_factory.mktemp("race")
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr(worker, "EPISODES", FAKE)
        assert race(write_spec(folder, SPEC), folder / "whole", "--json") == 0
    return folder / "whole", printed.getvalue()


def race(spec: Path, out: Path, *words: str, within: str = "0.3") -> int:
    return cli.run(["race", str(spec), "-o", str(out), "--within", within, *words])


def rows(out: Path) -> list[dict[str, str]]:
    return csv_rows(out / "race.csv")


def test_a_race_from_the_spec_to_the_sentence(whole: tuple[Path, str],
                                              capsys: pytest.CaptureFixture[str]) -> None:
    out, printed = whole
    told = json.loads(printed)
    assert told["best"] in ("ant", "bee", "cow", "dog")
    assert told["claim"] == "within 0.3 mm of the best of 6 on these 3 objects, 95 %"
    assert told["reached"]
    found = rows(out)
    assert_same_cells(found, told["table"])
    assert cli.run(["leaderboard", str(out)]) == 3
    assert "holds a race, whose outcome is in its race.csv" in capsys.readouterr().err
    assert [row["verdict"] for row in found].count("best") == 1
    assert [row["strategy"] for row in found[-2:]] == ["horse", "elephant"]
    assert found[-1]["verdict"] == found[-2]["verdict"] == "worse"
    assert max(int(row["last_rung"]) for row in found) > 3
    plan = plan_study(read_spec(out.parent / "spec.toml"))
    assert sum(int(row["n_episodes"]) for row in found) == sum(
        unit.stop - unit.start for unit in units_there(plan, out))


def test_who_fails_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                           monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:faulty_episodes")
    race(write_spec(tmp_path, SPEC), tmp_path / "out")
    assert "strategy horse failed: no horse knows how" in capsys.readouterr().err
    shares = {row["strategy"]: float(row["failure_rate"]) for row in rows(tmp_path / "out")}
    assert shares.pop("horse") == 1.0
    assert max(shares.values()) < 1.0


def test_a_mean_is_that_of_the_rows(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert race(write_spec(tmp_path, SPEC), out, "--metric", "robot_time_s", within="0.5") == 0
    best = rows(out)[0]
    plan = plan_study(read_spec(tmp_path / "spec.toml"))
    mine = [Store(out).read(unit) for unit in units_there(plan, out)
            if unit.cell.strategy.name == best["strategy"]]
    times = np.concatenate([unit["robot_time_s"] for unit in mine if unit is not None])
    assert len(times) == int(best["n_episodes"])
    assert float(best["robot_time_s"]) == pytest.approx(times.mean(), abs=1e-3)


def units_there(plan: Plan, out: Path) -> list[Unit]:
    """The units of a race's directory, found by their ids."""
    there = Store(out).unit_ids()
    units = RaceUnits(plan, Store(out), "chamfer_mm", "these")
    stops = [0, 8]
    while stops[-1] < 2000:
        stops.append(int(np.ceil(1.35 * stops[-1])))
    found = units.units([(e, a, b) for e in range(len(units.entries))
                         for a, b in pairwise(stops)])
    return [unit for unit in found if unit.id in there]


def flip_a_row(file: Path) -> None:
    """Flips a bit of a unit file by which its rows change: of headers some bits say nothing."""
    whole = file.read_bytes()
    read_unit(file, file.stem)  # whole
    for place in range(len(whole) // 3, len(whole)):
        flipped = bytearray(whole)
        flipped[place] ^= 4
        file.write_bytes(flipped)
        try:
            read_unit(file, file.stem)
        except DamagedUnit:
            return
    raise AssertionError(f"{file}: no bit that its reader sees")


def test_workers_and_interruptions_change_no_byte(tmp_path: Path,
                                                  whole: tuple[Path, str]) -> None:
    spec, one = write_spec(tmp_path, SPEC), whole[0]
    assert race(spec, tmp_path / "three", "--workers", "3") == 0
    files = sorted((one / "units").iterdir())
    shutil.copytree(one, tmp_path / "part")
    for file in files[::3]:
        (tmp_path / "part" / "units" / file.name).unlink()
    flip_a_row(tmp_path / "part" / "units" / files[1].name)
    assert race(spec, tmp_path / "part") == 0
    for other in ("three", "part"):
        assert sorted(f.name for f in (tmp_path / other / "units").iterdir()) == [
            f.name for f in files]
        for file in (*(f"units/{f.name}" for f in files), *FILES):
            assert (tmp_path / other / file).read_bytes() == (one / file).read_bytes()


@pytest.mark.slow
def test_a_killed_race_goes_on(tmp_path: Path, whole: tuple[Path, str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    run = ("import sys; from sweeps.run import worker; from sweeps.cli import main as cli; "
           "worker.EPISODES = 'fake_episodes:slow_episodes'; cli.main(sys.argv[1:])")
    process = subprocess.Popen(
        [sys.executable, "-c", run, "race", str(spec), "-o", str(tmp_path / "killed"),
         "--within", "0.3", "--workers", "2"], cwd=ROOT, stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, env={**os.environ, "FAKE_SECONDS": "0.2",
                                        "PYTHONPATH": f"{ROOT}:{ROOT / 'tests/helpers'}"})
    units = tmp_path / "killed" / "units"
    for _ in range(600):
        if units.exists() and len(list(units.glob("*.parquet"))) > 10:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert race(spec, tmp_path / "killed") == 0
    for file in FILES[:2]:
        assert (tmp_path / "killed" / file).read_bytes() == (whole[0] / file).read_bytes()


def test_a_budget_ends_a_race_and_more_of_it_goes_on(tmp_path: Path, whole: tuple[Path, str],
                                                     capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    assert race(spec, tmp_path / "out", "--budget-episodes", "200") == 0
    printed = capsys.readouterr()
    assert "the budget of episodes ended before the best was known within 0.3 mm" in printed.err
    assert "within 0.3 mm" not in printed.out
    assert sum(int(row["n_episodes"]) for row in rows(tmp_path / "out")) <= 200
    tied, worse, left = ([row["verdict"] for row in rows(tmp_path / "out")].count(name)
                         for name in ("tied", "worse", "open"))
    assert left > 0
    assert f"{tied} not known to be worse, {worse} worse, {left} open" in printed.out
    before = {f.name for f in (tmp_path / "out" / "units").iterdir()}
    assert race(spec, tmp_path / "out") == 0
    assert before < {f.name for f in (tmp_path / "out" / "units").iterdir()}
    assert (tmp_path / "out/race.csv").read_bytes() == (whole[0] / "race.csv").read_bytes()
    assert race(spec, tmp_path / "late", "--budget-minutes", "0.00001", within="0.001") == 0
    assert "the time ended before" in capsys.readouterr().err


def test_objects_like_these_are_the_replicates(tmp_path: Path,
                                               capsys: pytest.CaptureFixture[str]) -> None:
    objects = ", ".join(f'{{ name = "s{n}", object = "block" }}' for n in range(12))
    spec = write_spec(tmp_path, SPEC.replace('"block", "wedge", "funnel"', objects))
    assert race(spec, tmp_path / "out", "--over", "like-these", within="0.5") == 0
    printed = capsys.readouterr().out
    assert "of the best of 6 on objects like these" in printed
    taken = {int(row["n_episodes"]) for row in rows(tmp_path / "out")}
    assert all(count % 4 == 0 and count <= 48 for count in taken)
    assert race(spec, tmp_path / "end", "--over", "like-these", within="0.0001") == 0
    assert "the objects ended before" in capsys.readouterr().err
    assert race(spec, tmp_path / "end", "--over", "like-these", "--budget-episodes", "9999",
                within="0.0001") == 0
    assert "the objects ended before" in capsys.readouterr().err  # with budget left


def test_swept_nuisances_are_averaged_over(tmp_path: Path) -> None:
    text = SPEC + '\n[sweep.sobol]\nn = 4\n"errors.mount_mm" = { low = 0, high = 1 }\n'
    plan = plan_study(read_spec(write_spec(tmp_path, text)))
    units = RaceUnits(plan, Store(tmp_path / "out"), "chamfer_mm", "these")
    assert len(units.entries) == 6
    assert units.episodes_each == 12
    assert len(units.units([(0, 0, 8)])) == 12


def test_a_race_is_watched_by_its_own_score(whole: tuple[Path, str],
                                            capsys: pytest.CaptureFixture[str]) -> None:
    words = ["watch", str(whole[0]), "--terminal"]
    assert cli.run([*words, "--metric", "iou"]) == 2
    assert "--metric: is of a sweep, and " in capsys.readouterr().err
    assert cli.run(words) == 0
    assert "within 0.3 mm of the best of 6" in capsys.readouterr().out


def test_capped_races_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    assert race(spec, tmp_path / "out", "--cap", "20", within="5") == 0
    assert "95 %, scores cut at 20 mm" in capsys.readouterr().out
    assert race(spec, tmp_path / "iou", "--json", "--metric", "iou", within="0.05") == 0
    told, first = json.loads(capsys.readouterr().out), rows(tmp_path / "iou")[0]
    assert told["claim"].startswith("within 0.05 of the best of ")
    assert 0 < float(first["iou"]) < 1
    assert told["iou"] == float(first["iou"])


def test_right_and_wrong_answers_have_safe_bounds(tmp_path: Path,
                                                  capsys: pytest.CaptureFixture[str]) -> None:
    """Of few answers a standard error may be zero; a race does not take that for certainty."""
    spec = write_spec(tmp_path, SPEC)
    assert race(spec, tmp_path / "out", "--metric", "recognized", "--budget-episodes", "400",
                within="0.1") == 0
    printed = capsys.readouterr()
    assert "cut at" not in printed.out
    assert "ended before" in printed.err


@pytest.mark.parametrize(("words", "code", "message"), [
    (["--within", "0"], 2, "--within: is 0; should be"),
    (["--within", "1", "--confidence", "100"], 2, "--confidence: is 100; should be"),
    (["--within", "1", "--confidence", "0.95"], 2, "--confidence: is 0.95; should be in percent"),
    (["--within", "1", "--metric", "iou"], 2, "--within: is 1; should be below 1, the largest"),
    (["--within", "3", "--cap", "2"], 2, "--within: is 3; should be below 2, the largest"),
    (["--within", "1", "--start", "1"], 2, "--start: is 1; should be"),
    (["--within", "1", "--budget-episodes", "10"], 2, "the first rung of 6 entries takes 36"),
    (["--within", "1", "--metric", "nothing"], 2, "no metric 'nothing'"),
    (["--within", "1", "--address", "auto"], 2, "--address: is for --engine ray"),
])
def test_refusals(tmp_path: Path, words: list[str], code: int, message: str,
                  capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    assert cli.run(["race", str(spec), "-o", str(tmp_path / "out"), *words]) == code
    assert message in capsys.readouterr().err


def test_one_entry_is_no_race(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC.split('[[strategy]]\nname = "bee"')[0])
    assert race(spec, tmp_path / "out") == 2
    assert "has one entry; a race needs two or more" in capsys.readouterr().err
    one = SPEC.replace(', "wedge", "funnel"', "")
    assert race(write_spec(tmp_path, one), tmp_path / "out", "--over", "like-these") == 2
    assert "nothing follows from one object" in capsys.readouterr().err


def test_a_positive_bound_is_of_those_that_are_worse(tmp_path: Path) -> None:
    """Entries "not known to be worse" were worse by 0.38 mm at least."""
    for seed in ("7", "8", "9"):
        out = tmp_path / seed
        assert race(write_spec(tmp_path, SPEC), out, "--set", f"seed={seed}") == 0
        found = rows(out)
        assert not [row for row in found
                    if row["verdict"] == "tied" and float(row["worse_by_at_least"]) > 0.0]
        note = json.loads((out / "logs/race.json").read_text())
        assert [entry["at_least"] for entry in note["entries"]] == pytest.approx(
            [float(row["worse_by_at_least"]) for row in found], abs=6e-4)


@pytest.mark.parametrize("words", [("--over", "like-these"), ("--budget-episodes", "37")])
def test_what_exceeds_all_that_can_be_is_no_claim(
        tmp_path: Path, words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    """No score is below 0; a race ended "within 280 mm of the best", or 10 km."""
    out = tmp_path / "out"
    assert race(write_spec(tmp_path, SPEC), out, "--json", *words) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["claim"] == "nothing can be claimed yet"
    assert json.loads(printed.out)["within"] is None
    assert "leads, nothing can be claimed yet" in printed.err
    mean = float(rows(out)[0]["chamfer_mm"])
    for row in rows(out):
        bound = row["worse_by_at_least"]
        assert bound == "NA" or float(bound) > -mean
    assert "NA" in {row["worse_by_at_least"] for row in rows(out)}
