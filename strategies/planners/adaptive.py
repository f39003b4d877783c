"""Strategies that choose their next hand pose by what was felt.

All choose among the same candidates (`candidates`), one pose a step and world, until the budget is
spent; `gaussian-process` does so unless a free form may stand for the body. They differ in the gain
that they expect of a pose. The plain ones beside them are in `unguided`.
"""

from abc import ABC, abstractmethod

import numpy as np
from scipy.spatial.distance import cdist

from fit.superquadric.uncertainty import distance_slopes, surface_std
from strategies.foresight.surface_process import SurfaceProcess
from strategies.planners.any_object import FreeFormSearch
from strategies.planners.candidates import candidate_poses, predicted_touches
from strategies.planners.prior_body import planning_belief
from strategies.planners.probes import Grasp, Probe
from strategies.planners.register import planner, real_option
from strategies.planners.unguided import far_from_taken
from strategies.recovery.belief import Belief

NEW_AT_M = 0.03
"""A touch this far from all others is as new as can be."""
BARRED_M, EMPTY_M = 0.006, 0.010
"""An object where the hand struck something is taken to be this much larger than before; one where
most fingers closed on nothing, this much smaller [est]."""
POOR = 0.4
"""Share of contacts among the closings below which most closed on nothing."""
FORGETS = 0.7
"""What is kept of that after a pose that went well [est]."""
TOUCH_SIGMA_M = 0.0015
"""Spread of one touch along the normal, as an adaptive strategy reckons [est]."""
FIELD_NOISE_M = 0.002
"""The same where a Gaussian process stands for the surface [est]."""
FIELD_SPREAD_M = 0.01
"""Standard deviation of such a surface before any touch [est]."""


class OneAtATime(ABC):
    """Base of these planners: the candidate of the greatest gain that was not taken yet; where none
    promises any, the one farthest from those taken."""

    def __init__(self) -> None:
        self.taken: np.ndarray | None = None
        self.last: np.ndarray | None = None
        """Where the hand is in the worlds that are looked at, (row, 1, 7)."""
        self.larger_m = np.zeros(0)
        """By how much the object is taken to be larger than believed, (world,)."""
        self._before: tuple[np.ndarray, np.ndarray] | None = None
        self._stood: np.ndarray | None = None
        """Where it is in all worlds, (world, 1, 7)."""

    def __call__(self, belief: Belief) -> list[Probe]:
        """One grasp in every world that has a candidate left."""
        self._learn(belief)
        rows = np.flatnonzero(belief.active)  # what others believe is not asked for
        here = belief.of(rows)
        self.last = None if self._stood is None else self._stood[rows]
        poses, reachable, here = self._candidates(here, rows)
        if self.taken is None:
            self.taken = np.zeros((belief.worlds, poses.shape[1]), bool)
        free = reachable & ~self.taken[rows] & here.active[:, None]
        gain = np.where(free, self.gain(here, poses, free), -np.inf)
        blind = np.flatnonzero(free.any(1) & ~(gain.max(1, initial=-np.inf) > 0.0))
        gain[blind] = np.where(free[blind], far_from_taken(
            poses[blind], self.taken[rows[blind]]), -np.inf)
        best = gain.argmax(1)
        every = np.arange(len(rows))
        wanted = np.zeros(belief.worlds, bool)
        wanted[rows] = np.isfinite(gain[every, best])
        chosen = np.zeros((belief.worlds, 7)) if self._stood is None else self._stood[:, 0].copy()
        chosen[rows] = poses[every, best]
        self.taken[rows, best] |= wanted[rows]
        self.taken[~wanted] = True  # alone, its episode would have ended
        self._stood = chosen[:, None]
        return [Grasp(chosen[:, None], wanted[:, None])]

    def _candidates(self, belief: Belief, rows: np.ndarray
                    ) -> tuple[np.ndarray, np.ndarray, Belief]:
        """Poses of the worlds `rows`, (row, candidate, 7), whether the arm reaches them, and the
        belief to judge them by."""
        larger = np.asarray(self.larger_m)[rows]
        belief, trusted = planning_belief(belief, larger)
        return *candidate_poses(belief, margin_m=np.where(trusted, larger, 0.0)), belief

    def _learn(self, belief: Belief) -> None:
        """How the last pose went says whether the object is larger or smaller than believed."""
        contacts = belief.evidence.mask.sum(1)
        if self._before is None:
            self.larger_m = np.zeros(belief.worlds)
        else:
            closed, felt = belief.touches - self._before[0], contacts - self._before[1]
            larger = np.where(closed == 0, self.larger_m + BARRED_M, np.where(
                felt < POOR * closed, self.larger_m - EMPTY_M, FORGETS * self.larger_m))
            margin = belief.prior.margin_m
            # One that was never met is looked for at all smaller sizes in turn.
            larger = np.where((contacts == 0) & (self.larger_m <= -margin), 0.0, larger)
            self.larger_m = np.clip(larger, -margin, margin)
        self._before = belief.touches.copy(), contacts

    @abstractmethod
    def gain(self, belief: Belief, poses: np.ndarray, free: np.ndarray) -> np.ndarray:
        """What each pose is worth, (world, candidate); only `free` ones count."""


