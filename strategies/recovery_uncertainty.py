"""What a body recovered from grasps does not know: intervals of its volume and its surface."""

from fit.superquadric import SuperquadricFit
from fit.superquadric_uncertainty import SuperquadricUncertainty, superquadric_uncertainty
from strategies.evidence import Evidence
from warpgrasp.parameters import FitTable

COMMON_SIGMA_M = 0.0006
"""Standard deviation of an error along the normal that all contacts of an episode share [est]: in
simulated grasps of blocks and cylinders contacts as placed lie 0.3 to 0.5 mm (one standard
deviation over episodes) about a mean that is itself outside the body."""


def recovered_uncertainty(
    fits: SuperquadricFit, evidence: Evidence, table: FitTable
) -> SuperquadricUncertainty:
    """Uncertainty of the fits of `recovery.recover_bodies` to the evidence it gave back."""
    return superquadric_uncertainty(
        fits, evidence.points_m, evidence.mask,
        covariance=evidence.covariance_m2 if table.weights else None,
        table_z=0.0 if table.table_plane else None, common_sigma_m=COMMON_SIGMA_M)
