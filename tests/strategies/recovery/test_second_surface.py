"""Contacts whose place depends on the model: told without the truth, in worlds by themselves."""

from dataclasses import replace

import numpy as np
import pytest

from fit.arrays import rows_of
from strategies.ready_made import STRATEGIES
from strategies.recovery.contact_verdict import UNSURE_BODY, accepted_contacts, contact_verdicts
from strategies.recovery.second_surface import moved_on_second_surface
from sweeps.episode.contact_rows import contact_columns
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.spec.cell import Cell
from warpgrasp.parameters import HandTable

FAR_M = 0.010


def explored(hand: HandTable, name: str) -> EpisodeBlock:
    """Episodes of a robot with the default errors on what no superquadric is: wedges have a ridge
    and slopes, bottles a neck."""
    cell = Cell(STRATEGIES["rim6-ring12"], {"name": name}, name, seed=17, hand=hand)
    return run_block(cell, np.arange(12), "cpu")


@pytest.fixture(scope="module")
def wedges() -> EpisodeBlock:
    return explored(HandTable(), "wedge")


def accepted_far(block: EpisodeBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each contact whether it is accepted, whether only its model speaks for it, and whether it
    lies far from where the finger touched."""
    columns = contact_columns(block.exploration, block.truth)
    off = np.linalg.norm(np.stack(
        [columns[f"{a}_m"] - columns[f"true_{a}_m"] for a in "xyz"]), axis=0)
    return columns["accepted"] == 1.0, columns["verdict"] == UNSURE_BODY, off > FAR_M


def test_hardly_one_accepted_contact_lies_far_from_where_the_finger_touched(
        wedges: EpisodeBlock) -> None:
    accepted, by_model, far = accepted_far(wedges)
    assert accepted.sum() > 500
    assert far[accepted].mean() <= 0.01
    assert far[by_model].mean() > 3.0 * far[accepted].mean()  # those that are left out
    assert by_model.sum() < 0.35 * (accepted | by_model).sum()


@pytest.mark.parametrize("kind", [pytest.param("allegro", marks=pytest.mark.slow), "barrett"])
def test_nor_does_one_of_a_hand_of_chains(kind: str) -> None:
    accepted, by_model, far = accepted_far(explored(HandTable(kind=kind), "wine_bottle"))
    assert accepted.sum() > 200
    assert far[accepted].mean() <= 0.01
    assert far[by_model].mean() > 2.0 * far[accepted].mean()


def test_a_world_does_not_depend_on_those_beside_it(wedges: EpisodeBlock) -> None:
    evidence, links = wedges.evidence, wedges.exploration.belief.links
    asked = accepted_contacts(wedges.recovered, evidence)
    together = moved_on_second_surface(evidence, links, asked)
    own = np.array([5])
    alone = moved_on_second_surface(rows_of(evidence, own), rows_of(links, own), asked[own])
    np.testing.assert_array_equal(alone[0], together[5])
    assert (together[asked] > 0.0).mean() > 0.9
    assert (together[~asked] == 0.0).all()


def test_touches_of_pads_do_not_move(wedges: EpisodeBlock) -> None:
    evidence, links = wedges.evidence, wedges.exploration.belief.links
    asked = accepted_contacts(wedges.recovered, evidence)
    by_pads = replace(links, linked=np.zeros_like(links.linked))
    assert (moved_on_second_surface(evidence, by_pads, asked) == 0.0).all()
    assert not (contact_verdicts(wedges.recovered, evidence, by_pads) == UNSURE_BODY).any()
