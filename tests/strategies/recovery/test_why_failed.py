"""What a row says of an episode that recovered no body."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fit.superquadric.geometry import superquadric
from strategies.poses.waypoints import BoundingCylinder
from strategies.ready_made import STRATEGIES
from strategies.recovery.plausibility import plausible, why_implausible
from strategies.recovery.recovery_failure import why_failed
from sweeps.episode.episodes import EpisodeBlock, run_block, run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.parameters import FitTable

FIT = FitTable(taper=False, rivals=False, rounds=0)
PRIOR = BoundingCylinder(np.array([0.45]), np.array([0.0]), np.array([0.05]), np.array([0.12]))


def funnels() -> Cell:
    return Cell(STRATEGIES["ring6"], {"name": "funnel"}, "funnel", seed=3, fit=FIT)


@pytest.fixture(scope="module")
def block() -> EpisodeBlock:
    return run_block(funnels(), np.arange(16), "cpu", curve=False)


def test_every_failing_row_has_a_note_that_says_why() -> None:
    rows = run_episodes(funnels(), np.arange(16), "cpu")
    few = (rows["status"] == "too_few_contacts") & (rows["contacts"] > 0)
    assert few.sum() > 3
    for count, note in zip(rows["contacts"][few], rows["note"][few], strict=True):
        assert re.match(f"{count} contacts?, 8 are needed", note)
    denied = rows["status"] == "fit_implausible"
    assert denied.any()
    assert all(note.startswith("the body fitted ") for note in rows["note"][denied])
    assert (rows["note"][rows["status"] != "ok"] != "").all()


def test_a_world_is_explained_alone_as_in_its_batch(block: EpisodeBlock) -> None:
    belief = block.exploration.belief
    every = why_failed(block.status, belief)
    assert ((every != "") == (block.status != "ok")).all()
    for world in np.flatnonzero(every != ""):
        own = np.array([world])
        assert why_failed(block.status[own], belief.of(own)).tolist() == [every[world]]


@pytest.mark.parametrize(("reconstruct", "told"), [("superquadric", True), ("chosen", False)])
def test_of_a_body_off_its_contacts_free_forms_are_named_to_those_who_did_not_ask(
        block: EpisodeBlock, reconstruct: str, told: bool) -> None:
    whole = block.exploration.belief
    belief = whole.of(np.flatnonzero(whole.fitted)[:1])
    far = replace(belief.fits, position_m=belief.fits.position_m + [0.2, 0.0, 0.0])
    asked = replace(belief, fits=far, fit=replace(FIT, reconstruct=reconstruct))
    note, = why_failed(np.array(["fit_implausible"]), asked)
    assert "mm from its contacts in the mean" in note
    assert ('fit.reconstruct = "chosen"' in note) == told


@pytest.mark.parametrize(("size", "place", "says"), [
    ((0.04, 0.03, 0.05), (0.45, 0.0, 0.05), []),
    ((0.04, 0.03, 0.05), (0.60, 0.0, 0.05), ["reaches 140 mm beyond the prior"]),
    ((0.04, 0.03, 0.05), (0.45, 0.0, 0.02), ["is 30 mm deep in the table"]),
    ((0.04, 0.03, 0.02), (0.45, 0.0, 0.07), ["ends 50 mm above the table"]),
    ((0.04, 0.0001, 0.01), (0.45, 0.0, 0.01), ["fills less than 1 % of the prior"]),
])
def test_prior_and_table_say_what_they_contradict(
        size: tuple[float, ...], place: tuple[float, ...], says: list[str]) -> None:
    body = superquadric(size, (0.3, 1.0), place, (0, 0, 0, 1))
    assert why_implausible(body, PRIOR) == says
    assert plausible(body, PRIOR)[0] == (not says)


@pytest.mark.parametrize("seed", range(3))
def test_they_say_something_of_every_body_that_is_not_plausible(seed: int) -> None:
    draw = np.random.default_rng(seed)
    for table_plane in (True, False):
        for _ in range(30):
            body = superquadric(draw.uniform(0.0005, 0.07, 3), (0.5, 1.0),
                                (draw.uniform(0.38, 0.52), 0.0, draw.uniform(0.0, 0.1)),
                                (0, 0, 0, 1))
            said = why_implausible(body, PRIOR, table_plane=table_plane)
            assert plausible(body, PRIOR, table_plane=table_plane)[0] == (not said)
