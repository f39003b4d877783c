"""What is not known of the body that a process stands about, and what is left of it after touches.

A body that was fitted has errors of its own: where nothing was felt, the process stays at its mean,
as if that were known. With f = m + errors . b + g, where b are standard normal numbers and g is
the process, touches tell of b and g together (explicit basis functions, Rasmussen and Williams
2006, section 2.7, equation 2.42): beside the covariance of g stands that of what they leave open of
b.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from fit.implicit.known import KnownProcess, known_kernel
from fit.implicit.record import ImplicitFit

MeanErrors = Callable[[Float[np.ndarray, "row point 3"], Int[np.ndarray, " row"]],
                      Float[np.ndarray, "row point error"]]
"""By how much one standard deviation of each error of the bodies of the fits of given numbers,
before any touch, changes signed distances at points [m] of each."""


def errors_left(
    fits: ImplicitFit, errors: MeanErrors, at_m: Float[np.ndarray, "fit point 3"]
) -> Float[np.ndarray, "fit point error"]:
    """By how much each of as many independent standard normal errors, what touches leave of those
    of the mean, changes distances at points [m]: all of them, where there are no touches. NaN for a
    fit of which a number is none."""
    if len(fits) == 0:
        return errors(at_m, np.zeros(0, int))
    return np.stack([_left(fits, row, errors, at_m[row]) for row in range(len(fits))])


def _left(fits: ImplicitFit, row: int, errors: MeanErrors, at_m: np.ndarray) -> np.ndarray:
    own = np.array([row])
    used = fits.noise_m2[row] >= 0.0
    rows_m = fits.points_m[row][used]
    before = errors(at_m[None], own)[0]
    if not used.any():
        return before
    process = KnownProcess(fits.length_m[row], fits.amplitude_m[row])
    factor = cho_factor(known_kernel(process, rows_m, rows_m) + np.diag(fits.noise_m2[row][used]),
                        lower=True)
    known = errors(rows_m[None], own)[0]
    if not (np.isfinite(known).all() and np.isfinite(before).all()):
        return np.full_like(before, np.nan)
    solved = cho_solve(factor, known)
    information = np.eye(known.shape[1]) + known.T @ solved
    beyond = before - known_kernel(process, at_m, rows_m) @ solved
    return solve_triangular(cholesky(information, lower=True), beyond.T, lower=True).T
