"""How likely touches are about one mean or another: what chooses the body a free form stands about.

The marginal likelihood of a process (Rasmussen and Williams 2006, equation 2.30) weighs how near a
mean comes to the touches against how much it leaves to explain, the process's amplitude. All means
share places, kernel and noise: one eigendecomposition serves every mean and every amplitude.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh

from fit.implicit.known import KnownProcess, known_kernel, known_rows


def mean_evidence(
    points: Float[np.ndarray, "point 3"], normals: Float[np.ndarray, "point 3"],
    sigma_m: Float[np.ndarray, " point"], process: KnownProcess,
    means: Sequence[Callable[[np.ndarray], np.ndarray]], amplitudes_m: Sequence[float],
) -> Float[np.ndarray, "mean amplitude"]:
    """Logarithm of the likelihood of touches [m] of one body, with outward normals (NaN where not
    known) and deviations `sigma_m`, about each of the `means` (signed distances [m] at points
    (point, 3) [m]) for each amplitude in place of that of `process`.
    """
    at, away, noise, _ = known_rows(points, normals, sigma_m, process)
    deviation = np.sqrt(noise)
    ratio, turn = eigh(known_kernel(process, at, at) / deviation[:, None] / deviation
                       / process.amplitude_m**2)
    rest = np.array([(away - mean(at)) / deviation for mean in means]).reshape(-1, len(at)) @ turn
    spread = 1.0 + np.square(amplitudes_m)[:, None] * np.maximum(ratio, 0.0)
    return -0.5 * ((np.square(rest)[:, None] / spread + np.log(spread)).sum(2)
                   + np.log(2.0 * np.pi * noise).sum())
