import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import PYTHONPATH, ROOT
from studies import SMALL, write_spec

from sweeps.cli import commands
from sweeps.cli import main as cli
from sweeps.run import worker
from sweeps.run.plan import Plan, Unit
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_writer import hand_text

BIG = SMALL.replace("= 70\no", "= 640\no")
FAKE = "fake_episodes:run_episodes"


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sweeps of the command line run the stand-in."""
    monkeypatch.setattr(worker, "EPISODES", FAKE)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a sweep to its end, to be copied."""
    folder = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worker, "EPISODES", FAKE)
        assert cli.run(["sweep", str(write_spec(folder)), "-o", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture
def swept(finished: Path, tmp_path: Path, fake: None) -> tuple[Path, Path]:
    """A spec, and the directory of its finished sweep."""
    return write_spec(tmp_path), Path(shutil.copytree(finished, tmp_path / "out"))


def test_explore_refuses_other_units(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["explore", "block", "--strategy", "ring6", "--x-m", "450", "-o", "r"]) == 2
    assert "should be metres from -2 to 2; did you mean 0.45?" in capsys.readouterr().err
    assert cli.run(["explore", "block", "--strategy", "ring6", "--x-m", "0.05", "-o", "r"]) == 2
    assert "is where the arm itself stands; should be 100 mm or more" in capsys.readouterr().err
    assert cli.run(["explore", "block", "--yaw-deg", "7e5", "-o", "r"]) == 2
    assert "--yaw-deg: is 700000; should be a number from -360 to 360" in capsys.readouterr().err


def test_a_sweep_ends_with_its_leaderboard(
        tmp_path: Path, fake: None, capsys: pytest.CaptureFixture[str]) -> None:
    spec, out = write_spec(tmp_path), tmp_path / "out"
    assert cli.run(["sweep", str(spec), "-o", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines()[0].split()[:3] == ["rank", "strategy", "chamfer_mm"]
    assert (out / "leaderboard.csv").read_text().startswith("rank,strategy,chamfer_mm,")
    assert (out / "spec.toml").read_bytes() == spec.read_bytes()
    assert {"resolved.json", "environment.json", "units", "logs"} <= set(os.listdir(out))

    assert cli.run(["sweep", str(spec), "-o", str(out), "--json"]) == 0
    again = capsys.readouterr()
    assert "finished already, 8 units" in again.err
    assert [row["strategy"] for row in json.loads(again.out)] == ["mine", "ring6"]

    assert cli.run(["status", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["done"], found["failed"], found["left"], found["held_by"]) == (8, 0, 0, [])

    with commands.Store(out).lock((1, 1)):  # a run that has not noted anything sound
        (out / "logs" / "progress-1-of-1.json").write_text("{")
        assert cli.run(["status", str(out)]) == 0
        assert "process" in capsys.readouterr().out

    board = tmp_path / "board.csv"
    assert cli.run(["leaderboard", str(out), "-o", str(board)]) == 0
    assert board.read_bytes() == (out / "leaderboard.csv").read_bytes()

    unit = min((out / "units").iterdir())
    content = bytearray(unit.read_bytes())
    content[len(content) // 3] ^= 0xFF  # of values: some bytes of headers tell nothing
    unit.write_bytes(content)
    assert cli.run(["sweep", str(spec), "-o", str(out)]) == 0
    assert "running 1 damaged unit again" in capsys.readouterr().err
    assert board.read_bytes() == (out / "leaderboard.csv").read_bytes()

    assert cli.run(["sweep", str(spec), "-o", str(out), "--set", "seed=8"]) == 3
    assert "seed: 7 -> 8" in capsys.readouterr().err


def test_a_printed_leaderboard_has_the_interval_that_is_known(
        swept: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    """Of one object that is the interval of these objects."""
    _, out = swept
    for more, kind in (([], "ci"), (["--over", "these"], "these"), (["--over", "like-these"], "ci"),
                       (["--by", "strategy,object"], "these")):
        assert cli.run(["leaderboard", str(out), *more]) == 0
        header, first = [line.split() for line in capsys.readouterr().out.splitlines()[:2]]
        assert header[2:5] == ["chamfer_mm", f"chamfer_mm_{kind}_low", f"chamfer_mm_{kind}_high"]
        assert "NA" not in first[-9:-7]
    assert cli.run(["leaderboard", str(out), "--json"]) == 0
    columns = {*json.loads(capsys.readouterr().out)[0]}
    assert {"chamfer_mm_ci_low", "chamfer_mm_these_low"} <= columns


def test_what_a_study_keeps_is_run_again_from_it_alone(
        tmp_path: Path, fake: None, capsys: pytest.CaptureFixture[str]) -> None:
    """Its spec used to lack what --set said, and to find its files only where they had been."""
    spec, out, given = write_spec(tmp_path), tmp_path / "out", tmp_path / "given"
    (tmp_path / "mine.toml").write_text(hand_text(hand_named("leap")))
    spec.write_text('hand = "mine.toml"\narm = "none"\n' + spec.read_text())
    words = ["sweep", str(spec), "-o", str(out), "--set", "episodes_per_cell=20"]
    assert cli.run([*words, "--set", "sensors.torque_threshold_Nm=0.1,0.2"]) == 0
    assert cli.run(["sweep", str(out / "spec.toml"), "-o", str(out)]) == 0
    assert "finished already" in capsys.readouterr().err
    shutil.copytree(out, given)
    (tmp_path / "mine.toml").unlink()
    assert cli.run(["check", str(given / "spec.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["hash"] == json.loads(
        (out / "resolved.json").read_text())["hash"]
    assert cli.run(["sweep", str(given / "spec.toml"), "-o", str(tmp_path / "again")]) == 0
    assert (tmp_path / "again/leaderboard.csv").read_bytes() == (
        out / "leaderboard.csv").read_bytes()
    more = ["--set", "episodes_per_cell=30"]
    assert cli.run(["sweep", str(given / "spec.toml"), "-o", str(given), *more]) == 0
    lines = (given / "spec.toml").read_text().splitlines()
    assert lines[0] == ('set = ["sensors.torque_threshold_Nm=0.1,0.2", "episodes_per_cell=30"]  '
                        "# what --set said")
    assert lines[1:] == spec.read_text().splitlines()


def test_a_value_more_runs_only_its_own_units(
        swept: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Another grid used to mean another directory, in which all was computed again."""
    old = tmp_path / "out"
    spec = write_spec(tmp_path, SMALL + '[sweep.grid]\n"sensors.tendon_threshold_N" = [3.0, 6.0]\n')
    words = ["sweep", str(spec), "-o"]
    assert cli.run([*words, str(old)]) == 3
    said = capsys.readouterr().err
    assert f"`warpgrasp sweep SPEC.toml -o NEW --reuse {old}` takes over the units" in said
    assert cli.run([*words, str(tmp_path / "fresh")]) == 0
    damaged = min((old / "units").iterdir())
    damaged.write_bytes(damaged.read_bytes()[:-9])
    before = {file.name: file.read_bytes() for file in (old / "units").iterdir()}
    capsys.readouterr()

    assert cli.run([*words, str(tmp_path / "new"), "--reuse", str(tmp_path / "none")]) == 2
    assert "none: holds no study" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    assert cli.run([*words, str(tmp_path / "new"), "--reuse", str(old)]) == 0
    assert f"7 of 16 units are taken from {old}" in capsys.readouterr().err
    assert before == {file.name: file.read_bytes() for file in (old / "units").iterdir()}
    for file in (tmp_path / "fresh/units").iterdir():
        assert (tmp_path / "new/units" / file.name).read_bytes() == file.read_bytes()

    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:no_such_function")
    more = ["--reuse", str(old), "--reuse", str(tmp_path / "fresh")]
    assert cli.run([*words, str(tmp_path / "all"), *more]) == 0
    assert "16 of 16 units are taken from" in capsys.readouterr().err
    assert (tmp_path / "all/leaderboard.csv").read_bytes() == (
        tmp_path / "fresh/leaderboard.csv").read_bytes()


def test_a_unit_that_comes_while_units_are_counted_is_none_of_another_study(
        swept: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """`status` counted such files a second time, as those of another study."""
    store = commands.Store(swept[1])
    plan = commands.plan_of(store)
    first = store.path(next(iter(plan.units())))
    content = first.read_bytes()
    first.unlink()

    def units_in_turn(self: Plan) -> Iterator[Unit]:
        for unit in of_plan(self):
            yield unit
            first.write_bytes(content)

    of_plan = Plan.units
    monkeypatch.setattr(Plan, "units", units_in_turn)
    assert commands._sweep_counts(plan, store) == (
        {"units": 8, "done": 7, "failed": 0}, 1, 0)


def test_a_folder_of_other_files_is_refused_and_left_as_it_is(
        tmp_path: Path, fake: None, capsys: pytest.CaptureFixture[str]) -> None:
    """`-o .` beside the user's own files used to write over two and to delete a third."""
    spec = tmp_path / "study.toml"
    spec.write_text(SMALL)
    mine = tmp_path / "mine"
    mine.mkdir()
    contents = {"spec.toml": "mine", "leaderboard.csv": "mine too", ".draft.tmp": "and this"}
    for name, text in contents.items():
        (mine / name).write_text(text)
    assert cli.run(["sweep", str(spec), "-o", str(mine)]) == 3
    assert "and no study; choose a new or an empty directory" in capsys.readouterr().err
    assert {file.name: file.read_text() for file in mine.iterdir()} == contents
    assert cli.run(["sweep", str(spec), "-o", ""]) == 2


def test_only_temporaries_of_the_studys_own_names_are_removed(swept: tuple[Path, Path]) -> None:
    spec, out = swept
    for name in (".draft.tmp", ".spec.toml.draft.tmp", ".spec.toml.0123456789ab.tmp"):
        (out / name).write_text("left")
    assert cli.run(["sweep", str(spec), "-o", str(out)]) == 0
    assert {file.name for file in out.glob(".*.tmp")} == {".draft.tmp", ".spec.toml.draft.tmp"}


def test_a_spec_in_another_order_gives_the_same_leaderboard(tmp_path: Path, fake: None) -> None:
    out, near = tmp_path / "out", SMALL.replace("mine", "mine6")  # as good as ring6
    assert cli.run(["sweep", str(write_spec(tmp_path, near)), "-o", str(out)]) == 0
    first = (out / "leaderboard.csv").read_bytes()
    turned = near.replace('"block", "wedge"', '"wedge", "block"')
    assert cli.run(["sweep", str(write_spec(tmp_path, turned)), "-o", str(out)]) == 0
    assert (out / "leaderboard.csv").read_bytes() == first


@pytest.mark.parametrize(("file", "content", "code", "says"), [
    ("environment.json", "[]", 0, "made in another environment"),
    ("environment.json", "null", 0, "made in another environment"),
    ("resolved.json", '{"hash": "x", "study": []}', 2, "resolved.json: is damaged; remove it"),
    ("resolved.json", '{"hash": "x", "study": {}}', 2, "resolved.json: is damaged; remove it"),
    ("resolved.json", "[]", 2, "resolved.json: is damaged; remove it"),
    ("resolved.json", '"earlier": 5', 2, "resolved.json: is damaged; remove it"),
])
def test_what_is_no_record_of_a_study_is_said(
        swept: tuple[Path, Path], capsys: pytest.CaptureFixture[str], file: str, content: str,
        code: int, says: str) -> None:
    spec, out = swept
    if content.startswith('"'):  # a key more
        content = (out / file).read_text().rstrip()[:-1] + f", {content}}}"
    (out / file).write_text(content)
    assert cli.run(["sweep", str(spec), "-o", str(out)]) == code
    assert says in capsys.readouterr().err


def test_a_refused_sweep_changes_nothing(
        swept: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    spec, out = swept
    before = {name: (out / name).read_bytes() for name in ("resolved.json", "spec.toml")}
    with commands.Store(out).lock((1, 1)):
        assert cli.run(["sweep", str(spec), "-o", str(out), "--set", "episodes_per_cell=99"]) == 2
    said = capsys.readouterr().err
    assert "is being worked on by process" in said
    assert "has grown" not in said
    assert before == {name: (out / name).read_bytes() for name in before}


@pytest.mark.parametrize(("arguments", "says"), [
    (["swep"], "swe"),
    (["sweep", "SPEC"], "warpgrasp: --out: is missing; see warpgrasp sweep --help"),
    (["sweep", "-o", "OUT"], "warpgrasp: SPEC: is missing; see warpgrasp sweep --help"),
    (["sweep", "SPEC", "-o", "OUT", "--workers", "0"], "--workers: is 0"),
    (["sweep", "SPEC", "-o", "OUT", "--workers", "two"], 'convert "two" into int; see'),
    (["sweep", "SPEC", "-o", "OUT", "--shard", "3/2"], "--shard: is '3/2'; should be I/N"),
    (["sweep", "SPEC", "-o", "OUT", "--unit-timeout-s", "0"], "--unit-timeout-s: is 0; should be"),
    (["sweep", "SPEC", "-o", "OUT", "--unit-timeout-s", "nan"], "--unit-timeout-s: is nan"),
    (["sweep", "SPEC", "-o", "OUT", "--device", "cuda:99"], "--device: there is no cuda:99 here"),
    (["sweep", "SPEC", "-o", "OUT", "--device", "gpu"], "--device: is 'gpu'; should be cpu or"),
    (["race", "SPEC", "-o", "OUT", "--within", "1", "--device", "cuda:99"], "there is no cuda:99"),
    (["explore", "block", "-o", "OUT", "--device", "cuda:99"], "--device: there is no cuda:99"),
    (["learn", "catalogue", "-o", "OUT", "--device", "cuda:99"], "--device: there is no cuda:99"),
    (["warmup", "--device", "cuda:99"], "--device: there is no cuda:99 here; there are: cpu"),
    (["bench", "-o", "OUT", "--device", "cuda:99"], "--device: there is no cuda:99 here"),
    (["sweep", "SPEC", "-o", "SPEC"], "cannot be written"),
    (["sweep", "SPEC", "-o", "OUT", "--set", "seed"], "--set: seed: should be KEY=VALUE"),
    (["check", "OUT"], "cannot be read"),
    (["check", "SPEC", "--set", "fit.los=none"], "did you mean fit.loss?"),
    (["status", "OUT"], "holds no study"),
    (["leaderboard", "OUT"], "holds no study"),
    (["leaderboard", "SPEC"], "cannot be read"),
    (["init", "SPEC"], "exists already"),
    (["init", "OUT/none/SPEC"], "cannot be written"),
])
def test_bad_usage_ends_with_2_and_one_message(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str],
        says: str) -> None:
    spec = str(write_spec(tmp_path))
    given = [a.replace("SPEC", spec) if a == "SPEC" else a.replace("OUT", str(tmp_path / "no"))
             for a in arguments]
    assert cli.run(given) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert says in printed.err
    assert "Traceback" not in printed.err


def test_lists_and_check_and_init(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, expected in (("objects", "wine_bottle"), ("strategies", "ring6")):
        assert cli.run([name]) == 0
        assert expected in capsys.readouterr().out
        assert cli.run([name, "--json"]) == 0
        assert any(expected in row.values() for row in json.loads(capsys.readouterr().out))
    spec = tmp_path / "new.toml"
    assert cli.run(["init", str(spec)]) == 0
    assert cli.run(["check", str(spec), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["cells"], found["episodes"], found["units"]) == (12, 192, 12)
    assert "warning" not in found
    assert cli.run(["check", str(spec), "--set", "hand.co_contraction_N=200"]) == 0
    assert "warning" in capsys.readouterr().out
    spec.write_text(SMALL.replace('"wedge"', '{ object = "block", name = "again" }'))
    assert cli.run(["check", str(spec)]) == 0
    assert "block and again are the same body" in capsys.readouterr().out


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture[str]) -> None:
    project = ROOT / "pyproject.toml"
    assert cli.run(["--version"]) == 0
    assert capsys.readouterr().out.strip() == tomllib.loads(
        project.read_text())["project"]["version"]


def start(tmp_path: Path, **environment: str) -> subprocess.Popen[str]:
    spec = write_spec(tmp_path, BIG)
    # Tests that a shell started in the background ignore SIGINT; so would the sweep.
    code = ("import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
            "from sweeps.cli import main as cli; from sweeps.run import worker; "
            "worker.EPISODES = 'fake_episodes:slow_episodes'; cli.main(sys.argv[1:])")
    return subprocess.Popen(
        [sys.executable, "-c", code, "sweep", str(spec), "-o", str(tmp_path / "out"),
         "--workers", "2"], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": PYTHONPATH, "FAKE_SECONDS": "0.2",
             **environment})


@pytest.mark.parametrize("number", [
    signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interrupt_keeps_what_is_finished(tmp_path: Path, number: signal.Signals) -> None:
    process = start(tmp_path)
    units = tmp_path / "out" / "units"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not list(units.glob("*.parquet")):
        time.sleep(0.05)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert "interrupted; what was finished is kept" in err
    assert "Traceback" not in err
    assert 0 < len(list(units.glob("*.parquet"))) < 40
    assert not list(units.glob(".*.tmp"))


@pytest.mark.parametrize(("arguments", "needs"), [
    (["--help"], []), (["objects"], []), (["strategies"], ["numpy"]),
    (["check", "SPEC"], ["numpy", "pydantic"])])
def test_light_commands_import_nothing_heavy(
        tmp_path: Path, arguments: list[str], needs: list[str]) -> None:
    code = ("import sys; from sweeps.cli.main import run; run(sys.argv[1:]); "
            "print(sorted({'numpy', 'jax', 'warp', 'pyarrow', 'scipy', 'pydantic', 'trimesh'} "
            "& set(sys.modules)), file=sys.stderr)")
    spec = str(write_spec(tmp_path))
    done = subprocess.run(
        [sys.executable, "-c", code, *(spec if a == "SPEC" else a for a in arguments)],
        capture_output=True, text=True, check=True)
    assert done.stderr.strip() == str(needs)
    assert done.stdout


def test_a_machine_without_gpu_hears_nothing_of_it(tmp_path: Path) -> None:
    """What Warp's native code says on stderr at its start is no message of ours."""
    spec = write_spec(tmp_path, SMALL.replace(
        '"block"', '{ name = "t", compound = [{ shape = "sphere", radius_mm = 20 }] }'))
    done = subprocess.run([sys.executable, "-m", "sweeps.cli.main", "check", str(spec)],
                          capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_workers_are_told_to_use_one_thread() -> None:
    assert {"NPROC", "OMP_NUM_THREADS", "WARPGRASP_THREADS"} <= set(worker.ENVIRONMENT)


def test_a_terminal_gets_a_bar_and_the_results_stay_clean(tmp_path: Path) -> None:
    """On a terminal stderr shows a bar; stdout holds the leaderboard alone."""
    spec = write_spec(tmp_path)
    parent, child = os.openpty()
    code = ("import sys; from sweeps.cli import main as cli; from sweeps.run import worker; "
            "worker.EPISODES = 'fake_episodes:run_episodes'; cli.main(sys.argv[1:])")
    process = subprocess.Popen(
        [sys.executable, "-c", code, "sweep", str(spec), "-o", str(tmp_path / "out")], text=True,
        stdout=subprocess.PIPE, stderr=child, stdin=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": PYTHONPATH, "TERM": "xterm"})
    os.close(child)
    shown = b""
    while True:
        try:
            part = os.read(parent, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        shown += part
    assert process.communicate()[0].splitlines()[0].startswith("rank  strategy")
    assert process.returncode == 0
    assert b"8/8" in shown
    os.close(parent)
