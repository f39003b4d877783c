"""Options and result of fits of surfaces of revolution."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fit.fit_status import LEAST_FALL, Loss, Monotone, check_word
from fit.option_checks import (
    LEAST_RAD,
    MOST_WEIGHT,
    check_counts,
    check_flags,
    check_number,
    check_numbers,
)

STANDS = 0.9
"""Cosine of the angle between an axis and the vertical from which on a body stands on an end."""
MOST_NODES = 128.0
"""Of a contour: the fit of more takes minutes to compile."""


@dataclass(frozen=True)
class RevolutionOptions:
    """Options of a fit; hashable, as they name the compiled program.

    Raises ValueError for an unknown word or a number out of its range.
    """

    nodes: int = 8
    """Nodes of the contour, 2 to `MOST_NODES`, including both ends."""
    smoothing: float = 0.05
    """Weight of the contour's second differences relative to all touches."""
    monotone: Monotone = "none"
    """Whether radii may only fall or only rise with height."""
    loss: Loss = "cauchy"
    upright: bool = False
    """Start only from axes along the world's z; the fitted axis may tilt."""
    tilt_std_rad: float | None = None
    """Standard deviation of that tilt before anything is felt; any tilt is as likely if None."""
    plane_weight: float = 1.0
    screen_iterations: int = 6
    round_iterations: int = 8
    iterations: int = 80
    """Maximum number of iterations after screening, in whole rounds."""
    least_fall: float = LEAST_FALL
    """A fit has converged when a round lowers its cost by less than this fraction."""

    def __post_init__(self) -> None:
        check_counts(self, nodes=2, screen_iterations=0, round_iterations=1, iterations=0)
        check_number("nodes", self.nodes, low=2.0, high=MOST_NODES)
        check_flags(self, "upright")
        check_numbers(self, "least_fall")
        check_numbers(self, "smoothing", "plane_weight", high=MOST_WEIGHT)
        if self.tilt_std_rad is not None:
            check_numbers(self, "tilt_std_rad", low=LEAST_RAD)
        check_word("monotone", self.monotone, Monotone)
        check_word("loss", self.loss, Loss)


@dataclass(frozen=True)
class Middle:
    """What is known, before a fit, of points that the middles of axes lie near."""

    point_m: Float[np.ndarray, "fit 3"]
    """Its place along the axis does not count."""
    std_m: Float[np.ndarray, " fit"]
    """Of each coordinate across the axis; infinite where nothing is known. A set with a negative or
    NaN one, or with a point that is none, is `bad_points`."""

    def rows(self, index: np.ndarray) -> "Middle":
        """Those of the fits `index`."""
        return Middle(self.point_m[index], self.std_m[index])


@dataclass(frozen=True)
class RevolutionFit:
    """Surfaces of revolution, one per row; every field is finite for any status."""

    position_m: Float[np.ndarray, "fit 3"]
    """Lower end of the axis [m]."""
    axis: Float[np.ndarray, "fit 3"]
    """Unit direction of the axis with a positive z (else y, else x)."""
    height_m: Float[np.ndarray, " fit"]
    """Length along the axis [m]."""
    radius_m: Float[np.ndarray, "fit node"]
    """Radii at nodes evenly spaced from the lower end to the upper [m]."""
    volume_m3: Float[np.ndarray, " fit"]
    rms_m: Float[np.ndarray, " fit"]
    """Root mean square distance of the touches to the contour [m]."""
    cost: Float[np.ndarray, " fit"]
    radius_std_m: Float[np.ndarray, "fit node"]
    """Standard deviation of each radius [m], scaled by the residuals."""
    iterations: Int[np.ndarray, " fit"]
    status: Int[np.ndarray, " fit"]
    n_points: Int[np.ndarray, " fit"]

    def __len__(self) -> int:
        return len(self.status)
