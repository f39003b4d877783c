"""What pads have felt against what is believed: which bodies are worth fitting from scratch."""

from dataclasses import replace

import numpy as np

from fit.arrays import row_sums
from fit.superquadric.record import SuperquadricFit
from strategies.procedures.contour_shape import Profile
from strategies.recovery.body_distances import contour_distances
from strategies.recovery.choose_model import revolution_of
from strategies.recovery.evidence import Evidence
from strategies.recovery.misfit import DOUBTED_M, FARTHEST_M, touch_misfit

REGROWN = 1.5
"""A body is fitted from scratch when links have made this times as many contacts as when that was
last done."""
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
    return by_pads.mask.any(1) & (touch_misfit(fits, by_pads) > DOUBTED_M)


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
