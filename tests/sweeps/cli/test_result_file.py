"""No `-o` writes over what a study consists of."""

import os
from pathlib import Path

import pytest
from curved_episodes import wide_study, wide_text

from sweeps.cli import commands
from sweeps.cli import main as cli
from sweeps.result_file import study_of_file

POINTS = "x_m,y_m,z_m\n" + "".join(
    f"{0.4 + 0.03 * (n % 3)},{0.02 * (n % 5)},{0.01 * (n % 7)}\n" for n in range(24))


@pytest.fixture
def study(tmp_path: Path) -> Path:
    folder = tmp_path / "study"
    folder.mkdir()
    wide_study(folder, wide_text(2, 2, 8))
    (folder / "leaderboard.csv").write_text("the sweep's")
    (folder / "inputs/a").mkdir(parents=True, exist_ok=True)
    (tmp_path / "points.csv").write_text(POINTS)
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes()
            for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize("words", ["leaderboard STUDY", "table STUDY pairs", "compare STUDY STUDY"])
def test_a_table_s_file_does_not_end_as_another_format(
        words: str, study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = [word.replace("STUDY", str(study)) for word in words.split()]
    file = tmp_path / "board.json"
    assert cli.run([*given, "-o", str(file)]) == 2
    assert f"{file}: would be CSV; should end in .csv" in capsys.readouterr().err
    assert not file.exists()


@pytest.mark.parametrize(("words", "file"), [
    ("leaderboard STUDY -o FILE", "spec.toml"), ("leaderboard STUDY -o FILE", "resolved.json"),
    ("leaderboard STUDY -o FILE", "environment.json"), ("leaderboard STUDY -o FILE", "race.csv"),
    ("leaderboard STUDY -o FILE", ".lock-1-of-1"), ("leaderboard STUDY -o FILE", "units/new.csv"),
    ("leaderboard STUDY -o FILE", "units/leaderboard.csv"),
    ("leaderboard STUDY -o FILE", "logs/leaderboard.csv"),
    ("table STUDY pairs -o FILE", "leaderboard.csv"), ("table STUDY pairs -o FILE", "spec.toml"),
    ("compare STUDY STUDY -o FILE", "leaderboard.csv"), ("rows STUDY -o FILE", "units/x.parquet"),
    ("rows STUDY -o FILE", "leaderboard.csv"), ("figure STUDY forest -o FILE", "race.svg"),
    ("figure STUDY forest -o FILE", "logs/a.svg"),
    ("report STUDY --no-views -o FILE", "spec.toml"), ("show STUDY -o FILE", "spec.toml"),
    ("fit plane POINTS -o FILE", "leaderboard.csv"),
    ("fit plane POINTS -o OUT --figure FILE", "race.svg"),
    ("fit revolution POINTS -o STUDY/inputs/f.csv", "inputs/f.csv"),
    ("export FILE", "inputs/a/hand.xml"), ("learn block -o FILE", "resolved.json"),
    ("init FILE --force", "spec.toml"), ("arm URDF -o FILE --force", "spec.toml"),
    ("hand URDF -o FILE --force", "spec.toml"), ("explore block -o FILE", "units"),
    ("explore block -o FILE", "logs/episode"), ("explore block -o STUDY", ""),
    ("paper -o FILE", "inputs"), ("bench -o FILE", "units"),
    ("validate --only puma -o FILE", "units")])
def test_what_a_study_consists_of_is_not_written_over(
        words: str, file: str, study: Path, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    before = content(study)
    places = {"STUDY": str(study), "FILE": str(study / file), "OUT": str(tmp_path / "out.csv"),
              "POINTS": str(tmp_path / "points.csv"), "URDF": str(tmp_path / "robot.urdf")}
    given = [places.get(word, word.replace("STUDY", str(study))) for word in words.split()]
    assert cli.run(given) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert f"{study / file}: belongs to the study in {study}; choose " in printed.err
    assert content(study) == before


def test_results_of_other_names_may_lie_there(study: Path,
                                              capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["leaderboard", study, "-o", study / "leaderboard.csv"],
                  ["leaderboard", study, "-o", study / "board.csv"],
                  ["table", study, "pairs", "-o", study / "pairs.csv"],
                  ["rows", study, "-o", study / "rows.parquet"],
                  ["figure", study, "forest", "-o", study / "forest.svg"]):
        assert cli.run([*map(str, words)]) == 0
        assert Path(words[-1]).stat().st_size > 20
    assert (study / "leaderboard.csv").read_bytes() == (study / "board.csv").read_bytes()


def test_names_of_a_study_are_free_elsewhere(study: Path, tmp_path: Path,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "units").mkdir()
    for file in ("spec.toml", "units/spec.toml"):
        assert cli.run(["leaderboard", str(study), "-o", str(tmp_path / file)]) == 0
        assert (tmp_path / file).exists()


def test_a_link_to_a_study_is_no_way_around(study: Path, tmp_path: Path,
                                            monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "link").symlink_to(study)
    (tmp_path / "deep").symlink_to(study / "inputs/a")
    monkeypatch.chdir(study / "units")
    for file in (tmp_path / "link/spec.toml", tmp_path / "deep/new.csv", Path("new.csv"),
                 Path("../spec.toml"), tmp_path / "link/../study/units/new.csv"):
        assert study_of_file(file) == Path(os.path.realpath(study)), file
    assert study_of_file(tmp_path / "link/pairs.csv") is None


def test_a_study_that_lost_its_record_is_one(study: Path,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    (study / "resolved.json").unlink()
    assert study_of_file(study / "units/x.parquet") == study
    assert study_of_file(study / "spec.toml") == study


def test_a_place_that_is_missing_is_told_before_the_study_is_read(
        study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(commands, "make_leaderboard", lambda *given: pytest.fail("read"))
    assert cli.run(["leaderboard", str(study), "-o", str(tmp_path / "none/a.csv")]) == 2
    assert f"cannot be written: there is no folder {tmp_path / 'none'}" in capsys.readouterr().err


def test_what_a_link_stands_for_is_written_and_a_pipe_stays_one(
        study: Path, tmp_path: Path) -> None:
    board, link, pipe = tmp_path / "board.csv", tmp_path / "link.csv", tmp_path / "pipe"
    link.symlink_to(board)
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    for file in (link, pipe):
        assert cli.run(["leaderboard", str(study), "-o", str(file)]) == 0
    assert link.is_symlink()
    assert pipe.is_fifo()
    assert os.read(reader, 1 << 16) == board.read_bytes()
    os.close(reader)
    (tmp_path / "spec.csv").symlink_to(study / "spec.toml")
    assert study_of_file(tmp_path / "spec.csv") is not None
