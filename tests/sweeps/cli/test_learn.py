"""`warpgrasp learn`: models of one's own from the command line to the rows of a study."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from strategies.ready_made import STRATEGIES
from strategies.recognition.known_models import ModelsError, models_from_file
from sweeps.cli import main as cli
from sweeps.episode.episodes import run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.objects.catalogue_names import BODY_NAMES
from warpgrasp.parameters import RecognitionTable


@pytest.mark.parametrize(("words", "message"), [
    ([], "OBJECT: is missing"), (["nothing"], "no object 'nothing'"),
    (["block", "block"], "given twice"), (["block", "--episodes", "1"], "--episodes: is 1"),
    (["block", "--strategy", "ring7"], "no strategy 'ring7'"),
    (["block", "--unlisted", "8", "--only"], "--unlisted: learns everything anew"),
    (["block", "--extend", "absent.json"], "absent.json: cannot be read"),
    (["block", "--unlisted", "8", "--strategy", "ring6"], "name a strategy that follows them, too"),
    (["mug.stl"], "no object 'mug.stl'")])
def test_what_cannot_be_learned_is_said(
        words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.json"
    assert cli.run(["learn", *words, "-o", str(out)]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_where_nothing_can_be_written_nothing_is_felt(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sweeps.episode.teaching.teach", lambda *given: pytest.fail("felt"))
    for out in (tmp_path, tmp_path / "absent" / "mine.json"):
        assert cli.run(["learn", "block", "-o", str(out)]) == 2
        assert "cannot be written" in capsys.readouterr().err


def test_a_file_is_written_over_only_where_that_is_asked_for(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "spec.toml"
    out.write_text("schema = 1\n")
    monkeypatch.setattr("sweeps.cli.tools.learn_objects.learn_objects", lambda *_, **__: 0)
    assert cli.run(["learn", "block", "-o", str(out)]) == 2
    assert "spec.toml: exists already; choose another name, or use --force" in (
        capsys.readouterr().err)
    assert cli.run(["learn", "block", "-o", str(out), "--force"]) == 0
    assert cli.run(["learn", "block", "--extend", str(out), "-o", str(out)]) == 0


@pytest.mark.slow
def test_an_object_learned_by_grasps_is_named_in_rows(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.json"
    assert cli.run(["learn", "small_cylinder", "--strategy", "ring6", "--episodes", "8",
                    "-o", str(file)]) == 0
    assert "0 of 0" in capsys.readouterr().out  # no faces were looked for
    known = models_from_file(str(file))
    assert set(known.names) == set(BODY_NAMES)
    assert "learn small_cylinder --episodes 8" in known.made_by
    assert str(tmp_path) not in file.read_text()
    cell = Cell(STRATEGIES["ring6"], {"name": "small_cylinder"}, "my cylinder", seed=3,
                recognition=RecognitionTable(models=str(file)))
    rows = run_episodes(cell, np.arange(8), "cpu")
    recovered = rows["recognized_as"] != ""
    assert set(rows["recognized_by"][recovered]) == {"parameters"}
    assert np.isfinite(rows["recognized_probability"]).tolist() == recovered.tolist()
    assert (rows["recognized_as"] == "small_cylinder").mean() > 0.6
    assert rows["recognized"].tolist() == (rows["recognized_as"] == "small_cylinder").tolist()


def test_only_leaves_the_others_out(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    assert cli.run(["learn", "small_cylinder", "--strategy", "ring6", "--episodes", "4", "--only",
                    "-o", str(file)]) == 0
    assert models_from_file(str(file)).names == ("small_cylinder",)
    assert json.loads(file.read_text())["unlisted"]["parameters"]["count"] > 20


def test_an_object_that_nothing_is_felt_of_is_left_out(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trimesh.creation.box((6.0, 6.0, 6.0)).export(tmp_path / "speck.stl")
    words = ["--units", "mm", "--strategy", "ring6", "--episodes", "4", "--only", "-o"]
    file = tmp_path / "mine.json"
    assert cli.run(["learn", "small_cylinder", str(tmp_path / "speck.stl"), *words, str(file)]) == 1
    assert models_from_file(str(file)).names == ("small_cylinder",)
    assert "speck: no body was recovered" in capsys.readouterr().err
    alone = tmp_path / "alone.json"
    assert cli.run(["learn", str(tmp_path / "speck.stl"), *words, str(alone)]) == 2
    assert "nothing was written" in capsys.readouterr().err
    assert not alone.exists()


@pytest.fixture
def felt(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two boxes are felt in no time: all that is learned of one is what ships of the block."""
    def teach(objects, strategies, episodes, seed, device, *, listed=True):
        return iter(())

    def taught(lessons, contents):
        return dict(contents)

    def add(known, lessons, contents, made_by):
        block = next(one for one in models_from_file("").objects if one.name == "block")
        kept = [one for one in known.objects if one.name not in contents]
        return replace(known, made_by=made_by, objects=(*kept, *(
            replace(block, name=name, content=content, tried={**block.tried, "faces": 0},
                    found={**block.found, "faces": 0})
            for name, content in contents.items())))

    monkeypatch.setattr("sweeps.episode.teaching.teach", teach)
    monkeypatch.setattr("strategies.recognition.lessons.taught", taught)
    monkeypatch.setattr("strategies.recognition.lessons.add_objects", add)


def box(file: Path, size_mm: float) -> str:
    trimesh.creation.box((size_mm, 50.0, 60.0)).export(file)
    return str(file)


@pytest.mark.usefixtures("felt")
def test_one_body_is_learned_under_one_name(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, same, other = (box(tmp_path / f"{name}.stl", size) for name, size in (
        ("one", 40.0), ("same", 40.0), ("other", 45.0)))
    out = tmp_path / "mine.json"
    words = ["--units", "mm", "-o", str(out)]
    assert cli.run(["learn", one, same, *words]) == 2
    assert "same: is the same body as one" in capsys.readouterr().err
    assert not out.exists()
    assert cli.run(["learn", one, other, *words]) == 0
    assert cli.run(["learn", same, "--extend", str(out), *words]) == 2
    assert "same: is the same body as one" in capsys.readouterr().err
    assert cli.run(["learn", same, "--extend", str(out), "--only", *words]) == 0


@pytest.mark.usefixtures("felt")
def test_what_becomes_of_the_other_models_is_told(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.json"
    words = ["learn", box(tmp_path / "block.stl", 40.0), "--units", "mm", "-o", str(out)]
    assert cli.run(words) == 0
    said = capsys.readouterr().err
    assert "block: takes the place of the model of another body" in said
    assert "faces: is not used to recognize with this file, for it was not tried on block" in said
    made_by = models_from_file(str(out)).made_by
    assert "learn block.stl --units mm --episodes 16" in made_by
    assert cli.run([*words, "--extend", str(out)]) == 0
    assert "takes the place" not in capsys.readouterr().err


@pytest.mark.usefixtures("felt")
def test_a_file_whose_name_is_no_text_is_learned_under_one_that_is(tmp_path: Path) -> None:
    file = tmp_path / "\udcff.stl"
    Path(box(tmp_path / "plain.stl", 40.0)).rename(file)
    out = tmp_path / "mine.json"
    assert cli.run(["learn", str(file), "--units", "mm", "-o", str(out)]) == 0
    assert models_from_file(str(out)).names[-1].isprintable()
    out.write_text(out.read_text().replace(r'"\\udcff"', r'"\udcff"'))
    with pytest.raises(ModelsError, match="no file of models"):
        models_from_file(str(out))
