"""Episodes with hands other than the Utah-MIT, on a floating wrist."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.ready_made import STRATEGIES
from sweeps.episode.contact_rows import contact_columns
from sweeps.episode.episodes import episode_notes, run_block, run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.parameters import ArmTable, ContactTable, HandTable

SMOOTH = ContactTable(friction=0.0)


def cell_of(hand: str, strategy: str = "ring6", contact: ContactTable = SMOOTH) -> Cell:
    return Cell(STRATEGIES[strategy], {"name": "block"}, "block", arm=ArmTable(kind="none"),
                hand=HandTable(kind=hand), contact=contact)


@pytest.mark.parametrize(("hand", "contact", "off_m"), [
    pytest.param("allegro", SMOOTH, 0.008, marks=pytest.mark.slow),
    pytest.param("leap", SMOOTH, 0.008, marks=pytest.mark.slow), ("barrett", SMOOTH, 0.008),
    # Forces lean within the cone by nobody knows how much: places are less sure.
    pytest.param("leap", ContactTable(), 0.012, marks=pytest.mark.slow)])
def test_a_ring_of_grasps_recovers_the_block_better_than_its_prior(
    hand: str, contact: ContactTable, off_m: float
) -> None:
    block = run_block(cell_of(hand, contact=contact), np.arange(6), "cpu")
    assert block.evidence.mask.sum(1).mean() > 12
    assert np.median(block.scores.chamfer_m) < 0.7 * np.median(block.prior_scores.chamfer_m)
    rows = contact_columns(block.exploration, block.truth)
    found = np.stack([rows[k] for k in ("x_m", "y_m", "z_m")], 1)
    true = np.stack([rows[k] for k in ("true_x_m", "true_y_m", "true_z_m")], 1)
    felt = np.isfinite(found).all(1) & np.isfinite(true).all(1) & (found[:, 2] > TABLE_MARGIN_M)
    assert np.median(np.linalg.norm(found - true, axis=1)[felt]) < off_m
    assert (rows["link"] == rows["true_link"])[felt].mean() > 0.75


def test_rows_of_a_world_do_not_depend_on_its_neighbours() -> None:
    cell = cell_of("allegro")
    both, one = run_episodes(cell, np.arange(2), "cpu"), run_episodes(cell, np.arange(1, 2), "cpu")
    for name, values in one.items():
        if values.dtype.kind in "fiu":
            assert (values[0] == both[name][1]) | ~np.isfinite(values[0]), name


@pytest.mark.parametrize("strategy", ["planar", "contour-only", "coarse-to-fine"])
def test_a_hand_without_pads_says_so_in_a_row(strategy: str, tmp_path: Path) -> None:
    file, model = tmp_path / "bare.toml", hand_named("leap")
    file.write_text(hand_text(replace(model, extended=None, opposed=None, fingers=tuple(
        replace(finger, pads=()) for finger in model.fingers))))
    refused(cell_of(str(file), strategy))


def refused(cell: Cell) -> None:
    rows = run_episodes(cell, np.arange(2), "cpu")
    assert (rows["status"] == "not_possible").all()
    assert all(note.startswith("not_possible: ") and "leap" in note for note in rows["note"])
    assert (rows["touches"] == 0).all()


@pytest.mark.parametrize(("hand", "strategy"), [
    ("allegro", "any-object"),
    pytest.param("leap", "expected-error", marks=pytest.mark.slow)])
def test_planners_that_foresee_touches_run_with_any_hand(hand: str, strategy: str) -> None:
    """Errors on: most fingers that close touch, and the body is found far better than the prior
    has it."""
    cell = cell_of(hand, strategy)
    few = replace(cell.strategy, touches=32)
    rows = run_episodes(replace(cell, strategy=few), np.arange(1), "cpu")
    assert (rows["status"] == "ok").all()
    assert (rows["note"] == "").all()
    assert (rows["contacts"] > 0.5 * rows["touches"]).all()
    assert (rows["chamfer_mm"] < 0.5 * rows["prior_chamfer_mm"]).all()


def test_a_hand_that_touches_nothing_says_where_it_closed() -> None:
    cell = replace(cell_of("barrett"), strategy=replace(
        STRATEGIES["ring6"], waypoints=tuple(replace(w, palm_clearance_m=0.25) for w in
                                             STRATEGIES["ring6"].waypoints)))  # type: ignore
    block = run_block(cell, np.arange(1), "cpu")
    note, = episode_notes(block, cell, np.zeros(1, int))
    assert "fingers closed at 6 poses and touched nothing" in note
