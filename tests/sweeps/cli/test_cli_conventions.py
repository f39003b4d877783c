"""Doctor, completion, --quiet, rows as Arrow, names to import: what one expects of any tool."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from curved_episodes import wide_study, wide_text
from studies import SMALL, write_spec

import fit
import strategies
import warpgrasp
from sweeps import __main__ as entry_point
from sweeps.analysis import tables
from sweeps.analysis.arrow import read_rows
from sweeps.cli import look
from sweeps.cli import main as cli
from sweeps.cli.tools import doctor
from sweeps.figures import kinds as figures
from sweeps.run import worker


def test_doctor_finds_what_is_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["doctor", "--no-test", "--json"]) == 0
    rows = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["python"]["verdict"] == rows["devices"]["verdict"] == "ok"
    assert "cpu" in rows["devices"]["value"]
    assert rows["jaxopt"]["value"] == "0.8.5"
    assert "yourdfpy (optional)" in rows


def test_doctor_looks_where_kernels_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    assert cli.run(["doctor", "--no-test", "--json"]) == 0
    rows = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["compiled kernels"]["value"] == f"{tmp_path} (0 MB)"


def test_doctor_names_the_variable_that_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                               capsys: pytest.CaptureFixture[str]) -> None:
    """XDG_CACHE_HOME is not looked at where the folder's own variable is set."""
    (tmp_path / "file").touch()
    for variable in ("WARPGRASP_CACHE", "WARP_CACHE_PATH"):
        monkeypatch.setenv(variable, str(tmp_path / "file"))
    cli.run(["doctor", "--no-test", "--json"])
    rows = {row["what"]: row["verdict"] for row in json.loads(capsys.readouterr().out)}
    assert rows["compiled fits, baked meshes"].endswith("; set WARPGRASP_CACHE")
    assert rows["compiled kernels"].endswith("; set WARP_CACHE_PATH")


def test_doctor_says_what_is_wrong(monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
                                   capsys: pytest.CaptureFixture[str]) -> None:
    def broken() -> list[str]:
        raise RuntimeError("no kernels today")

    monkeypatch.setattr(doctor, "devices", broken)
    assert cli.run(["doctor", "--no-test"]) == 1
    assert "no kernels today" in capsys.readouterr().out


@pytest.mark.slow
def test_doctor_tests_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["doctor"]) == 0
    assert "a sphere's radius is off by" in capsys.readouterr().out


def test_help_and_completion_know_every_kind() -> None:
    assert set(get_args(look.TableKind)) == set(tables.KINDS)
    assert set(get_args(look.FigureKind)) == set(figures.KINDS)


@pytest.mark.parametrize(("words", "says"), [
    ("table DIR objects --against best", "--against: says nothing of objects; is for pairs, same-"),
    ("table DIR curves --metric iou", "--metric: says nothing of curves"),
    ("table DIR confusion --over these", "--over: says nothing of confusion"),
    ("table DIR objects --over these", "--over: says nothing of objects"),
    ("table DIR pairs --over these", "--over: says nothing of pairs"),
    ("figure DIR forest -o f.svg --strategy sx", "--strategy: says nothing of forest; is for con"),
    ("figure DIR forest -o f.svg --episode 0", "--episode: says nothing of forest"),
    ("figure DIR curves-time -o f.svg --metric iou", "--metric: says nothing of curves-time"),
    ("check SPEC --metric iou", "--metric: is of what a --pilot tells apart"),
    ("compare SPEC SPEC --metric iou", "--metric: is of a table, which needs two studies"),
    ("compare SPEC SPEC --over these", "--over: is of a table"),
    ("show DIR -o f.html --port 9000", "--port: is for --live"),
    ("watch DIR --terminal --port 8080", "--port: is of the page"),
    ("watch DIR --terminal --open", "--open: is of the page"),
    ("sweep SPEC -o x --engine ray --address auto --workers 2", "--workers: is of this machine"),
    ("race SPEC -o x --within 1 --engine ray --address auto --workers 2", "--workers: is of this"),
    ("validate --only puma --poses 5", "--poses: is for closing and hands"),
    ("report DIR -o r.html --no-views --workers 2", "--workers: is for views"),
    ("export h.xml --units mm", "--units: says how large a mesh is; should stand beside --object"),
    ("export h.xml --object block --units mm", "--units: is of a mesh file; block is none"),
    ("explore block --units mm -o x", "--units: is of a mesh file; block is none"),
    ("learn block --units mm -o m.json", "--units: is of mesh files, and none is named"),
    ("fit superquadric POINTS -o f.csv --normal-deg 3", "has no columns nx, ny, nz")])
def test_an_option_that_says_nothing_is_refused(words: str, says: str, tmp_path: Path,
                                                monkeypatch: pytest.MonkeyPatch,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"DIR": "study", "SPEC": str(write_spec(tmp_path)), "POINTS": "points.csv"}
    (tmp_path / "points.csv").write_text("x_m,y_m,z_m\n" + "".join(
        f"{0.03 * (n % 3)},{0.02 * (n % 5)},{0.01 * n}\n" for n in range(12)))
    assert cli.run([places.get(word, word) for word in words.split()]) == 2
    assert says in capsys.readouterr().err
    assert not [*tmp_path.glob("*.svg"), *tmp_path.glob("*.html"), *tmp_path.glob("*.xml")]


