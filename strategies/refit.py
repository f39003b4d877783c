"""What pads have felt, held against what is believed: which bodies are worth fitting from scratch.
"""

from dataclasses import replace

import numpy as np

from fit.superquadric import SuperquadricFit
from strategies.contour_profile import Profile
from strategies.evidence import Evidence
from strategies.recovered import distance_felt, revolution_of
from strategies.rivals import DOUBTED_M, FARTHEST_M, touch_misfit

REGROWN = 1.5
"""A body is fitted from scratch when links have made this times as many contacts as when that was
last done."""
EXPLAINED_M = 0.001
"""Mean distance of pads' touches from a contour that explains them [est]."""
FEWEST_EXPLAINED = 8
"""Fewer touches do not show that a contour explains them."""


def contradicted(fits: SuperquadricFit, felt: Evidence) -> np.ndarray:
    """Where pads have felt something far from the body last fitted, bool (world,)."""
    by_pad = felt.mask & felt.by_pad
    return by_pad.any(1) & (touch_misfit(fits, replace(felt, mask=by_pad)) > DOUBTED_M)


def explained(profile: Profile | None, felt: Evidence) -> np.ndarray:
    """Where a contour lies near all that pads have felt, bool (world,).

    It will stand for the body then (`strategies.recovered.choose_body`): of what no superquadric
    is, a better superquadric is not worth a fit from scratch, nor a rival's.
    """
    by_pad = felt.mask & felt.by_pad
    if profile is None:
        return np.zeros(len(by_pad), bool)
    away = np.minimum(distance_felt(revolution_of(profile), felt.points_m, by_pad), FARTHEST_M)
    count = by_pad.sum(1)
    mean = np.where(by_pad, away, 0.0).sum(1) / np.maximum(count, 1)
    return (count >= FEWEST_EXPLAINED) & (mean < EXPLAINED_M)
