"""What a row says of an episode whose grasps touched nothing, or hardly anything but the hand."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from strategies.exploration_record import Procedure
from strategies.poses.waypoints import Ring
from strategies.procedures.options import ContourTable
from strategies.ready_made import STRATEGIES
from strategies.strategy import Strategy
from sweeps.episode.episodes import run_episodes
from sweeps.episode.untouched import UNTRIED, _side, mostly_itself
from sweeps.spec.cell import Cell
from warpgrasp.mechanism.arm_reach import nearest_reachable, pose_reachable
from warpgrasp.parameters import ArmTable, HandTable, ObjectTable, SensorTable, StereoTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps

ARM, HAND = ArmTable(), HandTable()
FAR = """
import numpy as np
from strategies import Grasp

def far(belief):
    poses = np.tile([{x}, 0.0, {z}, 1.0, 0.0, 0.0, 0.0], (belief.worlds, 3, 1))
    return [Grasp(poses)] if belief.step == 0 else []
"""
TEE = {"name": "tee", "compound": [
    {"shape": "block", "size_mm": [30, 30, 40]},
    {"shape": "block", "size_mm": [260, 24, 24], "at_mm": [0, 0, 40]}]}


def notes_of(strategy: Strategy, table: dict[str, object]) -> list[str]:
    rows = run_episodes(Cell(strategy, table, "it", seed=0), np.arange(4), "cpu")
    notes = [note for note in rows["note"] if "own links" not in note]
    assert not rows["contacts"][np.isin(rows["note"], notes) & (rows["note"] != "")].any()
    return notes


@pytest.mark.parametrize(("x", "z", "says"), [
    (450, 300, "such as (450, 0, 300) m: positions are in metres, not millimetres"),
    (1.6, 0.3, "the arm reaches none of 3 poses, such as (1.6, 0, 0.3) m; the nearest that it"),
])
def test_poses_out_of_reach_are_told_with_the_nearest_one(
        tmp_path: Path, x: float, z: float, says: str) -> None:
    file = tmp_path / "far.py"
    file.write_text(FAR.format(x=x, z=z))
    assert all(says in note for note in notes_of(Strategy("far", call=f"{file}:far"),
                                                 {"name": "block"}))


def test_poses_out_of_reach_are_not_told_for_those_that_strike(tmp_path: Path) -> None:
    file = tmp_path / "mixed.py"
    file.write_text(FAR.format(x=0.45, z=0.02).replace(
        "    return", "    poses[:, 0, 0] = 1.6\n    return"))
    notes = notes_of(Strategy("mixed", call=f"{file}:far"), {"name": "block"})
    assert all(note.startswith("the arm does not reach 1 of 3 poses, such as (1.6, 0, 0.02) m; ")
               and note.endswith("; at the others the open hand would strike the object or the "
                                 "table") for note in notes)


def test_a_hand_that_closes_beside_the_object_is_told_where_it_is() -> None:
    notes = [n for n in notes_of(Strategy("r", (Ring(count=6, tilt_rad=0.6),)), TEE) if n]
    assert notes
    assert any("the prior, " in note and " times as wide as the object there" in note
               for note in notes)
    assert all("touched nothing: " in note or "would strike" in note for note in notes)


@pytest.mark.parametrize(("sensors", "hand"), [
    (SensorTable(tendon_threshold_N=1000.0), HAND),
    (SensorTable(), HandTable(skin_stiffness_N_m=10.0))])
def test_fingers_that_press_unfelt_are_not_said_to_touch_nothing(
        sensors: SensorTable, hand: HandTable) -> None:
    cell = Cell(STRATEGIES["ring6"], {"name": "block"}, "it", seed=0, sensors=sensors, hand=hand)
    rows = run_episodes(cell, np.arange(2), "cpu")
    assert not rows["contacts"].any()
    assert all(note.endswith("touched the object, but the sensors did not feel it")
               for note in rows["note"])


@pytest.mark.parametrize(("x_m", "says"), [
    (1.5, "contour: the arm cannot reach there"), (0.45, "")])
def test_what_feels_with_pads_out_of_reach_says_so(x_m: float, says: str) -> None:
    cell = Cell(STRATEGIES["contour-only"], {"name": "large_cylinder"}, "it", seed=2,
                placement=ObjectTable(x_m=x_m))
    assert set(run_episodes(cell, np.arange(2), "cpu")["note"]) == {says}


def test_no_reachable_place_is_much_nearer_than_the_nearest() -> None:
    draw = np.random.default_rng(2)
    places = np.concatenate([draw.uniform([-1, -1, 0], [1, 1, 1.2], (4000, 3)),
                             np.tile([1.0, 0.0, 0.0, 0.0], (4000, 1))], 1)
    free = places[pose_reachable(ARM, HAND, places)]
    for wanted in ([1.6, 0.0, 0.3], [0.45, 0.0, 0.3], [0.0, -2.0, 1.0], [450.0, 0.0, 300.0]):
        pose = np.array([*wanted, 1.0, 0.0, 0.0, 0.0])
        found = nearest_reachable(ARM, HAND, pose)
        assert found is not None
        assert pose_reachable(ARM, HAND, found)
        best = np.linalg.norm(free[:, :3] - pose[:3], axis=1).min()
        assert np.linalg.norm(found[:3] - pose[:3]) < best + 0.03


def test_a_pose_that_no_place_allows_has_no_nearest() -> None:
    short = ArmTable(limit_low_rad=(0.0,) * 6, limit_high_rad=(0.01,) * 6)
    assert nearest_reachable(short, HAND, np.array([0.4, 0, 0.3, 1.0, 0, 0, 0])) is None


def test_the_nearest_place_is_found_by_trying_few(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []

    def counted(arm: ArmTable, hand: HandTable, poses: np.ndarray) -> np.ndarray:
        tried.append(poses.size // 7)
        return pose_reachable(arm, hand, poses)

    monkeypatch.setattr("warpgrasp.mechanism.arm_reach.pose_reachable", counted)
    # Every failed episode of a sweep asks: the whole lattice is 60,025 places.
    assert nearest_reachable(ARM, HAND, np.array([1.0, 0.0, 0.3, 1.0, 0, 0, 0])) is not None
    assert sum(tried) < 4000


def test_a_row_says_when_nearly_all_stops_were_taken_for_the_hand_itself() -> None:
    status = np.full((3, 2, 1, 4), int(ProbeStatus.NO_CONTACT))
    status[:, 0, 0] = int(ProbeStatus.SELF_CONTACT)
    status[0, 1, 0, 0] = status[1, 1, 0, :2] = int(ProbeStatus.CONTACT)
    felt = Grasps(*[Any] * 5)
    felt = replace(felt, closing=SimpleNamespace(status=status))
    done = Procedure("containment", 0, felt, np.ones(3, bool), 8)
    found = mostly_itself(SimpleNamespace(procedures=(done,), status=np.full(3, "ok")))
    assert list(found) == ["4 of 5 stops of fingers were taken for the hand's own links", "",
                           "4 of 4 stops of fingers were taken for the hand's own links"]


def test_a_row_says_that_nothing_was_tried(tmp_path: Path) -> None:
    (tmp_path / "idle.py").write_text("def idle(belief):\n    return []\n")
    assert notes_of(Strategy("idle", call=f"{tmp_path}/idle.py:idle"), {"name": "block"}) == [
        UNTRIED] * 4


def test_an_object_out_of_reach_is_told_where_a_planner_asks_for_nothing() -> None:
    """Planners leave out poses that the arm does not reach; that read as if they had no wish."""
    cell = Cell(STRATEGIES["even"], {"name": "block"}, "it", seed=0,
                placement=ObjectTable(x_m=1.4))
    rows = run_episodes(cell, np.arange(2), "cpu")
    assert all(note.startswith("the arm reaches none of 8 poses around the object, such as (")
               for note in rows["note"])


def test_a_contour_about_an_axis_that_no_camera_saw_says_so() -> None:
    """Through a hole of 0.6 degrees cameras see no edge; with the usual images they do."""
    strategy = replace(STRATEGIES["contour"], name="by-sight")
    cell = Cell(strategy, {"name": "large_cylinder"}, "large_cylinder", seed=5,
                contour=ContourTable(axis="stereo"))
    seen, unseen = (run_episodes(one, np.arange(2), "cpu") for one in (
        cell, replace(cell, stereo=StereoTable(field_of_view_rad=0.01))))
    assert not any("saw no axis" in note for note in seen["note"])
    assert all("saw no axis" in note for note in unseen["note"])
    assert all("contour" in words for words in unseen["procedures"])


@pytest.mark.parametrize(("to_object", "approach", "where"), [
    ((0.0, 0.0, -0.02), (0.0, 0.0, -1.0), "above"), ((0.0, 0.01, 0.03), (1.0, 0.0, 0.0), "below"),
    ((0.02, 0.0, -0.01), (1.0, 0.0, 0.0), "short of"),
    ((0.02, 0.0, 0.01), (0.0, 1.0, 0.0), "beside"), ((-0.02, 0.0, 0.0), (1.0, 0.0, 0.0), "beside")])
def test_a_hand_is_where_the_object_is_not(to_object: tuple[float, ...],
                                           approach: tuple[float, ...], where: str) -> None:
    assert _side(np.array(to_object), np.array(approach)) == f"{where} the object"
