"""Which bodies are fitted again after a step, and how: refined, or from new starts.

Where nothing new was felt, a body stays. Where something was, it is refined from the body last
fitted. New starts take many times as long: a body has them when links first feel something, when
pads contradict it, where its touches lie off it as its episode comes to 2, 3, 4, 6, 8, 12, 16 ...
steps, and when its episode ends. That is in all worlds at once, for one call of a program takes
many of them. On the way they are few and rough: no rivals, and contacts placed once. Of refined
body and new one the nearer to the touches stays. Where an episode would end without a body because
one that tapers or bends reaches far beyond the prior, a straight one is fitted.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fit.arrays import put_rows, row_sums, rows_of, with_rows
from fit.fit_status import is_fitted
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.record import SuperquadricFit
from strategies.contacts.finger_touch import TouchedLinks
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.contour_shape import Profile
from strategies.recovery.body_distances import contour_distances
from strategies.recovery.choose_model import revolution_of
from strategies.recovery.evidence import Evidence
from strategies.recovery.fit_contacts import (
    FREE_BALLS,
    LAST_ITERATIONS,
    Bodies,
    beside_rivals,
    nearer,
    recover_bodies,
    refine_bodies,
)
from strategies.recovery.misfit import FARTHEST_M, RIVALS_FROM_M, doubt, touch_misfit
from strategies.recovery.plausibility import reaches_beyond
from warpgrasp.parameters import FitTable

ROUGH_ROUNDS = 1
"""Rounds of new starts that are not the last."""
A_DOUBLING = 2
"""So many times a body has new starts while the steps of its episode double."""
EXPLAINED_M = 0.001
"""Mean distance of pads' touches from a contour that explains them [est]."""
FEWEST_EXPLAINED = 8
"""Fewer touches do not show that a contour explains them."""


def felt_by_pads(felt: Evidence, rows: np.ndarray) -> Evidence:
    """What pads of the worlds `rows` have felt; nothing in the others."""
    here = np.zeros((len(felt.mask), 1), bool)
    here[rows] = True
    return replace(felt, mask=felt.mask & felt.by_pad & here)


def contradicted(fits: SuperquadricFit, by_pads: Evidence) -> np.ndarray:
    """Where pads have felt something far from the body last fitted, bool (world,)."""
    return by_pads.mask.any(1) & (touch_misfit(fits, by_pads) > RIVALS_FROM_M)


def explained(profile: Profile | None, by_pads: Evidence) -> np.ndarray:
    """Where a contour lies near all that pads have felt, bool (world,).

    It will stand for the body then (`choose_model`): of what no superquadric
    is, a better superquadric is not worth a fit from scratch, nor a rival's.
    """
    mask = by_pads.mask
    if profile is None:
        return np.zeros(len(mask), bool)
    away = np.minimum(contour_distances(revolution_of(profile), by_pads.points_m, mask), FARTHEST_M)
    count = mask.sum(1)
    mean = row_sums(np.where(mask, away, 0.0)) / np.maximum(count, 1)
    return (count >= FEWEST_EXPLAINED) & (mean < EXPLAINED_M)


@dataclass(frozen=True)
class Fitted:
    """Bodies last fitted. Shapes start with (world,)."""

    fits: SuperquadricFit
    placed: Evidence
    """What they were fitted to."""
    renewed_at: np.ndarray
    """Step in which new starts were last tried, int (world,)."""
    rough: np.ndarray
    """Bodies that are to have new starts when their episode ends, bool (world,)."""


def unfitted(felt: Evidence) -> Fitted:
    """Before anything is fitted to what was `felt`."""
    worlds = len(felt.mask)
    none = fit_superquadric(np.zeros((worlds, 1, 3)), np.zeros((worlds, 1), bool))
    return Fitted(none, felt, np.zeros(worlds, int), np.zeros(worlds, bool))


def newly_felt(news: list[Evidence], worlds: int) -> np.ndarray:
    """Worlds in which something was touched or a link swept free space, bool (world,)."""
    felt = np.zeros(worlds, bool)
    for evidence in news:
        felt |= evidence.mask.any(1) | evidence.free_mask.any(1)
    return felt


def refitted(
    last: Fitted, felt: Evidence, links: TouchedLinks | None, rows: np.ndarray,
    steps: np.ndarray, believed: np.ndarray, profile: Profile | None, table: FitTable
) -> Fitted:
    """Bodies of all worlds after a step in which the worlds `rows` felt something new.

    `felt` is all evidence, `links` those that may have been touched (None: contacts stay where they
    are felt), `steps` (world,) the number of this step, from 1, `believed` (world,) whether a body
    is to be gone on from, `profile` the contours followed.
    """
    by_pads = felt_by_pads(felt, rows)
    pads = by_pads.mask[:, last.placed.mask.shape[1]:].any(1)
    first = np.asarray(~(last.placed.mask & ~last.placed.by_pad).any(1))
    whole = np.asarray(pads | first)
    due = _renewals(steps) > _renewals(last.renewed_at)
    renewed = np.where(pads, ~believed, first | due | ~is_fitted(last.fits.status))
    turned = ~renewed & explained(profile, by_pads)
    renewed |= contradicted(last.fits, by_pads) & ~turned
    last = replace(
        last, placed=_widened(last.placed, felt), rough=with_rows(last.rough, rows, ~whole[rows]),
        renewed_at=with_rows(last.renewed_at, rows, np.where(
            renewed, steps, last.renewed_at)[rows]))
    for among, fit in (
            (renewed & whole, _begun), (renewed & ~whole, _refined_or_begun),
            (~renewed & turned, _refined), (~renewed & ~turned & pads, _refined_beside_rivals),
            (~renewed & ~turned & ~pads, refine_bodies)):
        last = _with_bodies(last, felt, links, rows[among[rows]], table, fit)
    return last


