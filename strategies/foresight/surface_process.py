"""How far the true surface lies off the body believed, as a Gaussian process given touches.

A part of the distance is what a change of the body's parameters explains, by its slopes; the rest
is a Matern 3/2 process. All is in units of the noise of one touch, so that a touch adds the
identity, and of one world.
"""

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.spatial.distance import cdist

_cholesky, _solve, _invert = get_lapack_funcs(("potrf", "trtrs", "trtri"), dtype=float)


class SurfaceProcess:
    """The process given the touches at places `known`."""

    def __init__(self, places: np.ndarray, slopes: np.ndarray, known: np.ndarray,
                 residual: np.ndarray, spreads: tuple[float, ...], unfelt: float) -> None:
        """`places` (place, 3) are in units of the length over sqrt 3, `slopes` (place, parameter)
        per standard deviation of the parameters; `known` are numbers of places and `residual` what
        was felt there. The standard deviation of the Matern part is the one of `spreads` with the
        greatest marginal likelihood (Rasmussen and Williams 2006, equation 5.8); `unfelt` before
        any touch."""
        self.places, self.slopes, self.known = places, slopes, known
        self.spread, self.whiten = unfelt, np.zeros((0, 0))
        if len(known) == 0:
            return
        alike = matern(places[known], places[known])
        shared = slopes[known] @ slopes[known].T
        shared.flat[::len(known) + 1] += 1.0
        factors = [_cholesky(spread**2 * alike + shared, lower=1)[0] for spread in spreads]
        white = [_solve(factor, residual, lower=1)[0] for factor in factors]
        likely = [-0.5 * w @ w - np.log(factor.diagonal()).sum()
                  for w, factor in zip(white, factors, strict=True)]
        best = int(np.argmax(likely))
        self.spread, self.whiten = spreads[best], _invert(factors[best], lower=1)[0]

    def told(self, at: np.ndarray) -> np.ndarray:
        """What the touches tell of places numbered `at`, (at, known): products of rows are by how
        much covariances fall."""
        prior = matern(self.places[at], self.places[self.known])
        prior *= self.spread**2
        prior += self.slopes[at] @ self.slopes[self.known].T
        return prior @ self.whiten.T

    def felt_together(self, touches: np.ndarray, found: np.ndarray, told: np.ndarray) -> np.ndarray:
        """Covariance (pose, finger, finger) of what poses will feel, noise included, at places
        numbered `touches` (pose, finger), where `found`; `told` is of these, (touch, known). The
        others are noise."""
        places, slopes = self.places[touches], self.slopes[touches]
        by_pose = np.zeros((*touches.shape, len(self.known)))
        by_pose[found] = told
        apart = np.sqrt(sum((own[:, :, None] - own[:, None]) ** 2
                            for own in np.moveaxis(places, -1, 0)))
        covariance = (self.spread**2 * (1.0 + apart) * np.exp(-apart)
                      + slopes @ np.swapaxes(slopes, 1, 2)
                      - by_pose @ np.swapaxes(by_pose, 1, 2))
        return covariance * (found[:, :, None] & found[:, None]) + np.eye(touches.shape[1])


def matern(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Matern 3/2 correlation of places (n, 3) and (m, 3), in units of the length over sqrt 3, in
    their precision."""
    apart = cdist(one, other) if one.dtype == float else _rough_distance(one, other)
    alike = np.exp(-apart)
    apart += 1.0
    alike *= apart
    return alike


def _rough_distance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """By a matrix product, which single precision makes faster than `cdist`."""
    square = -2.0 * one @ other.T
    square += (one**2).sum(-1)[:, None]
    square += (other**2).sum(-1)
    return np.sqrt(np.maximum(square, 0.0, out=square), out=square)
