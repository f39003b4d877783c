"""`check` and `explore` tell of parts that float, and of no others."""

from pathlib import Path

import pytest
import trimesh
from studies import SMALL, write_spec

from sweeps.cli import main as cli
from sweeps.cli import warmup
from sweeps.report import episode_files

SAID = ("two: a part floats: that from 80 to 110 mm above the table, about x 10 and y 0 mm, "
        "touches neither the table nor another part")
HELD = '{ name = "held", compound = [{ shape = "sphere", radius_mm = 30 }] }'


@pytest.fixture
def mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ball 30 mm above a block, the ball 10 mm aside."""
    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path / "cache"))
    block, ball = trimesh.creation.box((70.0, 60.0, 50.0)), trimesh.creation.icosphere(4, 15.0)
    ball.apply_translation((10.0, 0.0, 70.0))
    file = tmp_path / "two.stl"
    trimesh.util.concatenate([block, ball]).export(file)
    return file


def test_check_tells_of_a_part_that_floats(mesh: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for objects, told in ((f'"wedge", "mug-3", {HELD}', False),
                          (f'{{ mesh = "{mesh}", units = "mm" }}, {HELD}', True)):
        spec = write_spec(mesh.parent, SMALL.replace('"block", "wedge"', objects))
        assert cli.run(["check", str(spec)]) == 0
        out = capsys.readouterr().out
        assert (SAID in out) == told
        assert out.count("floats") == told


def test_explore_tells_of_a_part_that_floats(
        mesh: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "compile_explored", lambda *given, **words: None)
    monkeypatch.setattr(episode_files, "explore", lambda **given: [])
    for quiet in ([], ["--quiet"]):
        assert cli.run(["explore", str(mesh), "--units", "mm", "--strategy", "ring6", *quiet,
                        "-o", str(mesh.parent / f"out{len(quiet)}")]) == 0
        assert (SAID in capsys.readouterr().err) == (not quiet)
