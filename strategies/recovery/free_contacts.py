"""A free-form body and the contacts that make it, in turns.

Joint torques say which link touched and roughly where along it, hardly on which side. What stands
there says the rest: a link touches where its axis is nearest, along the normal there. Contacts
placed on a superquadric are bent towards it where the object is none. Here a Gaussian process about
nothing is fitted to the contacts as they were felt, each contact is placed where torques and
process agree best, and the process is fitted again. Its surface is trusted little at first.
Errors of calibration move all contacts of an episode together. Fingers that touch the same places
from other sides contradict one another where they do, which tells of these errors.
"""

from dataclasses import replace

import numpy as np

from fit.arrays import rows_of
from fit.implicit.known import KnownProcess, fit_known, known_slopes, shared_error_means
from fit.implicit.record import ImplicitFit, Mean
from strategies.contacts.field_placing import (
    field_of_process,
    link_stations,
    places_on_field,
    possible_stations,
    sampled_field,
)
from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.placing_hands import told_by_torques
from strategies.contacts.shared_errors import shared_vectors
from strategies.recovery.belief import Belief
from strategies.recovery.evidence import CONTRADICTED_FROM, PLACED, SURE_LINK, Evidence
from strategies.recovery.fit_contacts import (
    FARTHEST_LINK_M,
    NORMAL_SIGMA_M,
    PLACE_SIGMA_M,
    TURN_SIGMA_RAD,
)
from warpgrasp.parameters import ArmTable, ErrorTable, FitTable

ROUNDS = 6
"""Fits after which contacts are placed, before the last one [est]."""
SURE_ROUNDS = 3
"""Rounds until the surface is trusted as much as that of a superquadric is."""
FIRST_PLACE_M, FIRST_TURN_RAD = 0.006, 0.3
"""How well the first surface predicts where an axis passes and which way it looks [est]."""
FIRST_SIGMA_M = 0.003
"""Least deviation of a contact as it was felt, along its normal [est]."""
LATER_SIGMA_M = 0.0015
"""Deviation of a placed contact along its normal [est]."""
ALIKE_SIGMA_M = 0.0007
"""The same less what the robot's errors do to all contacts of an episode alike [est]."""
LEFT_M = 0.0006
"""What is left of errors of calibration that make all contacts lie equally far out [est]."""
DOUBTED_SIGMA_M = 0.005
"""The same of one that contradicts the surface or whose link is in doubt [est]."""
PAD_SIGMA_M = 0.0006
"""Least deviation of a pad's touch [est]."""
PLACING = KnownProcess(length_m=0.15)
"""Of the fits that contacts are placed by: stiff, for single contacts still err [est]."""
CALIBRATING = KnownProcess(length_m=0.1, slope=0.1)
"""Of the fit that tells of the robot's errors [est]."""
BODY = KnownProcess(length_m=0.05)
"""Of the last fit [est]."""
DIGITS = 9
"""Of the field that contacts are placed by [m]: its products round by how they are computed."""


def begun_freely(felt: Evidence, modelled: Evidence, links: TouchedLinks | None) -> Evidence:
    """Contacts as `placed_freely` begins with them: as they were `felt`, but as they were placed on
    the model where torques alone hardly tell a place. It is centimetres off there."""
    if links is None or told_by_torques(links).all():
        return felt
    own = ~told_by_torques(links)
    return replace(felt, **{
        name: np.where(own.reshape(*own.shape, *[1] * (getattr(felt, name).ndim - 2)),
                       getattr(modelled, name), getattr(felt, name))
        for name in PLACED})


def placed_freely(
    felt: Evidence, links: TouchedLinks | None, table: FitTable,
    calibration: tuple[ErrorTable, ArmTable] | None = None,
) -> tuple[Evidence, np.ndarray]:
    """Contacts of all worlds as placed on free forms of their own, and their deviations along the
    normal [m], (world, point).

    `felt` has contacts as they were felt, `links` how fingers stood. Those of pads are not placed
    anew; they, too, are moved by what all contacts together tell of the robot's errors, if
    `calibration` says how large those of hand and arm may be. Where there are no `links`, all stay
    where they are.
    """
    placed, sigma = felt, _first_sigma(felt)
    if links is None or not felt.mask.any():
        return placed, sigma
    if (felt.mask & links.linked).any():
        stations = link_stations(links)
        for turn in range(ROUNDS):
            fits = fit_placed(placed, sigma, table, PLACING)
            placed, sigma = _placed(fits, placed, sigma, links, stations,
                                    min(turn / SURE_ROUNDS, 1.0))
    if calibration is not None:
        placed = _calibrated(placed, sigma, links, calibration)
    return placed, sigma


