"""What pads felt contradicts a body, or is explained by a contour; when bodies have new starts."""

from dataclasses import replace

import numpy as np
from beliefs import BODY, belief, on_side

from fit.superquadric.fit import fit_superquadric
from strategies.procedures.contour_shape import Profile
from strategies.recovery.evidence import Evidence
from strategies.recovery.misfit import touch_misfit
from strategies.recovery.refit_policy import (
    FEWEST_EXPLAINED,
    Fitted,
    _renewals,
    contradicted,
    explained,
    felt_by_pads,
    finished,
    straightened,
)
from warpgrasp.parameters import FitTable

ROUND = on_side(0, 360)


def by_pads(points: np.ndarray) -> Evidence:
    """All of the points were felt by pads."""
    evidence = belief(points).evidence
    return felt_by_pads(replace(evidence, by_pad=evidence.mask), np.arange(2))


def outwards(points: np.ndarray, by_m: float) -> np.ndarray:
    """The points of the second world, moved away from the cylinder's axis."""
    way = (points - BODY.position_m[:, None]) * [1.0, 1.0, 0.0]
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    return points + np.array([0.0, by_m])[:, None, None] * way


def contours() -> Profile:
    """The contours of the believed cylinders, followed all the way."""
    zero = np.zeros(2)
    foot = BODY.position_m * [1.0, 1.0, 0.0]
    return Profile(foot, np.tile([0.0, 0.0, 1.0], (2, 1)), np.tile([0.0, 0.14], (2, 1)),
                   np.full((2, 2), 0.035), zero, zero, zero, zero, None)  # pyright: ignore


def test_pads_contradict_a_body_they_touch_far_from() -> None:
    fits = fit_superquadric(ROUND, table_z=0.0)
    assert not contradicted(fits, by_pads(ROUND)).any()
    far = outwards(ROUND, 0.004)
    assert contradicted(fits, by_pads(far)).tolist() == [False, True]
    # Tendons know the place less well: what they felt contradicts nothing.
    assert not contradicted(fits, felt_by_pads(belief(far).evidence, np.arange(2))).any()


def test_a_contour_explains_what_pads_felt_along_it() -> None:
    assert explained(contours(), by_pads(outwards(ROUND, 0.003))).tolist() == [True, False]
    assert not explained(contours(), felt_by_pads(belief(ROUND).evidence, np.arange(2))).any()
    assert not explained(contours(), by_pads(ROUND[:, :FEWEST_EXPLAINED - 1])).any()
    assert not explained(None, by_pads(ROUND)).any()


def test_only_worlds_that_are_asked_for_take_part() -> None:
    evidence = belief(ROUND).evidence
    some = felt_by_pads(replace(evidence, by_pad=evidence.mask), np.array([1]))
    assert some.mask.any(1).tolist() == [False, True]


def test_new_starts_are_due_twice_while_steps_double() -> None:
    steps = np.arange(1, 33)
    due = _renewals(steps[1:]) > _renewals(steps[:-1])
    assert steps[1:][due].tolist() == [2, 3, 4, 6, 8, 12, 16, 23, 32]


def test_the_end_fits_rough_bodies_and_no_others() -> None:
    evidence = belief(ROUND).evidence
    good = fit_superquadric(evidence.points_m, evidence.mask, table_z=0.0)
    fits = replace(good, size_m=1.3 * good.size_m)
    last = Fitted(fits, evidence, np.zeros(2, int), np.array([False, True]))
    after, rows = finished(last, evidence, None, FitTable())
    assert rows.tolist() == [1]
    assert not after.rough.any()
    assert np.array_equal(after.fits.size_m[0], fits.size_m[0])
    assert touch_misfit(after.fits, after.placed)[1] < 0.5 * touch_misfit(fits, evidence)[1]
    again, rows = finished(after, evidence, None, FitTable())
    assert len(rows) == 0
    assert again is after


def test_a_body_that_tapers_far_beyond_the_prior_gives_way_to_a_straight_one() -> None:
    believed = belief(ROUND)
    straight = fit_superquadric(believed.evidence.points_m, believed.evidence.mask, table_z=0.0)
    high = believed.prior.height_m + 0.1
    needle = replace(straight, size_m=np.column_stack([straight.size_m[:, :2], high]),
                     position_m=straight.position_m * [1.0, 1.0, 0.0] + high[:, None] * [0, 0, 1],
                     taper=np.full((2, 2), -1.0))
    for fits, lost, table, rows in (
            (needle, [True, False], FitTable(), [0]), (straight, [True, True], FitTable(), []),
            (needle, [True, True], FitTable(taper=False), [])):
        last = Fitted(fits, believed.evidence, np.zeros(2, int), np.zeros(2, bool))
        after, found = straightened(last, believed.evidence, None, believed.prior, np.array(lost),
                                    table)
        assert found.tolist() == rows
        for world in (0, 1):
            if world in rows:
                assert (after.fits.taper[world] == 0.0).all()
                assert touch_misfit(after.fits, after.placed)[world] < 0.001
            else:
                assert (after.fits.size_m[world] == fits.size_m[world]).all()
