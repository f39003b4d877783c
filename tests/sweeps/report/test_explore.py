"""`explore` where nothing but the object is named: what it runs, what it says it chose and why."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strategies import exploration_record
from strategies.ready_made import DEFAULT, STRATEGIES
from strategies.recovery.contact_verdict import contact_verdicts
from sweeps.episode.episodes import run_block
from sweeps.report.episode_files import explore
from sweeps.report.trust import choice_sentence
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


def test_explore_says_what_it_chose(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And finds its contacts' verdicts once for all its files: they take longest of these."""
    found = []
    monkeypatch.setattr(exploration_record, "contact_verdicts", lambda *given: found.append(
        contact_verdicts(*given)) or found[-1])
    assert DEFAULT == "any-object"
    assert f'name = "{DEFAULT}"' in spec_template()
    explore(body_table={"name": "block"}, strategy=replace(STRATEGIES[DEFAULT], touches=32),
            seed=0, yaw_rad=0.0, x_m=0.45, y_m=0.0, out=tmp_path, device="cpu")
    assert "\nchosen: " in capsys.readouterr().err
    assert len(found) == 1
