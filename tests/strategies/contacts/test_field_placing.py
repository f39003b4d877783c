"""Contacts placed on bodies given by their distances: as on the superquadric that they are of."""

from dataclasses import replace

import numpy as np
import pytest

from strategies.contacts.field_placing import (
    link_stations,
    places_on_field,
    possible_stations,
    sampled_field,
)
from strategies.ready_made import STRATEGIES
from strategies.recovery.body_distances import surface_distances
from strategies.recovery.fit_contacts import (
    FARTHEST_LINK_M,
    NORMAL_SIGMA_M,
    PLACE_SIGMA_M,
    TURN_SIGMA_RAD,
    contacts_placed,
)
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.spec.cell import Cell


@pytest.fixture(scope="module")
def block() -> EpisodeBlock:
    """Grasps of a block."""
    return run_block(Cell(STRATEGIES["ring6"], {"name": "block"}, "block", seed=5), np.arange(3),
                     "cpu")


def test_they_are_those_of_the_superquadric(block: EpisodeBlock) -> None:
    felt, links = block.exploration.felt, block.exploration.belief.links
    body = block.recovered.superquadric
    stations = link_stations(links)
    worlds = len(stations)
    flat = stations.reshape(worlds, -1, 3)
    distance, normal = surface_distances(body, flat, np.ones(flat.shape[:2], bool))
    found = places_on_field(
        links, felt.mask,
        sampled_field(distance.reshape(stations.shape[:3]), normal.reshape(stations.shape)),
        place_sigma_m=PLACE_SIGMA_M, turn_sigma_rad=TURN_SIGMA_RAD,
        farthest_m=FARTHEST_LINK_M, normal_sigma_m=NORMAL_SIGMA_M)
    expected = contacts_placed(felt, links, body)
    at = felt.mask & (found.chance > 0.0)
    assert at.sum() > 20
    assert np.allclose(found.point_m[at], expected.points_m[at], atol=1e-9)
    assert np.allclose(found.normal[at], expected.normals[at], atol=1e-7)
    assert np.allclose(found.covariance_m2[at], expected.covariance_m2[at], atol=1e-12)


def test_stations_of_links_that_torques_exclude_do_not_count(block: EpisodeBlock) -> None:
    felt, links = block.exploration.felt, block.exploration.belief.links
    possible = possible_stations(links)
    shape = possible.shape
    assert 0.1 < possible[felt.mask].mean() < 0.7
    normal = np.zeros((*shape, 3))
    normal[..., 2] = 1.0
    given = {"place_sigma_m": PLACE_SIGMA_M,
             "turn_sigma_rad": TURN_SIGMA_RAD, "farthest_m": FARTHEST_LINK_M,
             "normal_sigma_m": NORMAL_SIGMA_M}
    one = places_on_field(links, felt.mask, sampled_field(np.full(shape, 0.008), normal), **given)
    two = places_on_field(
        links, felt.mask, sampled_field(np.where(possible, 0.008, 5.0), normal), **given)
    assert (one.point_m == two.point_m).all()


@pytest.mark.parametrize("finger", [-1, 4])
def test_contacts_are_of_fingers_that_the_hand_has(block: EpisodeBlock, finger: int) -> None:
    links = block.exploration.belief.links
    other = np.full_like(links.finger, finger)
    with pytest.raises(ValueError, match=f"links.finger {finger}: wants 0 to 3"):
        link_stations(replace(links, finger=other))
