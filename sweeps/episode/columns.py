"""Columns of the model that stands for a body: its parameters, and how its fit went.

Named as in `shape.json` and in what `warpgrasp fit` writes. What a model does not have is NaN, or
empty: the columns are the same whatever was recovered.
"""

from dataclasses import replace

import numpy as np

from fit.fit_status import status_names
from fit.superquadric.geometry import SuperquadricLike
from strategies.contacts.body_uncertainty import INADEQUATE_FROM
from strategies.contacts.volume_spread import interval_trusted
from strategies.procedures.contour_shape import Profile
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import accepted_rms
from warpgrasp.parameters import FitTable

REVOLUTION = ("px_m", "py_m", "pz_m", "ax", "ay", "az", "height_m", "volume_m3")
NODES = ("profile_z_m", "profile_r_m")
"""Contours: an array a row."""


def model_columns(
    belief: Belief, recovered: Recovered, replaced: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Columns of each world's model, a row each: of `recovered`, with the fit in `belief`. Where a
    mesh stands in its place, bool `replaced` (world,), its interval is none of the body's."""
    fits, profile = belief.fits, belief.profile
    turned = recovered.shape == Shape.REVOLUTION
    rms = accepted_rms(recovered, belief.evidence)
    iterations, status = fits.iterations, fits.status
    fitted = superquadric_parameters(recovered.superquadric)
    contour: dict[str, np.ndarray] = dict.fromkeys(REVOLUTION, np.full(len(turned), np.nan))
    nodes = [(np.zeros(0), np.zeros(0))] * len(turned)
    if profile is not None:
        contour = revolution_parameters(profile)
        nodes = [contour_nodes(profile, world) if turned[world] else empty
                 for world, empty in enumerate(nodes)]
        iterations = np.where(turned, profile.fit.iterations, iterations)
        status = np.where(turned, profile.fit.status, status)
    columns = {name: np.where(turned, contour.get(name, np.nan), fitted.get(name, np.nan))
               for name in dict.fromkeys([*fitted, *contour])}
    for number, name in enumerate(NODES):
        columns[name] = np.empty(len(turned), object)
        columns[name][:] = [row[number] for row in nodes]
    columns |= interval_columns(belief, recovered, rms, replaced)
    return columns | {"fit_rms_mm": rms * 1e3, "fit_iterations": iterations.astype(np.int64),
                      "fit_status": np.array(status_names(status))}


def model_names(recovered: Recovered, table: FitTable) -> np.ndarray:
    """How rows name the model that stands for each world's body, str (world,). A superquadric may
    be bent where none was asked for (`reconstruct = "chosen"`)."""
    bent = recovered.superquadric.bend[:, 0] != 0.0
    kind = np.where(bent, replace(table, bend=True).superquadric_name, table.superquadric_name)
    return np.select([recovered.shape == Shape.SUPERQUADRIC, recovered.shape == Shape.REVOLUTION],
                     [kind, "revolution"], "prior")


def interval_columns(
    belief: Belief, recovered: Recovered, rms_m: np.ndarray, replaced: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """90 % intervals of volumes, (world,) each, NaN where nothing was recovered or a mesh stands,
    bool `replaced` (world,); if they are of a kind that held, and whether the contacts agree with
    the model. `rms_m` (world,) is the bodies' `accepted_rms`."""
    known = recovered.shape != Shape.PRIOR
    stands = known if replaced is None else known & ~replaced
    low, high = np.full((2, len(known)), np.nan)
    trusted = np.zeros_like(known)
    if known.any():
        low, high = np.where(stands, belief.uncertainty.volume_interval_m3().T, np.nan)
        trusted = stands & interval_trusted(belief.uncertainty.signs, rms_m)
    share = belief.felt.contradicted_share()
    return {"volume_low_m3": low, "volume_high_m3": high, "interval_trusted": trusted,
            "contradicted_share": np.where(known, share, np.nan),
            "model_adequate": known & (share < INADEQUATE_FROM)}


def superquadric_parameters(s: SuperquadricLike) -> dict[str, np.ndarray]:
    """Parameters of superquadrics, (world,) each."""
    return {
        "a1_m": s.size_m[:, 0], "a2_m": s.size_m[:, 1], "a3_m": s.size_m[:, 2],
        "eps1": s.exponents[:, 0], "eps2": s.exponents[:, 1],
        "px_m": s.position_m[:, 0], "py_m": s.position_m[:, 1], "pz_m": s.position_m[:, 2],
        "qx": s.quaternion_xyzw[:, 0], "qy": s.quaternion_xyzw[:, 1],
        "qz": s.quaternion_xyzw[:, 2], "qw": s.quaternion_xyzw[:, 3],
        "kx": s.taper[:, 0], "ky": s.taper[:, 1],
        "bend_per_m": s.bend[:, 0], "bend_angle_rad": s.bend[:, 1],
    }


def revolution_parameters(profile: Profile) -> dict[str, np.ndarray]:
    """Parameters of surfaces of revolution but for their contours, (world,) each; p is the foot."""
    return dict(zip(REVOLUTION, (*profile.foot_m.T, *profile.axis.T, profile.length_m,
                                 profile.volume_m3), strict=True))


def contour_nodes(profile: Profile, world: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights along one world's axis, and radii there [m], (node,) each."""
    known = np.isfinite(profile.height_m[world])
    return profile.height_m[world][known], profile.radius_m[world][known]
