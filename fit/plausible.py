"""Numbers that can have been measured; others would overflow where they are squared."""

import numpy as np

FARTHEST_M = 1e12


def plausible(values: np.ndarray) -> np.ndarray:
    """Which lengths [m], or covariances [m^2], are neither NaN nor beyond `FARTHEST_M`."""
    return np.abs(values) <= FARTHEST_M
