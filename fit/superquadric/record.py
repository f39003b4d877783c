"""Options and result of superquadric fits."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fit.arrays import rows_of
from fit.fit_status import LEAST_FALL, Kind, Loss, check_word
from fit.option_checks import LEAST_RAD, MOST_WEIGHT, check_counts, check_flags, check_numbers

MIN_EXPONENT, MAX_EXPONENT = 0.1, 2.0
"""Bounds of e1 and e2."""


@dataclass(frozen=True)
class SuperquadricOptions:
    """Options of a fit; hashable. Raises ValueError for an unknown word, or a number out of range.
    """

    taper: bool = False
    """Linear taper Kx, Ky: 13 parameters."""
    bend: bool = False
    """Circular bend: two more parameters."""
    residual: Kind | None = None
    """See `fit.superquadric.field.residual`; None: solina, or volume_distance with taper."""
    loss: Loss = "none"
    """Robust loss of the residuals of points and normals; its scale is their median."""
    upright_starts: bool = False
    """Whether a fit with a table starts from upright boxes alone: half the starts, for bodies that
    are known to stand so."""
    screen_iterations: int = 4
    settle_iterations: int = 6
    """Iterations before weights and scales are fixed."""
    round_iterations: int = 4
    """Iterations between convergence tests."""
    iterations: int = 80
    """Maximum iterations after screening, in whole rounds; 0: a rough fit, `not_converged`."""
    least_fall: float = LEAST_FALL
    """A fit has converged when a round lowers its cost by less than this fraction."""
    sigma_floor_m: float = 1e-3
    """Standard deviation added to that of a contact along the normal [m]."""
    plane_weight: float = 1.0
    """Weight of the support plane relative to all points."""
    free_weight: float = 1.0
    """Weight of all free-space balls relative to all points."""
    normal_weight: float = 0.3
    """Weight of a normal's residual relative to that of its point, where the normal is exact."""
    normal_std_rad: float = 0.05
    """Standard deviation of given normals [rad], each way [est]: those of pads err by 0.02 to 0.04.
    A tangent plane is uncertain by this times its arm, see `residuals.arms_of_normals`."""
    upright_std_rad: float | None = 0.01
    """Standard deviation [rad] of the prior that one of the body's axes is vertical, relative to
    the noise of the residuals. Clear evidence of a tilt overrides it. None: no prior; without a
    table it is not used."""
    mean_exponent: float | None = 0.6
    """Mean (above 0.1) of the exponential prior on e1, which prefers flat ends to round ones if the
    touches do not determine. None: no prior."""
    prior: float = 0.1
    """Inverse standard deviation of the prior on the exponents' logits, the taper's arctanh and
    the bend, relative to the noise of the residuals; 0: no prior."""

    def __post_init__(self) -> None:
        if self.residual is not None:
            check_word("residual", self.residual, Kind)
        check_word("loss", self.loss, Loss)
        check_flags(self, "taper", "bend", "upright_starts")
        check_counts(self, screen_iterations=0, settle_iterations=0, round_iterations=1,
                     iterations=0)
        check_numbers(self, "least_fall", "sigma_floor_m", "normal_std_rad")
        check_numbers(self, "plane_weight", "free_weight", "normal_weight", "prior",
                      high=MOST_WEIGHT)
        if self.upright_std_rad is not None:
            check_numbers(self, "upright_std_rad", low=LEAST_RAD)
        if self.mean_exponent is not None:
            check_numbers(self, "mean_exponent", low=MIN_EXPONENT, above=True)


@dataclass(frozen=True)
class SuperquadricFit:
    """Fits, one per row; every field is finite for any status."""

    size_m: Float[np.ndarray, "fit 3"]
    """Half extents a1, a2, a3 [m]."""
    exponents: Float[np.ndarray, "fit 2"]
    """e1 along z, e2 across; a cylinder along z has e1 ~ 0.1, e2 ~ 1."""
    position_m: Float[np.ndarray, "fit 3"]
    """Centre [m], in the frame of the points."""
    quaternion_xyzw: Float[np.ndarray, "fit 4"]
    """Orientation, body to world."""
    taper: Float[np.ndarray, "fit 2"]
    """Kx, Ky in [-1, 1]."""
    bend: Float[np.ndarray, "fit 2"]
    """Curvature [1/m] and direction [rad]."""
    rms_m: Float[np.ndarray, " fit"]
    """Root mean square distance of the points to the surface, to first order [m]."""
    cost: Float[np.ndarray, " fit"]
    """Half the sum of squared residuals in the unit frame, evidence included."""
    iterations: Int[np.ndarray, " fit"]
    """Iterations after screening."""
    status: Int[np.ndarray, " fit"]
    """`FitStatus` of each fit."""
    n_points: Int[np.ndarray, " fit"]
    """Number of points used."""

    def __len__(self) -> int:
        return len(self.status)

    def __getitem__(self, index) -> "SuperquadricFit":
        """The fits `index`, a slice, mask, array or number."""
        return rows_of(self, np.atleast_1d(np.arange(len(self))[index]))
