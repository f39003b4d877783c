"""Contacts as files and figures tell them: placed on the body that stands, and judged by it."""

import csv
import io
from dataclasses import replace
from itertools import combinations_with_replacement
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.ready_made import STRATEGIES
from strategies.recovery.contact_verdict import NEAR_M
from sweeps.episode import contact_rows
from sweeps.episode.contact_rows import (
    MORE_JOINTS,
    VECTORS,
    _distinct,
    _judged,
    contact_columns,
    contact_tables,
    contacts_csv,
)
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.figures.contacts import contacts_shown
from sweeps.figures.meshes import mesh_of_world
from sweeps.report.surfaces import surfaces_shown
from sweeps.spec.cell import Cell
from warpgrasp.objects.families import family_table
from warpgrasp.objects.mesh_orientation import mesh_gap, mesh_of
from warpgrasp.parameters import FitTable


def made(strategy: str, name: str, word: str, touches: int = 24) -> EpisodeBlock:
    table = family_table(name) or {"name": name}
    cell = Cell(replace(STRATEGIES[strategy], touches=touches), table, name, seed=4,
                fit=FitTable(reconstruct=word))
    return run_block(cell, np.arange(1), "cpu", curve=False)


@pytest.fixture(scope="module")
def bowl() -> EpisodeBlock:
    """One whose free form stands, and which no superquadric is."""
    return made("any-object", "bowl-2", "implicit", 48)


def felt_rows(block: EpisodeBlock) -> tuple[list[dict[str, str]], np.ndarray]:
    """The rows of the contacts that the body used, and their places, (row, 3) [m]."""
    text = contacts_csv(block.exploration, block.truth)
    rows = [row for row in csv.DictReader(io.StringIO(text)) if row["accepted"]
            and row["status"] == "contact" and row["verdict"] != "table"]
    return rows, np.array([[float(row[name]) for name in ("x_m", "y_m", "z_m")] for row in rows])


def away(block: EpisodeBlock, points: np.ndarray) -> np.ndarray:
    """Distances of points (point, 3) from the world's mesh [m], (point,)."""
    mesh = mesh_of_world(block)
    assert mesh is not None
    return mesh_gap(mesh_of(mesh.vertices_m, mesh.faces, winding=False), points)


def test_contacts_of_a_free_form_are_where_it_placed_them(bowl: EpisodeBlock) -> None:
    rows, points = felt_rows(bowl)
    assert len(points) > 15
    assert np.median(away(bowl, points)) < 0.001
    assert np.median(away(bowl, bowl.evidence.points_m[0][bowl.evidence.mask[0]])) > 0.0015
    true = np.array([[float(row[f"true_{name}_m"]) for name in "xyz"] for row in rows])
    model = bowl.evidence.points_m[0][bowl.evidence.mask[0]]
    assert (np.linalg.norm(points - true, axis=1).mean()
            < np.linalg.norm(model - true, axis=1).mean())


def test_their_verdicts_are_those_against_it(bowl: EpisodeBlock) -> None:
    rows, points = felt_rows(bowl)
    gap = away(bowl, points)
    near = gap <= NEAR_M
    verdict = np.array([row["verdict"] for row in rows])
    assert ((verdict == "far") == ~near).all()
    assert "unsure_body" not in verdict
    accepted = np.array([row["accepted"] for row in rows]) == "1"
    assert (accepted == (verdict == "accepted")).all()
    assert accepted.mean() > 0.5


def test_figures_show_the_places_and_verdicts_of_the_file(bowl: EpisodeBlock) -> None:
    rows, points = felt_rows(bowl)
    shown = contacts_shown(bowl, "bowl")
    places = 1e3 * (points - bowl.truth.body_pose[0, :3])
    order, other = (np.lexsort(p.round(2).T) for p in (places, shown.points))
    assert np.allclose(places[order], shown.points[other], atol=2e-3)
    accepted = np.array([row["accepted"] == "1" for row in rows])
    assert (accepted[order] == shown.near[other]).all()
    assert np.array_equal(surfaces_shown(bowl, "bowl").points, shown.points)


def test_contacts_that_are_kept_are_the_same(bowl: EpisodeBlock) -> None:
    columns = contact_columns(bowl.exploration, bowl.truth)
    kept = contact_tables(bowl.exploration, bowl.truth)[0]
    assert np.array_equal(kept["x_m"], columns["x_m"].astype(np.float32), equal_nan=True)
    assert kept["verdict"].tolist() == columns["verdict"].tolist()


def test_touches_of_pads_are_moved_with_the_free_form() -> None:
    """By what is estimated of the robot's errors; those that it did not use stay."""
    block = made("contour", "wine_bottle", "implicit", 96)
    form = mesh_of_world(block)
    assert form is not None
    _, points = felt_rows(block)
    model = block.evidence.points_m[0][block.evidence.mask[0] & block.evidence.by_pad[0]]
    same = (np.abs(points[:, None] - model) < 2e-6).all(-1).any(1)
    assert same.mean() < 0.5
    assert np.median(away(block, points)) < np.median(away(block, model))


def test_where_the_model_stands_contacts_are_its_own() -> None:
    block = made("planar", "block", "superquadric", 200)
    points = np.stack([contact_columns(block.exploration, block.truth)[name]
                       for name in ("x_m", "y_m", "z_m")], axis=1)
    used = block.evidence.points_m[0][block.evidence.mask[0]]
    assert (points[:, None] == used).all(-1).any(0).all()


def test_columns_of_a_covariance_are_those_of_their_names() -> None:
    names, axes = VECTORS["covariance"], "xyz"
    found = dict(zip(names, _distinct(np.arange(1, 10).reshape(1, 3, 3))[0], strict=True))
    for one, other in combinations_with_replacement(range(3), 2):
        name = f"var_{axes[one]}_m2" if one == other else f"cov_{axes[one]}{axes[other]}_m2"
        assert found[name] == 3 * one + other + 1


def test_contacts_as_low_as_the_table_are_the_tables_whatever_else_is_said_of_them() -> None:
    """Also those that the body explains; what has no place has no verdict."""
    height = TABLE_MARGIN_M + np.array([-1e-3, 0.0, 1e-6, -1e-3, 1e-6, np.nan])
    given = np.array(["", "", "", "accepted", "accepted", "accepted"], object)
    columns = {"world": np.zeros(6, int), "x_m": np.zeros(6), "y_m": np.zeros(6), "z_m": height,
               "verdict": given}
    found: Any = SimpleNamespace(status=np.zeros(1), gaps=lambda points, mask: np.zeros(mask.shape))
    judged = _judged(columns, found)
    assert judged["verdict"].tolist() == ["table", "table", "accepted", "table", "accepted", ""]
    np.testing.assert_array_equal(judged["accepted"], [0.0, 0.0, 1.0, 0.0, 1.0, np.nan])


def test_files_of_contacts_have_all_joints_of_a_finger(
        bowl: EpisodeBlock, monkeypatch: pytest.MonkeyPatch) -> None:
    columns = contact_rows.contact_columns(bowl.exploration, bowl.truth)
    more = {name: np.full(len(columns["world"]), 0.25) for name in MORE_JOINTS}
    monkeypatch.setattr(contact_rows, "contact_columns", lambda found, truth: columns | more)
    rows = list(csv.DictReader(io.StringIO(contacts_csv(bowl.exploration, bowl.truth))))
    assert {(row["q4_rad"], row["q5_rad"]) for row in rows} == {("0.250000", "0.250000")}
