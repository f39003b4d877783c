"""Episodes end to end on small batches: real grasps, real fits, rows as the contract says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import HELPERS

from fit.revolution.geometry import RevolutionBody, revolution_volume
from strategies.ready_made import STRATEGIES
from strategies.recognition.answers import ALIGNMENT, NONE
from strategies.recognition.known_models import models_from_file, models_text
from strategies.strategy import Strategy
from sweeps.analysis.entries import values_of
from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.episode.contact_rows import COLUMNS
from sweeps.episode.episodes import run_block, run_cells, run_episodes
from sweeps.episode.recognition_columns import right_answers, right_ones
from sweeps.report.episode_files import explore
from sweeps.run.plan import plan_study
from sweeps.run.store import Store
from sweeps.run.unit_file import write_unit
from sweeps.spec.cell import Cell
from sweeps.spec.reader import read_spec
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import FitTable, RecognitionTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

CELL = Cell(STRATEGIES["rim12-ring12"], {"name": "large_cylinder"}, "large_cylinder", seed=11)
CONTRACT = {"episode", "strategy", "object", "seed", "status", "contacts", "touches",
            "robot_time_s", "arm_path_m", "chamfer_mm", "normalized_chamfer", "hausdorff95_mm",
            "iou", "volume_ratio", "coverage5mm", "recognized_as", "recognized", "recognized_by",
            "recognized_probability", "shape", "fit_rms_mm", "fit_iterations", "fit_status",
            "volume_low_m3", "volume_high_m3", "interval_trusted",
            "contradicted_share", "model_adequate"}


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


def test_objects_of_one_name_are_each_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last one stood in for all."""
    given: list[str] = []

    def felt(parts, bodies, device: str) -> dict[str, np.ndarray]:
        given.extend(body.name for body in bodies)
        return {"episode": np.concatenate([episodes for _, episodes in parts])}

    monkeypatch.setattr("sweeps.episode.episodes._rows_of", felt)
    block, bottle = (replace(CELL, body_table={"name": name}, object_name="it")
                     for name in ("block", "wine_bottle"))
    found = run_cells([(block, np.arange(2)), (bottle, np.arange(3)), (block, np.arange(4))], "cpu")
    assert given == ["block", "block", "wine_bottle"]
    assert [len(rows["episode"]) for rows in found] == [2, 3, 4]


def test_rows_do_not_depend_on_the_batch(rows: dict) -> None:
    alone = run_episodes(CELL, np.array([4]), "cpu")
    for name, column in alone.items():
        assert repr(column.tolist()) == repr(rows[name][4:5].tolist()), name


@pytest.mark.parametrize("strategy", [
    "ring6", pytest.param("coarse-to-fine", marks=pytest.mark.slow)])
def test_objects_run_together_give_the_rows_of_each_alone(strategy: str) -> None:
    egg = {"name": "egg", "superquadric": {"size_mm": [30.0, 30.0, 45.0], "exponents": [1, 1.0]}}
    tables = [{"name": "block"}, egg, {"name": "lightbulb"}]
    parts = [(Cell(STRATEGIES[strategy], table, table["name"], seed=11), np.arange(n, n + 2))
             for n, table in enumerate(tables)]
    for part, columns in zip(parts, run_cells(parts, "cpu"), strict=True):
        for name, column in run_episodes(*part, "cpu").items():
            assert repr(column.tolist()) == repr(columns[name].tolist()), (part[0], name)


def test_objects_and_noise_are_common_to_strategies_and_settings() -> None:
    one = run_block(CELL, np.arange(2), "cpu")
    other = run_block(replace(CELL, strategy=STRATEGIES["ring6"],
                              sensors=SensorTable(tendon_threshold_N=9.0)), np.arange(2), "cpu")
    assert np.array_equal(one.truth.body_pose, other.truth.body_pose)
    assert np.array_equal(one.prior.radius_m, other.prior.radius_m)


def test_too_few_contacts_are_a_status_and_the_prior_is_scored() -> None:
    far = replace(STRATEGIES["ring6"], waypoints=tuple(
        replace(w, palm_clearance_m=0.3) for w in STRATEGIES["ring6"].waypoints))
    rows = run_episodes(replace(CELL, strategy=far), np.arange(2), "cpu")
    assert (rows["status"] == "too_few_contacts").all()
    assert (rows["shape"] == "prior").all()
    assert np.isfinite(rows["chamfer_mm"]).all()
    assert np.isnan(rows["fit_rms_mm"]).all()