def finished(
    last: Fitted, felt: Evidence, links: TouchedLinks | None, table: FitTable
) -> tuple[Fitted, np.ndarray]:
    """Bodies at the end of episodes: those that are rough have new starts and rivals like those of
    a sequence that is fitted once. Also the worlds fitted, (row,)."""
    rows = np.flatnonzero(last.rough)
    if len(rows) == 0:
        return last, rows
    whole = recover_bodies(rows_of(felt, rows), rows_of(links, rows), table)
    found, where = nearer((last.fits[rows], rows_of(last.placed, rows)), whole)
    return Fitted(with_rows(last.fits, rows, found), with_rows(last.placed, rows, where),
                  last.renewed_at, np.zeros_like(last.rough)), rows


def straightened(
    last: Fitted, felt: Evidence, links: TouchedLinks | None, prior: BoundingCylinder,
    lost: np.ndarray, table: FitTable
) -> tuple[Fitted, np.ndarray]:
    """Bodies without taper and bend in those of the worlds `lost` (world,) whose body reaches
    beyond the prior, as a bottle's does that tapers to a needle; also these worlds, (row,)."""
    straight = replace(table, taper=False, bend=False)
    rows = np.flatnonzero(lost & is_fitted(last.fits.status) & reaches_beyond(last.fits, prior))
    if len(rows) == 0 or straight == table:
        return last, rows[:0]
    found, where = recover_bodies(rows_of(felt, rows), rows_of(links, rows), straight)
    return replace(last, fits=with_rows(last.fits, rows, found),
                   placed=with_rows(last.placed, rows, where)), rows


def _renewals(steps: np.ndarray) -> np.ndarray:
    """How often new starts are due up to a step, less a constant; the same in all worlds, so that
    they share calls of programs."""
    return np.floor(A_DOUBLING * np.log2(np.maximum(steps, 0.5)))


def _with_bodies(last: Fitted, felt: Evidence, links: TouchedLinks | None, rows: np.ndarray,
                 table: FitTable, fit: Callable) -> Fitted:
    if len(rows) == 0:
        return last
    found, where = fit(rows_of(felt, rows), rows_of(links, rows), table, last.fits[rows])
    put_rows(last.placed, rows, where)  # made in `refitted`, for nobody else so far
    return replace(last, fits=with_rows(last.fits, rows, found))


def _begun(felt: Evidence, links: TouchedLinks | None, table: FitTable, start: SuperquadricFit
           ) -> Bodies:
    return recover_bodies(felt, links, table)


def _refined_or_begun(felt: Evidence, links: TouchedLinks | None, table: FitTable,
                      start: SuperquadricFit) -> Bodies:
    """Refined bodies; of those that are doubted, those from rough new starts where they are nearer.
    """
    found, where = refine_bodies(felt, links, table, start)
    rows = np.flatnonzero(doubt(found, where) > RIVALS_FROM_M)
    if len(rows) == 0:
        return found, where
    rough = replace(table, rounds=min(table.rounds, ROUGH_ROUNDS), rivals=False)
    best, there = nearer(
        (found[rows], rows_of(where, rows)),
        recover_bodies(rows_of(felt, rows), rows_of(links, rows), rough))
    return with_rows(found, rows, best), with_rows(where, rows, there)


def _refined(felt: Evidence, links: TouchedLinks | None, table: FitTable, start: SuperquadricFit
             ) -> Bodies:
    return refine_bodies(felt, links, table, start, rounds=2, iterations=LAST_ITERATIONS)


def _refined_beside_rivals(felt: Evidence, links: TouchedLinks | None, table: FitTable,
                           start: SuperquadricFit) -> Bodies:
    return beside_rivals(*_refined(felt, links, table, start), felt, links, table)


def _widened(placed: Evidence, felt: Evidence) -> Evidence:
    """The evidence last placed, empty where more has been felt since; arrays of its own."""
    worlds, before = placed.mask.shape
    new = slice(before, None)
    free = min(FREE_BALLS, felt.free_m.shape[1])
    free_m = np.zeros((worlds, free, 3))
    free_mask = np.zeros((worlds, free), bool)
    kept = min(free, placed.free_m.shape[1])
    free_m[:, :kept], free_mask[:, :kept] = placed.free_m[:, :kept], placed.free_mask[:, :kept]
    return Evidence(
        np.concatenate([placed.points_m, felt.points_m[:, new]], 1),
        np.concatenate([placed.mask, np.zeros_like(felt.mask[:, new])], 1),
        np.concatenate([placed.covariance_m2, felt.covariance_m2[:, new]], 1),
        np.concatenate([placed.normals, felt.normals[:, new]], 1),
        free_m, felt.free_radius_m, free_mask, felt.by_pad.copy(),
        np.concatenate([placed.contradiction, felt.contradiction[:, new]], 1))
