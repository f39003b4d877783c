"""`explore` where nothing but the object is named: what it runs, what it says it chose and why."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit.implicit.record import TriangleMesh
from fit.superquadric.geometry import Superquadric, superquadric, superquadric_surface
from strategies import exploration_record
from strategies.planners.register import planner
from strategies.ready_made import DEFAULT, STRATEGIES
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import verdicts_by_gap
from strategies.strategy import Strategy
from sweeps.episode.episodes import run_block
from sweeps.figures.contacts import contacts_shown
from sweeps.report.episode_files import explore
from sweeps.report.trust import choice_sentence, free_form_sentence, surface_near
from sweeps.spec.cell import Cell
from sweeps.spec.template import spec_template
from warpgrasp.parameters import FitTable

FIT = FitTable(taper=False, rivals=False, rounds=0, reconstruct="chosen")


def test_a_model_that_contacts_agree_with_is_chosen_and_few_contacts_choose_nothing() -> None:
    ring = replace(STRATEGIES["ring18"], name="ring")
    block = run_block(Cell(ring, {"name": "block"}, "block", seed=3, fit=FIT), np.arange(1), "cpu")
    assert choice_sentence(block).startswith("chosen: the superquadric, since contacts lie ")
    assert "a free form is tried from 2 mm on" in choice_sentence(block)
    few = run_block(Cell(replace(ring, touches=4), {"name": "block"}, "block", seed=3, fit=FIT),
                    np.arange(1), "cpu")
    assert choice_sentence(few) == ("chosen: the given prior, since 8 contacts are needed for a "
                                    "free form")
    shown = contacts_shown(few, "block")  # nothing was recovered that contacts could contradict
    assert shown.prior
    assert len(shown.points) > 0
    assert shown.near.all()


def test_explore_says_what_it_chose(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And finds its contacts' verdicts once for all its files: they take longest of these."""
    found = []
    monkeypatch.setattr(exploration_record, "verdicts_by_gap", lambda *given: found.append(
        verdicts_by_gap(*given)) or found[-1])
    assert DEFAULT == "any-object"
    assert f'name = "{DEFAULT}"' in spec_template()
    explore(body_table={"name": "block"}, strategy=STRATEGIES["ring6"],
            seed=0, yaw_rad=0.0, x_m=0.45, y_m=0.0, out=tmp_path, device="cpu")
    assert "\nchosen: " in capsys.readouterr().err
    assert len(found) == 1


def test_the_note_of_a_row_is_said_and_files_of_an_earlier_episode_do_not_stay(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """But those of a folder that holds none are the user's."""
    for name in ("recovered.ply", "mine.csv"):
        (tmp_path / name).write_text("the user's")
    for yaw in (0.0, 1.0):
        explore(body_table={"name": "block"}, strategy=STRATEGIES["ring6"], seed=0, yaw_rad=yaw,
                x_m=1.2, y_m=0.0, out=tmp_path, device="cpu", reconstruct="superquadric")
        assert (tmp_path / "recovered.ply").exists() == (yaw == 0.0)
        record = json.loads((tmp_path / "shape.json").read_text())
        assert record["true_pose"] == pytest.approx({"x_m": 1.2, "y_m": 0.0, "yaw_rad": yaw})
        metrics = record["metrics"]  # of the prior: 95 % of distances are less than the larger
        assert metrics["hausdorff95_mm"] > 1.1 * metrics["chamfer_mm"] > 0.0
        note = record["note"]
        assert note.startswith("the arm reaches none of 6 poses, such as (")
        assert f"\n{note}\n" in capsys.readouterr().err
    assert (tmp_path / "mine.csv").exists()
    assert (tmp_path / "surfaces.png").exists()


def test_an_episode_without_a_motion_is_told_although_it_has_no_replay(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """That there is nothing to replay was all that was said."""
    pytest.importorskip("viser")
    planner("wants_nothing")(lambda: lambda belief: [])
    written = explore(body_table={"name": "block"}, strategy=Strategy("idle", call="wants_nothing"),
                      seed=0, yaw_rad=0.0, x_m=0.45, y_m=0.0, out=tmp_path, device="cpu",
                      replay=True, reconstruct="superquadric")
    assert "replay.html" not in [file.name for file in written]
    said = capsys.readouterr().err
    assert f"{tmp_path / 'replay.html'}: not written: nothing to replay" in said
    assert "it did not try: its strategy wanted nothing" in said


def test_as_much_of_a_surface_is_near_contacts_as_of_its_area() -> None:
    """A block of 60 x 60 x 200 mm, its upper 80 mm touched all over: to 20 mm below these."""
    body = superquadric([0.03, 0.03, 0.1], [0.1, 0.1], [0.45, 0.0, 0.1])
    points = superquadric_surface(body, 4000)[0][0]
    felt = points[points[:, 2] > 0.12]
    share = surface_near(Recovered(np.array([Shape.SUPERQUADRIC]), body), felt)
    top, rise = 0.06**2, 4 * 0.06
    assert share == pytest.approx((top + rise * 0.1) / (top + rise * 0.194), abs=0.03)


def test_a_body_too_low_to_be_told_from_the_table_is_not_said_to_be_unfelt() -> None:
    flat = Superquadric(np.array([[0.03, 0.02, 0.0025]]), np.ones((1, 2)),
                        np.array([[0.45, 0.0, 0.0025]]), np.array([[0.0, 0.0, 0.0, 1.0]]),
                        np.zeros((1, 2)), np.zeros((1, 2)))
    assert np.isnan(surface_near(Recovered(np.array([Shape.SUPERQUADRIC]), flat),
                                 np.array([[0.45, 0.0, 0.005]])))
    ball = trimesh.creation.icosphere(2, 0.002)
    text = free_form_sentence(TriangleMesh(ball.vertices + [0.45, 0.0, 0.002], ball.faces),
                              np.array([[0.45, 0.0, 0.004]]))
    assert "0 %" not in text
    assert text.startswith("the recovered body is lower than 6 mm")
