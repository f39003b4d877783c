"""What a superquadric fit is asked, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fit.arrays import rows_of
from fit.fit_status import LEAST_FALL, Kind, Loss, check_word


@dataclass(frozen=True)
class SuperquadricOptions:
    """How to fit; hashable, for it names the compiled program. ValueError for an unknown word."""

    taper: bool = False
    """Linear taper Kx, Ky: 13 parameters."""
    bend: bool = False
    """Circular bend: two parameters more."""
    residual: Kind | None = None
    """See `superquadric_field.residual`; None: solina, or volume_distance with a taper."""
    loss: Loss = "none"
    """Robust loss of the points' (and normals') residuals, its scale from their median."""
    screen_iterations: int = 4
    settle_iterations: int = 6
    """Iterations after which weights and scales are set for good."""
    round_iterations: int = 4
    """Iterations between two looks at which fits are done."""
    iterations: int = 80
    """Most iterations of the finish, in whole rounds; 0: a rough fit, `not_converged`."""
    least_fall: float = LEAST_FALL
    """A fit has converged when a round lowers its cost by less than this share."""
    sigma_floor_m: float = 1e-3
    """Standard deviation added to a contact's covariance along the normal [m]."""
    plane_weight: float = 1.0
    """Weight of the support plane, as so many times all the points together."""
    free_weight: float = 1.0
    """Weight of all the free balls together, against all the points."""
    normal_weight: float = 0.3
    """Weight of a normal's tangent-plane residual against its point's."""
    upright_std_rad: float | None = 0.01
    """Standard deviation of the tilt of a body that stands on a table, on whichever of its three
    axes [rad], against the noise that the residuals show. Touches that clearly say that it leans
    win; None: it may lie as it likes. Without a table it is not used."""
    mean_exponent: float | None = 0.6
    """Mean of the exponential prior on e1: where nothing shows how a body ends above and below,
    flat ends are likelier than round ones. None: no prior."""
    prior: float = 0.1
    """Inverse standard deviation of the prior on the exponents' logits, the taper's arctanh and
    the bend, against the noise that the residuals show; 0 switches it off."""

    def __post_init__(self) -> None:
        if self.residual is not None:
            check_word("residual", self.residual, Kind)
        check_word("loss", self.loss, Loss)


@dataclass(frozen=True)
class SuperquadricFit:
    """Fits, a row each; every field is finite whatever the status."""

    size_m: Float[np.ndarray, "fit 3"]
    """Half extents a1, a2, a3 [m]."""
    exponents: Float[np.ndarray, "fit 2"]
    """e1 along z, e2 across; a z-axis cylinder has e1 ~ 0.1, e2 ~ 1."""
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
    """Iterations of the finish."""
    status: Int[np.ndarray, " fit"]
    """`FitStatus` of each fit."""
    n_points: Int[np.ndarray, " fit"]
    """Points that took part."""

    def __len__(self) -> int:
        return len(self.status)

    def __getitem__(self, index) -> SuperquadricFit:
        """The fits `index` (a slice, a mask, an array, or a number) as a smaller record."""
        return rows_of(self, np.atleast_1d(np.arange(len(self))[index]))
