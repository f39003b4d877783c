"""An explorer that knows no shape: a Gaussian process over the distance to the surface.

After Dragiev, Toussaint and Gienger (2011), Gaussian process implicit surfaces for shape estimation
and grasping. The process' mean before any touch is the distance to the body believed; touches say
that the distance is zero. Its variance, which needs no mean, falls around every touch; the next
pose is the one whose predicted touches it is least sure of, taken together.
"""

import numpy as np

from strategies.planners.adaptive import OneAtATime
from strategies.planners.candidates import predicted_touches
from strategies.planners.register import planner
from strategies.recovery.belief import Belief

NOISE_M = 0.002
SPREAD_M = 0.01
"""Standard deviation of the surface before any touch [est]."""


@planner("gaussian-process", "the pose whose touches a Gaussian process surface is least sure of")
class SurfaceGaussianProcess(OneAtATime):
    """Greatest joint uncertainty, with a Matern 3/2 kernel."""

    def __init__(self, length_m: float = 0.03) -> None:
        """`length_m`: over which distances the surface is alike. Raises ValueError."""
        super().__init__()
        self.length_m = float(length_m)
        if not 1e-3 <= self.length_m <= 1.0:
            raise ValueError(f"length_m is {length_m!r}; should be from 0.001 to 1")

    def gain(self, belief: Belief, poses: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Entropy of the surface's distances at each pose's predicted touches, up to a constant."""
        points, found = predicted_touches(belief, poses, free)
        out = np.zeros(found.shape[:2])
        for world in range(belief.worlds):
            felt = belief.evidence.points_m[world][belief.evidence.mask[world]]
            near, flat = points[world], points[world].reshape(-1, 3)
            prior = self._kernel(near, near)
            if len(felt):
                known = self._kernel(felt, felt) + NOISE_M**2 * np.eye(len(felt))
                across = self._kernel(flat, felt)
                solved = np.linalg.solve(known, across.T).T
                shape = (*found.shape[1:], len(felt))
                prior = prior - np.einsum("cfn,cgn->cfg", across.reshape(shape),
                                          solved.reshape(shape))
            pair = found[world][:, :, None] & found[world][:, None]
            covariance = np.where(pair, prior, 0.0) / NOISE_M**2 + np.eye(found.shape[2])
            out[world] = 0.5 * np.linalg.slogdet(covariance)[1]
        return out

    def _kernel(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        apart = np.linalg.norm(a[..., :, None, :] - b[..., None, :, :], axis=-1)
        scaled = np.sqrt(3.0) * apart / self.length_m
        return SPREAD_M**2 * (1.0 + scaled) * np.exp(-scaled)