@pytest.mark.slow
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
    rows = [dict(zip(COLUMNS, line.split(","), strict=True)) for line in lines[1:]]
    assert {row["status"] for row in rows} <= names
    for row in rows:
        assert (row["accepted"] == "") == (row["status"] != "contact")
        assert (row["link"] == "-1") == (row["status"] != "contact")
    shape = json.loads((tmp_path / "shape.json").read_text())
    assert shape["chosen"] in ("tapered_superquadric", "prior")
    assert 0.0 <= shape["metrics"]["iou"] <= 1.0
    known = shape["chosen"] != "prior"
    for name in ("interval_trusted", "model_adequate"):
        assert shape["interval"][name] in ((True, False) if known else (None,))
        assert not isinstance(shape["interval"][name], float)
    assert (tmp_path / "contacts.png").read_bytes().startswith(b"\x89PNG")


def test_explore_out_of_reach_writes_what_there_is_and_says_so(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    block = {"shape": "block", "size_mm": [60, 80, 120]}
    files = explore(body_table={"name": r"a$\q$", "compound": [block]},
                    strategy=STRATEGIES["planar"], seed=3, yaw_rad=0.0, x_m=2.0, y_m=0.0,
                    out=tmp_path, device="cpu")
    assert {f.name for f in files} == {
        "contacts.csv", "shape.json", "contacts.png", "surfaces.png"}
    assert all(f.stat().st_size > 100 for f in files)
    said = capsys.readouterr().err
    assert "too_few_contacts: nothing was recovered" in said


def test_none_of_these_is_right_of_an_object_whatever_its_name() -> None:
    egg = {"name": "block", "superquadric": {"size_mm": [45.0, 30.0, 30.0], "exponents": [1, 1.0]}}
    rows = run_episodes(Cell(STRATEGIES["ring6"], egg, "block", seed=11), np.arange(4), "cpu")
    assert NONE in rows["recognized_as"]
    assert np.array_equal(values_of(rows, "recognized"), rows["recognized_as"] == NONE)
    mine = replace(body_from_name("wine_bottle"), name="mine")
    for way in ("as_felt", ALIGNMENT):
        assert right_answers([mine], RecognitionTable(way=way)) == [{"wine_bottle"}]


def test_every_model_of_the_same_body_is_right(tmp_path: Path) -> None:
    """Whichever of several names the file has last."""
    known = models_from_file("")
    block = next(one for one in known.objects if one.name == "block")
    twice = replace(known, objects=(replace(block, name="one"), *known.objects[:2],
                                    replace(block, name="other")))
    (tmp_path / "twice.json").write_text(models_text(twice))
    answers = np.array(["one", "other", NONE, "", "one", NONE], object)
    bodies = [body_from_name("block"), body_from_name("wine_bottle")]
    table = RecognitionTable(models=str(tmp_path / "twice.json"))
    assert right_ones(answers, bodies, table, [4, 2]).tolist() == [
        True, True, False, False, False, True]


@pytest.mark.slow
def test_rows_hold_the_parameters_of_the_model_chosen() -> None:
    parts = [(Cell(STRATEGIES["contour-only"], {"name": name}, name, seed=3), np.arange(2))
             for name in ("coke_bottle", "block")]
    bottle, block = run_cells(parts, "cpu")
    assert list(bottle["shape"]) == ["revolution"] * 2
    assert "revolution" not in block["shape"]
    volume = sample_body(body_from_name("coke_bottle")).volume_m3
    for k in range(2):
        z, r = bottle["profile_z_m"][k], bottle["profile_r_m"][k]
        body = RevolutionBody(*(np.array([[bottle[name][k] for name in names]]) for names in (
            ("px_m", "py_m", "pz_m"), ("ax", "ay", "az"))), z[None], r[None])
        assert revolution_volume(body)[0] == pytest.approx(bottle["volume_ratio"][k] * volume)
        assert bottle["volume_m3"][k] == pytest.approx(bottle["volume_ratio"][k] * volume)
        assert np.abs(body.foot_m - [0.45, 0.0, 0.0]).max() < 0.005
        assert bottle["height_m"][k] == z[-1]
    assert ((bottle["fit_rms_mm"] > 0.01) & (bottle["fit_rms_mm"] < 2.0)).all()
    assert list(bottle["fit_status"]) == ["converged"] * 2
    for name in ("a1_m", "eps1", "qw", "kx", "bend_per_m"):
        assert np.isnan(bottle[name]).all()
        assert np.isfinite(block[name]).all()
    for name in ("ax", "height_m", "volume_m3"):
        assert np.isnan(block[name]).all()
    assert [len(z) for z in block["profile_z_m"]] == [0, 0]


@pytest.mark.parametrize(("strategy", "name", "figure", "shape"), [
    pytest.param("planar", "block", "faces.png", "plane", marks=pytest.mark.slow),
    pytest.param("contour-only", "beer_bottle", "contour.png", "revolution",
                 marks=pytest.mark.slow)])
def test_explore_writes_faces_and_a_contour(
    tmp_path: Path, strategy: str, name: str, figure: str, shape: str
) -> None:
    files = explore(body_table={"name": name}, strategy=STRATEGIES[strategy], seed=3,
                    yaw_rad=0.3, x_m=0.45, y_m=0.0, out=tmp_path, device="cpu")
    assert {f.name for f in files} >= {"contacts.csv", "shape.json", "contacts.png", figure}
    assert (tmp_path / figure).read_bytes().startswith(b"\x89PNG")
    rows = [line.split(",") for line in (tmp_path / "contacts.csv").read_text().splitlines()]
    column = {key: n for n, key in enumerate(rows[0])}
    touches = [r for r in rows[1:] if r[0] in ("planar", "contour")]
    assert len(touches) > 30
    felt = [r for r in touches if r[column["status"]] == "contact"]
    assert all(int(r[column["taxel_peak"]]) >= 6 for r in felt)
    apart = [np.linalg.norm([float(r[column[f"{axis}_m"]]) - float(r[column[f"true_{axis}_m"]])
                             for axis in "xyz"]) for r in felt
             if r[column["true_x_m"]] and r[column["x_m"]]]
    assert np.median(apart) < 0.006  # most of it by this episode's errors of calibration
    record = json.loads((tmp_path / "shape.json").read_text())
    assert shape in [model["shape"] for model in record["models"]]
    assert record["recognized_as"] == name
    assert record["metrics"]["iou"] > 0.8  # this episode's robot is off by some 4 mm
    assert record["procedures"][-1]["because"]


def test_a_broken_strategy_is_rows_and_a_note_in_the_leaderboard(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("def broken(belief):\n    return belief.no_such_thing\n")
    spec = tmp_path / "study.toml"
    spec.write_text('''schema = 1
episodes_per_cell = 2
objects = ["large_cylinder"]
[[strategy]]
name = "mine"
strategy = "mine.py:broken"
[[strategy]]
name = "ring6"
''')
    plan = plan_study(read_spec(spec))
    store = Store(tmp_path / "run")
    store.open_for(plan, spec.read_bytes(), "cpu")
    for unit in plan.units():
        write_unit(store.path(unit), unit.id,
                   run_episodes(unit.cell, np.arange(unit.start, unit.stop), "cpu"))
    rows = {unit.cell.strategy.name: store.read(unit) for unit in plan.units()}
    assert rows["mine"] is not None and rows["ring6"] is not None  # noqa: PT018
    assert list(rows["mine"]["status"]) == ["strategy_failed"] * 2
    assert list(rows["ring6"]["note"]) == ["", ""]
    board = make_leaderboard(plan, [store])
    assert any("strategy mine failed: mine.py:2: broken: AttributeError" in note
               for note in board.notes)
    assert [row[1] for row in board.rows] == ["ring6", "mine", "given-prior"]


def test_what_are_no_episodes_and_no_device_is_refused() -> None:
    with pytest.raises(ValueError, match="episodes: are none; should be one number or more"):
        run_episodes(CELL, np.arange(0), "cpu")
    with pytest.raises(TypeError, match="episodes: is of float64; should be of whole numbers"):
        run_episodes(CELL, np.zeros(2), "cpu")
    with pytest.raises(ValueError, match="device: there is no 'gpu' here"):
        run_episodes(CELL, np.arange(1), "gpu")


def test_none_but_the_oracle_foresees() -> None:
    """Whoever looks like it, or is of its kind, is handed nothing that leads to the truth."""
    theirs = HELPERS / "theirs.py"
    seer = run_episodes(replace(CELL, strategy=Strategy("s", call=f"{theirs}:Seer")),
                        np.arange(1), "cpu")
    assert "wanted nothing" in seer["note"][0]
    kin = run_episodes(replace(CELL, strategy=Strategy("s", call=f"{theirs}:OracleOfMine")),
                       np.arange(1), "cpu")
    assert "the oracle sees nothing" in kin["note"][0]
    oracle = Strategy("s", call="oracle", touches=8, options=(("tried", 1),))
    assert list(run_episodes(replace(CELL, strategy=oracle), np.arange(1), "cpu")["note"]) == [""]


@pytest.mark.parametrize("name", [
    "funnel", pytest.param("large_cylinder", marks=pytest.mark.slow)])
def test_curves_end_where_the_row_does(name: str) -> None:
    """However many poses at the end were barred, and whatever the fits after them came to."""
    strategy = replace(STRATEGIES["ring6"], refit_every=1)
    rows = run_episodes(Cell(strategy, {"name": name}, name, seed=3), np.arange(12), "cpu")
    for curve, end in (("curve_touches", "touches"), ("curve_time_s", "robot_time_s"),
                       ("curve_chamfer_mm", "chamfer_mm"), ("curve_iou", "iou")):
        np.testing.assert_array_equal([values[-1] for values in rows[curve]], rows[end], curve)
    for touches, time in zip(rows["curve_touches"], rows["curve_time_s"], strict=True):
        steps = np.diff(touches), np.diff(time)
        assert (np.minimum(*steps) >= 0).all()
        assert (np.maximum(*steps) > 0).all()