@pytest.mark.parametrize("command", ["show study --live", "watch study"])
@pytest.mark.parametrize("port", [-1, 65536])
def test_a_port_that_there_cannot_be_is_refused(command: str, port: int,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    """The live replay waited for its server forever."""
    assert cli.run([*command.split(), "--port", str(port)]) == 2
    assert f"--port: is {port}; should be a whole number from 0 to 65535" in capsys.readouterr().err


@pytest.mark.parametrize(("command", "arguments"), [
    ("explore", " OBJECT\n"), ("table", " DIR... KIND\n"), ("figure", " DIR... KIND\n"),
    ("leaderboard", " DIR...\n"), ("rows", " DIR...\n"), ("report", " DIR...\n"),
    ("show", " DIR...\n"), ("bench", " [OPTIONS]\n")])
def test_help_names_what_a_user_gives(command: str, arguments: str,
                                      capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([command, "--help"]) == 0
    said = capsys.readouterr().out
    assert arguments in said
    assert "--empty-only" not in said


@pytest.mark.parametrize(("words", "expected"), [
    (["warpgrasp", "lead"], "leaderboard"), (["warpgrasp", "table", "x", "--ag"], "--against"),
    (["warpgrasp", "table", "x", "par"], "pareto")])
def test_the_shell_completes(words: list[str], expected: str, tmp_path: Path,
                             capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["completion", "bash"]) == 0
    line = (f"{capsys.readouterr().out}\nCOMP_WORDS=({' '.join(words)}); "
            f"COMP_CWORD={len(words) - 1}; _warpgrasp; " 'echo "${COMPREPLY[@]}"')
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True,
                          cwd=tmp_path)
    assert done.stdout.split() == [expected]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["completion", shell]) == 0
    assert "leaderboard" in capsys.readouterr().out


def test_quiet_leaves_only_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                   capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    monkeypatch.setenv("WARPGRASP_QUIET", "")
    spec = write_spec(tmp_path, SMALL)
    assert cli.run(["sweep", str(spec), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.startswith("rank")
    assert cli.run(["--quiet", "status", str(tmp_path / "none")]) == 2
    assert "holds no study" in capsys.readouterr().err


def test_no_colour_where_none_is_wanted(tmp_path: Path) -> None:
    parent, child = os.openpty()
    subprocess.run([sys.executable, "-m", "sweeps.cli.main", "objects"], stdout=child, check=True,
                   env={**os.environ, "NO_COLOR": "1", "TERM": "xterm"})
    os.close(child)
    assert b"\033[" not in os.read(parent, 65536)
    os.close(parent)


def test_rows_as_an_arrow_table(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 5, """
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 6.0]
"""))
    rows = read_rows(tmp_path)
    assert rows.num_rows == 2 * 2 * 2 * 5
    assert set(rows["sensors.tendon_threshold_N"].to_pylist()) == {"3.0", "6.0"}
    unit = next(plan.units())
    mine = rows.filter([bool(s == unit.cell.strategy.name and o == unit.cell.object_name and k == 0)
                        for s, o, k in zip(*(rows[n].to_pylist() for n in
                                             ("strategy", "object", "setting")), strict=True)])
    found = store.read(unit)
    assert found is not None
    assert mine["touches"].to_pylist() == found["touches"].tolist()
    assert len(mine["curve_touches"][0].as_py()) == 5


@pytest.mark.parametrize("package", [fit, strategies, warpgrasp])
def test_every_name_that_is_offered_is_there(package: object) -> None:
    names = package.__all__  # type: ignore[attr-defined]
    assert all(getattr(package, name) is not None for name in names)
    assert set(dir(package)) >= set(names)
    with pytest.raises(AttributeError):
        package.no_such_name  # type: ignore[attr-defined]  # noqa: B018


def test_importing_is_quick() -> None:
    code = ("import sys, warpgrasp, fit, strategies; "
            "print({'jax', 'warp', 'numpy'} & set(sys.modules))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(("words", "says"), [
    (["table", "pairs", "x"], "KIND: is 'x'; pairs should stand last, after the directories"),
    (["table", "x", "pears"], "KIND: is 'pears'; did you mean pairs?"),
    (["swep", "x.toml"], "no command 'swep'; did you mean sweep? there are: "),
    (["--workers", "2"], "no command '--workers'; there are: "),
    (["sweep", "x.toml", "-o", "out", "--workers"], "--workers: is given without a value; see "),
    (["sweep", "x.toml", "-o"], "-o: is given without a value; see warpgrasp sweep --help"),
    (["sweep", "x.toml"], "--out: is missing; see warpgrasp sweep --help")])
def test_wrong_usage_says_what_would_be_right(words: list[str], says: str,
                                              capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(words) == 2
    said = capsys.readouterr().err
    assert says in said
    assert ", ;" not in said


def test_files_that_vanish_meanwhile_do_not_end_doctor(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    """Caches are written while it counts them."""
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    (tmp_path / "kernel.o").write_bytes(bytes(3_000_000))
    (tmp_path / "gone").symlink_to(tmp_path / "nothing")
    whole = os.stat

    def vanishing(path: object, *more: object, **options: object) -> os.stat_result:
        if str(path).endswith(".tmp"):
            raise FileNotFoundError(2, "No such file or directory", str(path))
        return whole(path, *more, **options)  # type: ignore[arg-type]

    (tmp_path / "half.tmp").touch()
    monkeypatch.setattr(os, "stat", vanishing)
    assert cli.run(["doctor", "--no-test", "--json"]) == 0
    rows = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["compiled kernels"]["value"] == f"{tmp_path} (3 MB)"


def test_a_wrong_number_of_threads_is_one_message(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """It was a traceback, of the first kernel."""
    monkeypatch.setenv("WARPGRASP_THREADS", "all")
    with pytest.raises(SystemExit) as ended:
        cli.main(["objects"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        "warpgrasp: WARPGRASP_THREADS: is 'all'; should be a whole number from 1\n")


def test_a_system_that_it_does_not_run_on_is_told_so(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(SystemExit) as ended:
        entry_point.main()
    assert ended.value.code == 2
    assert "Windows Subsystem for Linux" in capsys.readouterr().err
