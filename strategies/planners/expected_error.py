"""Where the next grasp will lower the expected error of the recovered surface the most.

The signed distance between the true surface and the body believed is taken as a Gaussian process: a
part that a change of the body's parameters explains (its slopes, with a wide prior), and a part
that no superquadric can (a Matern 3/2 kernel), as large as the residuals of the touches indicate by
their marginal likelihood. Touches say what it is at places; so do those that a pose is predicted to
make. The gain of a pose is by how much they lower the mean over the surface of the standard
deviation, to which the mean distance between the surfaces is proportional. In the language of
experimental design it is I-optimal (Cohn, Ghahramani and Jordan 1996, Active learning with
statistical models);
the parametric part alone would be blind to what the body believed cannot be, the other alone to
what is known of a whole side from a few touches of it.
"""

import numpy as np

from fit.rotation import matrix_of_quaternion
from fit.superquadric.geometry import Superquadric, superquadric_areas
from fit.superquadric.uncertainty import distance_slopes, surface_distance
from strategies.planners.adaptive import OneAtATime
from strategies.planners.candidates import predicted_touches
from strategies.planners.register import planner, real_option
from strategies.recovery.belief import Belief
from warpgrasp.mechanism.arm_reach import travel_time

NOISE_M = 0.0015
"""Spread of one touch along the normal [est]."""
MISFITS_M = (0.0005, 0.001, 0.002, 0.004, 0.008)
"""How far a body may truly lie off any superquadric, tried by likelihood."""
UNFELT_M = 0.004
"""The same before any touch [est]."""
FARTHEST_M = 0.015
"""A residual larger than this counts as this large."""
SURFACE_POINTS = 216
TABLE_M = 0.008
"""What lies lower is known to be the foot."""
BASE_TIME_S = 3.0
"""Of a grasp without the travel to it [est]."""


