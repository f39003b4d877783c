"""What a study read is kept by its content: episodes are run again after it moved and changed."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from studies import plan_of

from strategies.planners.planner_file import planner_file
from sweeps.analysis.rerun_episode import Episode, cell_of
from sweeps.episode.episodes import cell_body, run_episodes
from sweeps.run.changed_files import ChangedFilesError
from sweeps.run.plan import Plan, cell_hash
from sweeps.run.progress import Progress
from sweeps.run.scheduler import UnitQueue
from sweeps.run.store import Store, open_study
from sweeps.run.worker import run_units
from sweeps.spec.cell import Cell
from sweeps.spec.errors import StoreError

SPEC = """\
schema = 1
seed = 3
episodes_per_cell = 4
objects = [{ mesh = "box.stl", units = "m" }, { profile = "vase.csv" }]
[[strategy]]
name = "poses"
waypoints = { kind = "csv", file = "poses.csv" }
[[strategy]]
name = "own"
strategy = "mine.py:choose"
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the grid of the mesh is kept."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def study(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study of files of every kind, opened, and moved away from them."""
    monkeypatch.setenv("WARPGRASP_CACHE", str(cache))
    given = tmp_path / "given"
    given.mkdir()
    trimesh.creation.box((0.06, 0.05, 0.1)).export(given / "box.stl")
    (given / "vase.csv").write_text("z_mm,r_mm\n0,30\n80,20\n")
    (given / "poses.csv").write_text("x_m,y_m,z_m,qx,qy,qz,qw\n0.4,0,0.2,0,1,0,0\n")
    (given / "mine.py").write_text(
        "import helper\n\n\ndef choose(belief):\n    return helper.nothing()\n")
    (given / "helper.py").write_text("def nothing():\n    return []\n")
    plan = plan_of(given, SPEC)
    Store(tmp_path / "out").open_for(plan, None, "cpu")
    shutil.move(tmp_path / "out", tmp_path / "moved")
    return tmp_path / "moved"


def opened(folder: Path) -> Plan:
    return open_study([folder])[0]


def test_cells_are_those_of_the_spec_after_all_files_are_gone(study: Path) -> None:
    given = study.parent / "given"
    plan = plan_of(given, SPEC)
    wanted = [cell_body(plan.study.cell(0, body, 0)).content for body in (0, 1)]
    rows = run_episodes(plan.study.cell(0, 0, 0), np.arange(2), "cpu")
    shutil.rmtree(given)
    kept = opened(study)
    for strategy in (0, 1):
        for body in (0, 1):
            cell = cell_of(kept, Episode(strategy, body, 0))
            assert cell_body(cell).content == wanted[body]
            assert cell_hash(cell, kept.study.objects[body]) == cell_hash(
                kept.study.cell(strategy, body, 0), kept.study.objects[body])
    again = run_episodes(cell_of(kept, Episode(0, 0, 0)), np.arange(2), "cpu")
    for name in ("chamfer_mm", "touches", "status"):
        assert np.array_equal(again[name], rows[name])


@pytest.mark.parametrize(("which", "episode"), [
    ("box.stl", Episode(0, 0, 0)), ("vase.csv", Episode(1, 1, 0)),
    ("poses.csv", Episode(0, 0, 0)), ("helper.py", Episode(1, 0, 0)),
    ("mine.py", Episode(1, 0, 0))])
def test_a_copy_that_is_not_what_was_run_is_not_used(
        study: Path, which: str, episode: Episode) -> None:
    copy, = (study / "inputs").rglob(which)
    copy.write_bytes(copy.read_bytes() + b"\n")
    with pytest.raises(StoreError, match="keeps no copy with the content"):
        cell_of(opened(study), episode)
    copy.unlink()
    with pytest.raises(StoreError, match="keeps no copy"):
        cell_of(opened(study), episode)


def test_a_damaged_copy_is_made_again(tmp_path: Path, study: Path) -> None:
    copy, = (study / "inputs").rglob("box.stl")
    whole = copy.read_bytes()
    copy.write_bytes(b"garbage")
    Store(study).open_for(plan_of(tmp_path / "given", SPEC), None, "cpu")
    assert copy.read_bytes() == whole


@pytest.mark.parametrize("which", ["box.stl", "poses.csv", "helper.py", "mine.py"])
def test_units_whose_files_changed_are_not_run(
        tmp_path: Path, study: Path, which: str) -> None:
    plan = plan_of(tmp_path / "given", SPEC)
    units = [next(iter(plan.units()))] if which == "poses.csv" else list(plan.units())
    asked = []

    def run(cells: Sequence[tuple[Cell, np.ndarray]], device: str) -> list[dict[str, np.ndarray]]:
        asked.append(len(cells))
        return [{"touches": np.zeros(len(episodes))} for _, episodes in cells]

    run_units(run, units, "cpu")
    file = tmp_path / "given" / which
    whole = file.read_bytes()

    def changing(*given: Any) -> list[dict[str, np.ndarray]]:
        file.write_bytes(whole + b"\n")
        planner_file(tmp_path / "given" / "mine.py")  # as a planner is made
        return run(*given)

    with pytest.raises(ChangedFilesError, match=which.replace("helper", "mine")):
        run_units(changing, units, "cpu")
    done = len(asked)
    with pytest.raises(ChangedFilesError, match="changed since the study was read"):
        run_units(run, units, "cpu")
    assert len(asked) == done
    file.write_bytes(whole)
    planner_file(tmp_path / "given" / "mine.py")
    run_units(run, units, "cpu")
    file.unlink()
    if which != "helper.py":  # which nothing asks for until the planner is made again
        with pytest.raises(ChangedFilesError):
            run_units(run, units, "cpu")


def test_a_copy_is_not_replaced_by_what_a_file_has_become(tmp_path: Path, study: Path) -> None:
    given = tmp_path / "given"
    plan = plan_of(given, SPEC)
    copy, = (study / "inputs").rglob("box.stl")
    whole = copy.read_bytes()
    trimesh.creation.box((0.05, 0.05, 0.05)).export(given / "box.stl")
    Store(study).open_for(plan, None, "cpu")
    assert copy.read_bytes() == whole


def test_a_run_that_is_decided_by_scores_ends_where_files_change(
        tmp_path: Path, study: Path) -> None:
    """The episodes of a unit that fails would count as the worst."""
    plan = plan_of(tmp_path / "given", SPEC)
    units = list(plan.units())
    for further in (None, lambda: units):
        queue = UnitQueue(plan, Store(study), (1, 1), Progress(len(units), quiet=True),
                          further=further)
        unit = queue.take()[0]
        if further:
            with pytest.raises(StoreError, match="changed; finished units are kept"):
                queue.changed([unit], "box.stl: changed")
        else:
            queue.changed([unit], "box.stl: changed")
            assert queue.outcome.failed == 1
