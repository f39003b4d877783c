"""What a free form begins with: contacts as felt, or, where torques are few, as on the model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strategies.contacts.finger_touch import no_links
from strategies.contacts.placing_hands import told_by_torques
from strategies.ready_made import STRATEGIES
from strategies.recovery.free_contacts import begun_freely, placed_freely
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.spec.cell import Cell
from warpgrasp.parameters import HandTable

DATA = Path(__file__).parents[3] / "warpgrasp" / "hands" / "data"


def explored(hand: HandTable) -> EpisodeBlock:
    cell = Cell(STRATEGIES["rim6-ring12"], {"name": "block"}, "block", seed=11, hand=hand)
    return run_block(cell, np.arange(2), "cpu")


def test_four_torques_tell_a_place_fewer_and_switches_do_not(tmp_path: Path) -> None:
    switches = tmp_path / "switches.toml"
    text = (DATA / "allegro.toml").read_text()
    assert 'senses = "joint_torques"' in text
    switches.write_text(text.replace('senses = "joint_torques"', 'senses = "tip_switches"'))
    kinds = {"utah_mit": True, "allegro": True, "leap": True, "barrett": False,
             str(switches): False}
    for kind, told in kinds.items():
        links = no_links(1, 3, HandTable(kind=kind))
        links = replace(links, finger=np.arange(3)[None])
        assert (told_by_torques(links) == told).all(), kind


@pytest.mark.parametrize("kind", ["utah_mit", "allegro"])
def test_contacts_that_torques_tell_begin_as_they_were_felt(kind: str) -> None:
    found = explored(HandTable(kind=kind)).exploration
    assert begun_freely(found.felt, found.belief.evidence, found.belief.links) is found.felt


def test_those_of_few_torques_begin_on_the_model_and_end_where_fingers_touched() -> None:
    block = explored(HandTable(kind="barrett"))
    found, belief = block.exploration, block.exploration.belief
    true = np.concatenate([block.truth.closings[p.closing].point_m.reshape(2, -1, 3)
                           for p in found.procedures], axis=1)
    begun = begun_freely(found.felt, belief.evidence, belief.links)
    at = found.felt.mask
    np.testing.assert_array_equal(begun.points_m[at], belief.evidence.points_m[at])
    placed, _ = placed_freely(begun, belief.links, belief.fit)

    def median_m(points: np.ndarray) -> float:
        return float(np.median(np.linalg.norm(points - true, axis=-1)[at]))

    assert at.sum() > 100
    assert median_m(found.felt.points_m) > 0.02
    assert median_m(placed.points_m) < 0.004