@planner("expected-error", "the pose that lowers the expected error of the whole surface most")
class ExpectedError(OneAtATime):
    """I-optimal design under a superquadric and what it cannot explain."""

    def __init__(self, length_m: float = 0.03, per_second: bool = False) -> None:
        """`length_m`: over which distances what no superquadric explains is alike; `per_second`:
        the gain is divided by the time that the pose will cost, but for the first pose, when where
        the hand comes from is not known. Raises ValueError."""
        super().__init__()
        self.length_m = real_option("length_m", length_m, 0.001, 1.0)
        if not isinstance(per_second, bool):
            raise ValueError(f"per_second is {per_second!r}; should be true or false")
        self.per_second = per_second

    def gain(self, belief: Belief, poses: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Expected fall of the mean standard deviation [m], (world, candidate)."""
        points, found = predicted_touches(belief, poses, free)
        surface, area = superquadric_areas(belief.body, SURFACE_POINTS)
        weight = area * (surface[..., 2] > TABLE_M)
        felt = belief.evidence.points_m
        worlds, candidates, fingers = found.shape
        places = np.concatenate([felt, points.reshape(worlds, -1, 3), surface], 1)
        prior = parameter_prior(belief.body)
        with np.errstate(all="ignore"):
            slopes = np.nan_to_num(distance_slopes(Superquadric(*belief.body), places, prior))
            residual = np.nan_to_num(surface_distance(belief.body, felt)[0])
        slopes = np.clip(slopes, -0.2, 0.2)
        residual = np.clip(residual, -FARTHEST_M, FARTHEST_M)
        gain = np.zeros((worlds, candidates))
        first, second = felt.shape[1], felt.shape[1] + candidates * fingers
        for world in np.flatnonzero(free.any(1)):
            known = np.flatnonzero(belief.evidence.mask[world])
            poses_met = np.flatnonzero(found[world].any(1))
            if len(poses_met) == 0:
                continue
            field = _Field(places[world], slopes[world], self.length_m,
                           known, residual[world, known])
            gain[world, poses_met] = field.falls(
                np.arange(first, second).reshape(candidates, fingers)[poses_met],
                found[world, poses_met], np.arange(second, places.shape[1]), weight[world])
        if self.per_second and self.last is not None:
            gain /= BASE_TIME_S + travel_time(belief.arm, belief.hand, self.last, poses)
        return gain


class _Field:
    """One world's distances between the true surface and the body believed, given touches.

    In units of the noise of one touch. Single precision serves for what each touch says of each
    place of the surface, which is most of the work; what is factored needs double.
    """

    def __init__(self, places: np.ndarray, slopes: np.ndarray, length: float,
                 known: np.ndarray, residual: np.ndarray, across: type = np.float32) -> None:
        """`across` is the precision of what touches say of the surface."""
        self.across = across
        self.places = np.sqrt(3.0) / length * (places - places[-SURFACE_POINTS:].mean(0))
        self.slopes = slopes / NOISE_M
        self.known = known
        self.misfit, self.whiten = UNFELT_M, np.zeros((0, 0))
        if len(known):
            alike = _matern(self.places[known], self.places[known])
            shared = self.slopes[known] @ self.slopes[known].T + np.eye(len(known))
            factors = np.linalg.cholesky(
                (np.array(MISFITS_M) / NOISE_M)[:, None, None] ** 2 * alike + shared)
            white = np.linalg.solve(factors, residual[:, None] / NOISE_M)[..., 0]
            scale = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(1)
            best = int(np.argmax(-0.5 * (white**2).sum(1) - scale))
            self.misfit = MISFITS_M[best]
            self.whiten = np.linalg.inv(factors[best])

    def _prior(self, one: np.ndarray, other: np.ndarray, dtype: type = float) -> np.ndarray:
        """Covariance (..., n, m) before any touch, of places numbered `one` and `other`."""
        places, slopes = self.places.astype(dtype), self.slopes.astype(dtype)
        alike = _matern(places[one], places[other])
        alike *= dtype((self.misfit / NOISE_M) ** 2)
        alike += slopes[one] @ np.swapaxes(slopes[other], -1, -2)
        return alike

    def falls(self, touches: np.ndarray, found: np.ndarray, surface: np.ndarray,
              weight: np.ndarray) -> np.ndarray:
        """Of the mean standard deviation over `surface` [m], for each row of `touches`."""
        flat = touches[found]
        to_touch = self.whiten @ self._prior(self.known, flat)
        to_surface = self.whiten @ self._prior(self.known, surface)
        by_pose = np.zeros((*touches.shape, len(self.known)))
        by_pose[found] = to_touch.T
        within = self._prior(touches, touches) - by_pose @ np.swapaxes(by_pose, -1, -2)
        within = within * (found[:, :, None] & found[:, None]) + np.eye(touches.shape[1])
        across = np.zeros((*touches.shape, len(surface)), self.across)
        across[found] = self._prior(flat, surface, self.across) - (
            to_touch.T.astype(self.across) @ to_surface.astype(self.across))
        white = np.linalg.inv(np.linalg.cholesky(within)).astype(self.across)
        explained = ((white @ across) ** 2).sum(1)
        before = np.maximum((self.misfit / NOISE_M) ** 2 + (self.slopes[surface]**2).sum(-1)
                            - (to_surface**2).sum(0), 0.0)
        fall = np.sqrt(before) - np.sqrt(np.maximum(before - explained, 0.0))
        return NOISE_M * (fall @ weight) / max(weight.sum(), 1e-12)


def _matern(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Matern 3/2 correlation of places (..., n, 3) and (..., m, 3), in units of length / sqrt 3."""
    square = ((one**2).sum(-1)[..., :, None] + (other**2).sum(-1)[..., None, :]
              - 2.0 * one @ np.swapaxes(other, -1, -2))
    apart = np.sqrt(np.maximum(square, 0.0, out=square), out=square)
    return (1.0 + apart) * np.exp(-apart)


def parameter_prior(body: Superquadric) -> np.ndarray:
    """Standard deviations of the tangent `fit.superquadric.slopes.TANGENT` before any touch,
    (world, 15), of a body that stands on the table near the prior place [est]."""
    axes = matrix_of_quaternion(body.quaternion_xyzw)
    upright = np.abs(axes[:, 2]).argmax(1)
    one = np.ones(len(axes))
    turns = np.where(np.arange(3) == upright[:, None], 0.5, 0.02)
    taper = 0.4 * (upright == 2)
    return np.stack([0.3 * one, 0.3 * one, 0.3 * one, 0.4 * one, 0.4 * one, *turns.T,
                     0.02 * one, 0.02 * one, 0.02 * one, taper, taper, 0 * one, 0 * one], axis=1)
