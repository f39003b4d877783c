"""Episodes end to end on small batches: real grasps, real fits, rows as the contract says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strategies.catalogue import STRATEGIES
from sweeps.cell import Cell
from sweeps.episodes import run_block, run_episodes
from sweeps.explore import COLUMNS, explore
from warpgrasp.parameters import FitTable, SensorTable
from warpgrasp.status import ProbeStatus

CELL = Cell(STRATEGIES["rim12-ring12"], {"name": "large_cylinder"}, "large_cylinder", seed=11)
CONTRACT = {"episode", "strategy", "object", "seed", "status", "contacts", "touches",
            "robot_time_s", "arm_path_m", "chamfer_mm", "hausdorff95_mm", "iou", "volume_ratio",
            "coverage5mm", "recognized_as", "shape", "fit_rms_mm", "fit_iterations", "fit_status"}


@pytest.fixture(scope="module")
def rows() -> dict[str, np.ndarray]:
    return run_episodes(CELL, np.arange(6), "cpu")


def test_rows_hold_the_contract_and_a_cylinder_is_recovered(rows: dict) -> None:
    assert set(rows) >= CONTRACT
    assert {len(column) for column in rows.values()} == {6}
    assert (rows["status"] == "ok").all()
    assert np.median(rows["iou"]) > 0.85
    assert (rows["contacts"] >= 30).all()
    assert (rows["touches"] >= rows["contacts"]).all()
    for name in ("robot_time_s", "arm_path_m", "chamfer_mm", "iou", "a1_m"):
        assert np.isfinite(rows[name]).all()


def test_rows_do_not_depend_on_the_batch(rows: dict) -> None:
    alone = run_episodes(CELL, np.array([4]), "cpu")
    for name, column in alone.items():
        assert np.array_equal(column, rows[name][4:5]), name


def test_objects_and_noise_are_common_to_strategies_and_settings() -> None:
    one = run_block(CELL, np.arange(2), "cpu")
    other = run_block(replace(CELL, strategy=STRATEGIES["ring6"],
                              sensors=SensorTable(tendon_threshold_N=9.0)), np.arange(2), "cpu")
    assert np.array_equal(one.truth.body_pose, other.truth.body_pose)
    assert np.array_equal(one.told.radius_m, other.told.radius_m)


def test_too_few_contacts_are_a_status_and_the_told_cylinder_is_scored() -> None:
    far = replace(STRATEGIES["ring6"], waypoints=tuple(
        replace(w, palm_clearance_m=0.3) for w in STRATEGIES["ring6"].waypoints))
    rows = run_episodes(replace(CELL, strategy=far), np.arange(2), "cpu")
    assert (rows["status"] == "too_few_contacts").all()
    assert (rows["shape"] == "told_cylinder").all()
    assert np.isfinite(rows["chamfer_mm"]).all()
    assert np.isnan(rows["fit_rms_mm"]).all()


def test_the_papers_estimator_runs_too() -> None:
    rows = run_episodes(replace(CELL, sensors=SensorTable(contact_estimator="fingertip"),
                                fit=FitTable(taper=False, free_space=False)), np.arange(2), "cpu")
    assert (rows["shape"] == "superquadric").all()
    assert (rows["iou"] > 0.3).all()


def test_explore_writes_contacts_shape_and_a_figure(tmp_path: Path) -> None:
    explore(body_table={"name": "block"}, strategy=STRATEGIES["top2-ring6"], seed=3, yaw_rad=0.0,
            x_m=0.45, y_m=0.0, out=tmp_path, device="cpu")
    lines = (tmp_path / "contacts.csv").read_text().splitlines()
    assert tuple(lines[0].split(",")) == COLUMNS
    assert len(lines) == 1 + 8 * 2 * 4
    names = {status.name.lower() for status in ProbeStatus}
    assert {line.split(",")[5] for line in lines[1:]} <= names
    shape = json.loads((tmp_path / "shape.json").read_text())
    assert shape["chosen"] in ("tapered_superquadric", "told_cylinder")
    assert 0.0 <= shape["metrics"]["iou"] <= 1.0
    assert (tmp_path / "contacts.png").read_bytes().startswith(b"\x89PNG")