def fitted_freely(
    felt: Evidence, links: TouchedLinks | None, table: FitTable,
    calibration: tuple[ErrorTable, ArmTable] | None = None,
) -> tuple[ImplicitFit, Evidence]:
    """Free-form bodies of all worlds about no body, whose mean is `BODY.mean`, and the contacts as
    placed on them; arguments are those of `placed_freely`."""
    placed, sigma = placed_freely(felt, links, table, calibration)
    return fit_placed(placed, sigma, table), placed


def fit_placed(placed: Evidence, sigma_m: np.ndarray, table: FitTable,
               process: KnownProcess = BODY, mean: Mean | None = None) -> ImplicitFit:
    """Free-form bodies of contacts as they are `placed`, of deviations `sigma_m` (world, point),
    about `mean`, or that of `process`."""
    free = {"free_points": placed.free_m, "free_radius": placed.free_radius_m,
            "free_mask": placed.free_mask} if table.free_space else {}
    return fit_known(placed.points_m, placed.mask, placed.normals, sigma_m, process,
                     table_z=0.0 if table.table_plane else None, mean=mean, **free)


def believed_freely(belief: Belief, worlds: np.ndarray | int) -> ImplicitFit:
    """The free forms about no body that would be made now of the contacts of some worlds, by their
    numbers, or of one; one of nothing, where there are hardly any. Raises ValueError for a belief
    that does not say where contacts were felt."""
    if belief.unplaced is None:
        raise ValueError("belief: does not say where contacts were felt")
    own = np.atleast_1d(worlds)
    links = rows_of(belief.links, own)
    begun = begun_freely(rows_of(belief.unplaced, own), rows_of(belief.evidence, own), links)
    return fitted_freely(begun, links, belief.fit, (belief.errors, belief.arm))[0]


def _calibrated(placed: Evidence, sigma: np.ndarray, links: TouchedLinks,
                calibration: tuple[ErrorTable, ArmTable]) -> Evidence:
    """Contacts less what the robot's errors moved them by, as far as they tell."""
    vectors = shared_vectors(links, placed.points_m, *calibration)
    normals = np.nan_to_num(placed.normals)
    found = shared_error_means(
        placed.points_m, placed.mask, placed.normals,
        np.where(sigma == LATER_SIGMA_M, ALIKE_SIGMA_M, sigma),
        np.einsum("wpie,wpi->wpe", vectors, normals), CALIBRATING)
    shift = np.einsum("wpie,we->wpi", vectors, found)
    return replace(placed, points_m=placed.points_m + np.where(placed.mask[..., None], shift, 0.0))


def _placed(fits: ImplicitFit, before: Evidence, sigma: np.ndarray, links: TouchedLinks,
            stations: np.ndarray, trust: float) -> tuple[Evidence, np.ndarray]:
    asked = before.mask & links.linked
    distance, normal = _field(fits, stations, asked[..., None] & possible_stations(links))
    found = places_on_field(
        links, asked, sampled_field(distance, normal),
        place_sigma_m=FIRST_PLACE_M + trust * (PLACE_SIGMA_M - FIRST_PLACE_M),
        turn_sigma_rad=FIRST_TURN_RAD + trust * (TURN_SIGMA_RAD - FIRST_TURN_RAD),
        farthest_m=FARTHEST_LINK_M, normal_sigma_m=NORMAL_SIGMA_M)
    moved = asked & (found.chance > 0.0) & np.isfinite(found.point_m).all(-1)
    contradiction = np.where(moved, np.where(found.chance >= SURE_LINK, found.misfit, np.inf),
                             before.contradiction)
    placed = replace(
        before, points_m=np.where(moved[..., None], found.point_m, before.points_m),
        covariance_m2=np.where(moved[..., None, None], found.covariance_m2,
                               before.covariance_m2),
        normals=np.where(moved[..., None], found.normal, before.normals),
        contradiction=contradiction)
    own = np.where(contradiction > CONTRADICTED_FROM, DOUBTED_SIGMA_M, LATER_SIGMA_M)
    return placed, np.where(moved, own, sigma)


def _field(fits: ImplicitFit, stations: np.ndarray, wanted: np.ndarray
           ) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] and unit normals of the bodies at the stations `wanted`, (world, point,
    station); 1 m and no normal elsewhere."""
    distance, normal = np.ones(wanted.shape), np.zeros(stations.shape)
    for world, mine in enumerate(wanted):
        if mine.any():
            found = known_slopes(fits, world, PLACING, stations[world][mine])
            value, slope = (np.round(values, DIGITS) for values in found)
            distance[world][mine], normal[world][mine] = field_of_process(value, slope)
    return distance, normal


def _first_sigma(felt: Evidence) -> np.ndarray:
    """Deviations of contacts along their normals as they were felt, (world, point)."""
    normal = np.nan_to_num(felt.normals)
    along = np.sqrt(np.maximum(np.einsum("wpi,wpij,wpj->wp", normal, felt.covariance_m2, normal),
                               0.0))
    return np.where(felt.by_pad, np.maximum(along, PAD_SIGMA_M), np.maximum(along, FIRST_SIGMA_M))
