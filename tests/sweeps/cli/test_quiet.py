"""`--quiet` of every command: nothing but results on stdout, and errors."""

import re
from collections.abc import Iterator
from html import escape
from pathlib import Path

import pytest
from curved_episodes import wide_study, wide_text
from places import ROOT
from studies import SMALL, write_spec

from sweeps.analysis.rerun_episode import WorkerDied
from sweeps.cli import main as cli
from sweeps.report import views
from sweeps.run import worker
from sweeps.run.progress import Progress

POINTS = "x_m,y_m,z_m\n" + "".join(
    f"{0.4 + 0.03 * (n % 3)},{0.02 * (n % 5)},{0.01 * (n % 7)}\n" for n in range(24))
GAP = "0.4,,0.01\n"
"""A touch with a missing coordinate, which is noted."""
SWEPT = """
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 6.0]
"""


@pytest.fixture(autouse=True)
def anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test begins as if the option had not been given, with stand-ins for episodes."""
    monkeypatch.setenv("WARPGRASP_QUIET", "")
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    wide_study(folder, wide_text(2, 3, 8, SWEPT))
    return folder


@pytest.mark.parametrize("words", [
    "init OUT.toml", "check SPEC", "sweep SPEC -o OUT", "sweep SPEC -o OUT --until 1e6",
    "sweep SPEC -o OUT --shard 1/2", "race SPEC -o OUT --within 1e6",
    "race SPEC -o OUT --within 1e-6 --budget-episodes 64", "status STUDY", "leaderboard STUDY",
    "leaderboard STUDY -o OUT.csv", "table STUDY pairs", "table STUDY curves",
    "rows STUDY -o OUT.csv", "compare STUDY STUDY", "figure STUDY forest -o OUT.svg",
    "figure STUDY curves-touches -o OUT.svg", "report STUDY -o OUT.html --no-views",
    "watch STUDY --terminal", "objects", "strategies", "hands", "arms", "doctor --no-test",
    "completion bash", "export OUT.xml", "fit plane POINTS -o OUT.csv",
    "fit superquadric POINTS -o OUT.csv --table-z 0 --figure OUT.png",
    "explore block --strategy ring6 -o OUT"])
def test_only_results_are_printed(words: str, study: Path, tmp_path: Path,
                                  capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "points.csv").write_text(POINTS + GAP)
    places = {"SPEC": write_spec(tmp_path), "STUDY": study, "POINTS": tmp_path / "points.csv"}
    given = [str(places.get(word, word.replace("OUT", str(tmp_path / "out"))))
             for word in words.split()]
    assert cli.run([*given, "--quiet"]) == 0
    assert capfd.readouterr().err == ""


def test_without_it_outcomes_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "points.csv").write_text(POINTS + GAP)
    words = ["fit", "plane", str(tmp_path / "points.csv"), "-o", str(tmp_path / "out.csv")]
    assert cli.run(words) == 0
    said = capsys.readouterr().err
    assert "touches with a missing coordinate are left out: 1 of set" in said
    assert "\n1 set: 1 converged\n" in said


def test_units_that_failed_are_told_all_the_same(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:deadly_episodes")
    spec = write_spec(tmp_path, SMALL.replace('"wedge"', '"lightbulb"'))
    assert cli.run(["sweep", str(spec), "-o", str(tmp_path / "out"), "--quiet"]) == 1
    said = capsys.readouterr().err
    assert "this bulb always breaks" in said
    assert "4 units failed; see" in said
    assert "ranking" not in said


def test_a_worker_that_died_is_told_all_the_same(
        study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    def dies(*_: object) -> Iterator[object]:
        raise WorkerDied
        yield

    monkeypatch.setattr(views, "rerun_all", dies)
    out = tmp_path / "out.html"
    assert cli.run(["report", str(study), "-o", str(out), "--quiet"]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert "episodes are missing from the 3-D views: a worker" in said
    assert escape(said) in out.read_text()


def test_progress_is_not_told_and_a_unit_that_failed_is(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(2, quiet=True)
    progress.say("halfway")
    progress.failed("a unit failed")
    assert capsys.readouterr().err == "a unit failed\n"


def test_bad_usage_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["status", str(tmp_path / "none"), "--quiet"]) == 2
    assert "holds no study" in capsys.readouterr().err


def test_all_that_is_said_passes_one_place() -> None:
    """Else nothing would keep it from being printed."""
    found = [path.relative_to(ROOT) for path in (ROOT / "sweeps").rglob("*.py")
             if re.search(r"print\([^#]*?file=sys\.stderr|sys\.stderr\.write", path.read_text())]
    assert found == [Path("sweeps/output.py")]


def test_the_next_command_in_a_process_is_not_quiet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where tests, notebooks or scripts call one after the other."""
    points = tmp_path / "points.csv"
    points.write_text(POINTS + GAP)
    said = []
    for options in (["--quiet"], []):
        cli.run(["fit", "plane", str(points), "-o", str(tmp_path / f"{len(said)}.csv"), *options])
        said.append(capsys.readouterr().err)
    assert said[0] == ""
    assert "missing" in said[1]