@planner("coverage", "greedy coverage: the pose whose predicted touches are farthest from all felt")
class GreedyCoverage(OneAtATime):
    """Touch where there is no contact yet."""

    def gain(self, belief: Belief, poses: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Sum over a pose's predicted touches of the distance to the nearest touch, up to a cap."""
        points, found = predicted_touches(belief, poses, free)
        evidence = belief.evidence
        near = np.where(found, NEW_AT_M, 0.0)
        for world in np.flatnonzero(evidence.mask.any(1)):
            felt = evidence.points_m[world, evidence.mask[world]]
            apart = cdist(points[world, found[world]], felt).min(1)
            near[world, found[world]] = np.minimum(apart, NEW_AT_M)
        return near.sum(-1)


@planner("most-uncertain", "the pose that touches where the fitted surface is least certain")
class MostUncertain(OneAtATime):
    """Touch where the covariance of the fit leaves the surface most in doubt."""

    def gain(self, belief: Belief, poses: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Sum of the variances of the surface at a pose's predicted touches."""
        points, found = predicted_touches(belief, poses, free)
        flat = points.reshape(belief.worlds, -1, 3)
        with np.errstate(all="ignore"):
            std = surface_std(belief.body, belief.parameter_uncertainty, flat)
        std = np.where(np.isfinite(std), np.minimum(std, NEW_AT_M), 0.0).reshape(found.shape)
        return (std**2 * found).sum(-1)


@planner("information", "the pose of greatest expected information about the parameters "
                        "(D-optimal)")
class MostInformation(OneAtATime):
    """Expected information gain of a linear-Gaussian model, log det(I + J C J' / s^2)."""

    def gain(self, belief: Belief, poses: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Half the log determinant over a pose's predicted touches (Chaloner and Verdinelli 1995,
        Bayesian experimental design: a review)."""
        points, found = predicted_touches(belief, poses, free)
        worlds, candidates, fingers = found.shape
        with np.errstate(all="ignore"):
            slopes = distance_slopes(belief.body, points.reshape(worlds, -1, 3))
        slopes = np.where(np.isfinite(slopes) & found.reshape(worlds, -1, 1), slopes, 0.0)
        spread = slopes @ belief.parameter_uncertainty.covariance / TOUCH_SIGMA_M**2
        met = found.any(-1)
        one, other = (v.reshape(worlds, candidates, fingers, 15)[met] for v in (slopes, spread))
        gain = np.zeros((worlds, candidates))
        # No Cholesky factor, which would fail in all worlds for the covariance of one.
        with np.errstate(all="ignore"):
            gain[met] = 0.5 * np.linalg.slogdet(
                np.eye(fingers) + other @ np.swapaxes(one, 1, 2))[1]
        return gain


@planner("gaussian-process", "the pose whose touches a Gaussian process surface is least sure of")
class SurfaceGaussianProcess(OneAtATime):
    """An explorer that knows no shape: a Gaussian process over the distance to the surface.

    After Dragiev, Toussaint and Gienger (2011), Gaussian process implicit surfaces for shape
    estimation and grasping. The process' mean before any touch is the distance to the body
    believed; touches say that the distance is zero. Its variance, which needs no mean, falls around
    every touch; the next pose is the one whose predicted touches it is least sure of, taken
    together. Its kernel is a Matern 3/2.

    Where a free form may stand for the body (`[fit] reconstruct`), it plans with the free form that
    the touches make, whose length scale is its own: poses are drawn as those of `any-object`, and
    fingers go where its surface may be and is least sure.
    """

    def __init__(self, length_m: float = 0.03) -> None:
        """`length_m`: over which distances the surface is alike. Raises ValueError."""
        super().__init__()
        self.length_m = real_option("length_m", length_m, 0.001, 1.0)
        self.search = FreeFormSearch()

    def __call__(self, belief: Belief) -> list[Probe]:
        """One grasp about the model, or a few about a free form."""
        return self.search(belief) if belief.fit.free_forms else super().__call__(belief)

    def gain(self, belief: Belief, poses: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Entropy of the surface's distances at each pose's predicted touches, up to a constant."""
        points, found = predicted_touches(belief, poses, free)
        worlds, candidates, fingers = found.shape
        felt = belief.evidence.points_m
        places = np.sqrt(3.0) / self.length_m * np.concatenate(
            [felt, points.reshape(worlds, -1, 3)], 1)
        touches = felt.shape[1] + np.arange(candidates * fingers).reshape(candidates, fingers)
        spread = FIELD_SPREAD_M / FIELD_NOISE_M
        out = np.zeros((worlds, candidates))
        for world in np.flatnonzero(free.any(1)):
            known = np.flatnonzero(belief.evidence.mask[world])
            process = SurfaceProcess(places[world], np.zeros((places.shape[1], 0)), known,
                                     np.zeros(len(known)), (spread,), spread)
            together = process.felt_together(touches, found[world],
                                             process.told(touches[found[world]]))
            factor = np.linalg.cholesky(together)
            out[world] = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(1)
        return out
