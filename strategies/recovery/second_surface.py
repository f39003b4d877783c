"""Where contacts would be if the recovered model were not believed: on a smooth surface through
the contacts themselves.

A contact's place along its link follows from the direction of the body's surface there, and a
model has that everywhere: a superquadric has rounded ends where a bottle has a mouth, and flat
faces where a wedge is steeper. A loose Gaussian process about all contacts as placed on the model
knows of it only what contacts held. Where torques and that surface put a contact elsewhere, its
place is the model's word.
"""

import numpy as np

from fit.arrays import rows_of
from fit.implicit.known import KnownProcess, fit_known, known_slopes
from strategies.contacts.field_placing import (
    field_of_process,
    link_stations,
    places_on_field,
    possible_stations,
    sampled_field,
)
from strategies.contacts.finger_touch import TouchedLinks
from strategies.recovery.evidence import Evidence
from strategies.recovery.fit_contacts import (
    FARTHEST_LINK_M,
    NORMAL_SIGMA_M,
    PLACE_SIGMA_M,
    TURN_SIGMA_RAD,
)

SURFACE = KnownProcess(length_m=0.10)
"""Of the surface that contacts are placed by [est]."""
SIGMA_M = 0.003
"""Deviation of a contact from it, along the normal: more than contacts have, so that few of them
that lie off do not bend it [est]."""


def moved_on_second_surface(
    evidence: Evidence, links: TouchedLinks, asked: np.ndarray
) -> np.ndarray:
    """How far the contacts `asked`, bool (world, point), lie from where torques and a smooth
    surface through all contacts of their world put them [m], (world, point).

    0 where contacts are not asked for, where no link can have made one, and in worlds of fewer than
    four contacts.
    """
    moved = np.zeros(asked.shape)
    asked = asked & evidence.mask & links.linked
    for row in np.flatnonzero(asked.any(1)):
        own = np.array([row])  # one at a time: a world's contacts do not depend on others
        moved[row] = _moved(rows_of(evidence, own), rows_of(links, own), asked[own])[0]
    return moved


def _moved(evidence: Evidence, links: TouchedLinks, asked: np.ndarray) -> np.ndarray:
    """The same of one world whose contacts are asked for."""
    surface = fit_known(
        evidence.points_m, evidence.mask, evidence.normals, np.full(asked.shape, SIGMA_M), SURFACE,
        free_points=evidence.free_m, free_mask=evidence.free_mask,
        free_radius=evidence.free_radius_m)
    wanted = asked[..., None] & possible_stations(links)
    stations = link_stations(links)
    distance, normal = np.ones(wanted.shape), np.zeros(stations.shape)
    distance[wanted], normal[wanted] = field_of_process(
        *known_slopes(surface, 0, SURFACE, stations[wanted]))
    found = places_on_field(
        links, asked, sampled_field(distance, normal),
        place_sigma_m=PLACE_SIGMA_M, turn_sigma_rad=TURN_SIGMA_RAD,
        farthest_m=FARTHEST_LINK_M, normal_sigma_m=NORMAL_SIGMA_M)
    there = asked & (found.chance > 0.0) & np.isfinite(found.point_m).all(-1)
    away = np.linalg.norm(found.point_m - evidence.points_m, axis=-1)
    return np.where(there, away, 0.0)
