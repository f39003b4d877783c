"""Free-form bodies in rows: scored, named, their faults data; other columns unchanged."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strategies.ready_made import STRATEGIES
from sweeps.episode.curve_moments import CURVES
from sweeps.episode.episodes import run_episodes
from sweeps.run.plan import canonical_table, cell_hash
from sweeps.spec.cell import Cell
from sweeps.spec.errors import Problems
from sweeps.spec.named_files import read_reconstruct
from sweeps.spec.study import Body
from warpgrasp.parameters import FitTable

CELL = Cell(STRATEGIES["ring6"], {"name": "block"}, "block", seed=5)
SCORES = {"chamfer_mm", "normalized_chamfer", "hausdorff95_mm", "iou", "volume_ratio",
          "coverage5mm", "shape", "status", "note",
          "volume_low_m3", "volume_high_m3", "interval_trusted"}
FILE = '''
def recovered(touches):
    return touches.recovered

def broken(touches):
    raise RuntimeError("no weights")

def inside_out(touches):
    return lambda points, worlds: -touches.recovered(points, worlds)
'''


def rows(word: str) -> dict[str, np.ndarray]:
    return run_episodes(replace(CELL, fit=FitTable(reconstruct=word)), np.arange(3), "cpu")


@pytest.fixture(scope="module")
def plain() -> dict[str, np.ndarray]:
    """Rows without free-form bodies."""
    return rows("superquadric")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file of functions that recover bodies."""
    (tmp_path / "mine.py").write_text(FILE)
    return tmp_path / "mine.py"


def same_but_for_scores(found: dict[str, np.ndarray], plain: dict[str, np.ndarray]) -> None:
    assert list(found) == list(plain)
    for name in set(plain) - SCORES - set(CURVES):
        assert all(np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")
                   for a, b in zip(found[name], plain[name], strict=True)), name


@pytest.mark.slow
def test_rows_name_the_free_form_and_change_in_scores_alone() -> None:
    cell = replace(CELL, strategy=replace(STRATEGIES["any-object"], touches=96))
    plain, found = (run_episodes(replace(cell, fit=FitTable(reconstruct=word)), np.arange(3), "cpu")
                    for word in ("superquadric", "implicit"))
    same_but_for_scores(found, plain)
    made = np.char.startswith(found["shape"].astype(str), "implicit")
    assert made.any()
    assert (found["shape"][~made] == plain["shape"][~made]).all()
    assert (found["chamfer_mm"][~made] == plain["chamfer_mm"][~made]).all()
    assert (found["chamfer_mm"][made] != plain["chamfer_mm"][made]).all()
    assert (found["status"][made] == "ok").all()
    assert (found["chamfer_mm"][made] < 0.7 * found["prior_chamfer_mm"][made]).all()


def test_the_recovered_distance_as_a_plug_in_scores_like_the_body(plain, file: Path) -> None:
    found = rows(f"{file}:recovered")
    same_but_for_scores(found, plain)
    made = plain["status"] == "ok"
    assert (found["shape"] == "recovered").all()
    assert np.allclose(found["chamfer_mm"][made], plain["chamfer_mm"][made], atol=0.5)
    assert np.allclose(found["iou"][made], plain["iou"][made], atol=0.05)


def test_a_fault_is_a_row(plain, file: Path) -> None:
    found = rows(f"{file}:broken")
    assert (found["status"] == "reconstruct_failed").all()
    assert all("mine.py:6: broken: RuntimeError: no weights" in note for note in found["note"])
    for name in SCORES - {"status", "note"}:
        assert (found[name] == plain[name]).all()


def test_a_row_says_that_the_box_cut_its_body_off(file: Path) -> None:
    found = rows(f"{file}:inside_out")
    assert (found["shape"] == "inside_out").all()
    assert all("mine.py:8: inside_out: its body is cut off" in note for note in found["note"])


def test_a_plug_in_counts_by_its_content_and_not_its_place(file: Path, tmp_path: Path) -> None:
    other = tmp_path / "elsewhere" / "mine.py"
    other.parent.mkdir()
    other.write_text(FILE)
    body = Body("block", CELL.body_table)
    one, two = (replace(CELL, fit=FitTable(reconstruct=f"{f}:recovered")) for f in (file, other))
    assert cell_hash(one, body) == cell_hash(two, body) != cell_hash(CELL, body)
    assert str(tmp_path) not in str(canonical_table(one.fit))
    again = FitTable(**canonical_table(one.fit))
    assert canonical_table(again) == canonical_table(one.fit)


@pytest.mark.parametrize(("word", "said"), [
    ("implict", "did you mean implicit"), ("none.py:f", "is not a file"),
    ("mine.py:absent", "has no function 'absent'"), ("", "should be|one of|there are"),
])
def test_wrong_words_are_named(file: Path, word: str, said: str) -> None:
    problems = Problems("spec.toml", {})
    read_reconstruct(word, file.parent, problems)
    assert any(s in problems.found[0].what for s in said.split("|")), problems.found[0].what
    good = Problems("spec.toml", {})
    assert read_reconstruct("mine.py:recovered", file.parent, good) == f"{file}:recovered"
    assert not good.found


@pytest.mark.slow
def test_a_bent_body_is_recovered_as_one_that_may_bend() -> None:
    """An arch, touched alike, with and without the two parameters."""
    arch = {"name": "arch", "superquadric": {
        "size_mm": [20, 25, 70], "exponents": [0.3, 0.6], "bend_per_m": 6.0}}
    cells = [Cell(STRATEGIES["rim12-ring12"], arch, "arch", seed=6, fit=FitTable(bend=bend))
             for bend in (False, True)]
    straight, bent = (run_episodes(cell, np.arange(6), "cpu") for cell in cells)
    assert set(bent["shape"]) == {"tapered_bent_superquadric"}
    assert np.median(bent["chamfer_mm"]) < 0.75 * np.median(straight["chamfer_mm"])
    assert np.median(bent["iou"]) > np.median(straight["iou"]) + 0.03
