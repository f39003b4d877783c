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
from strategies.foresight.surface_process import SurfaceProcess, matern
from strategies.planners.adaptive import OneAtATime
from strategies.planners.candidates import predicted_touches
from strategies.planners.register import planner, real_option
from strategies.recovery.belief import Belief
from warpgrasp.mechanism.arm_reach import travel_time

NOISE_M = 0.0015
"""Spread of one touch along the normal [est]."""
SPREADS = tuple(misfit_m / NOISE_M for misfit_m in (0.0005, 0.001, 0.002, 0.004, 0.008))
"""How far a body may truly lie off any superquadric, in units of the noise, tried by likelihood."""
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
            slopes = distance_slopes(belief.body, places)
            residual = np.nan_to_num(surface_distance(belief.body, felt)[0])
        residual = np.clip(residual, -FARTHEST_M, FARTHEST_M) / NOISE_M
        middle = places[:, -surface.shape[1]:].mean(1, keepdims=True)
        places = np.sqrt(3.0) / self.length_m * (places - middle)
        gain = np.zeros((worlds, candidates))
        first, second = felt.shape[1], felt.shape[1] + candidates * fingers
        for world in np.flatnonzero(free.any(1)):
            known = np.flatnonzero(belief.evidence.mask[world])
            poses_met = np.flatnonzero(found[world].any(1))
            if len(poses_met) == 0:
                continue
            own = np.clip(np.nan_to_num(prior[world] * slopes[world]), -0.2, 0.2) / NOISE_M
            process = SurfaceProcess(places[world], own, known, residual[world, known],
                                     SPREADS, UNFELT_M / NOISE_M)
            gain[world, poses_met] = NOISE_M * _falls(
                process, np.arange(first, second).reshape(candidates, fingers)[poses_met],
                found[world, poses_met], np.arange(second, places.shape[1]), weight[world])
        if self.per_second and self.last is not None:
            gain /= BASE_TIME_S + travel_time(belief.arm, belief.hand, self.last, poses)
        return gain


def _falls(process: SurfaceProcess, touches: np.ndarray, found: np.ndarray, surface: np.ndarray,
           weight: np.ndarray, across: type = np.float32) -> np.ndarray:
    """Of the mean standard deviation over places numbered `surface`, for each row of `touches`, in
    units of the noise.

    Single precision, `across`, serves for what each touch says of each place of the surface, which
    is most of the work; what is factored needs double.
    """
    flat = touches[found]
    told = process.told(np.concatenate([flat, surface]))
    of_touch, of_surface = told[:len(flat)], told[len(flat):]
    factor = np.linalg.cholesky(process.felt_together(touches, found, of_touch))
    places, slopes = process.places.astype(across), process.slopes.astype(across)
    shared = matern(places[flat], places[surface])
    shared *= across(process.spread**2)
    shared += slopes[flat] @ slopes[surface].T
    shared -= of_touch.astype(across) @ of_surface.astype(across).T
    by_pose = np.zeros((*touches.shape, len(surface)), across)
    by_pose[found] = shared
    explained = ((np.linalg.inv(factor).astype(across) @ by_pose) ** 2).sum(1)
    before = np.maximum(process.spread**2 + (process.slopes[surface]**2).sum(-1)
                        - (of_surface**2).sum(1), 0.0)
    fall = np.sqrt(before) - np.sqrt(np.maximum(before - explained, 0.0))
    return fall @ weight / max(weight.sum(), 1e-12)


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
