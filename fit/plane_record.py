"""Planes in rows; apart from `plane`, so that who writes them down need not load JAX."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class PlaneFit:
    """Planes n.x = offset, one per row; every field is finite for any status but the
    covariance of three touches."""

    normal: Float[np.ndarray, "fit 3"]
    """Unit normal with a positive z (else y, else x)."""
    offset_m: Float[np.ndarray, " fit"]
    """Distance from the origin along the normal [m]."""
    centre_m: Float[np.ndarray, "fit 3"]
    """Middle of the touches on the plane [m]."""
    axes: Float[np.ndarray, "fit 2 3"]
    """Directions u, v in the plane; u has the largest scatter."""
    extent_m: Float[np.ndarray, "fit 2"]
    """Full extent of the touches on the plane along u and v [m]."""
    rms_m: Float[np.ndarray, " fit"]
    """Weighted root mean square distance [m]."""
    covariance: Float[np.ndarray, "fit 3 3"]
    """Of rotation about u and v [rad], and displacement along the normal at the centre [m]: 1.645
    standard deviations hold 90 %, however few touches tell them. Infinite displacement where three
    touches tell no deviation."""
    weight: Float[np.ndarray, "fit point"]
    """Weight of each touch, from 0 (outlier or masked) to 1."""
    status: Int[np.ndarray, " fit"]
    """`FitStatus` of each fit."""
    n_points: Int[np.ndarray, " fit"]
    """Number of points used."""
