"""What `warpgrasp fit` says of fits that may be wrong although their touches lie on them."""

import numpy as np
from jaxtyping import Bool, Float

from fit.fit_status import FitStatus, is_fitted
from fit.implicit.record import FreeForms
from fit.plane_record import PlaneFit
from fit.point_sets import PointSets
from fit.revolution.record import STANDS, RevolutionFit
from fit.superquadric.record import SuperquadricFit

LARGE_RMS_M = 0.002
"""Touches of a fingertip are nearer to the body that they were made on [est]."""
MOST_NAMED = 10
"""Sets named in one message."""
OPEN_DEG = 75.0
"""Touches all around leave no cone about the middle open that is as wide as this from its axis to
its side, in units of half extents [est]."""
WIDE_FACTOR = 1.5
"""Upper over lower bound of a volume's 90 % interval from which touches tell little of it [est]."""
OPEN_TURN_RAD = np.pi
"""Touches about an axis that leave so much of a turn open lie on one side."""
VAGUE_DEG = 10.0
"""Of a plane's normal, either way with 90 %, from which touches tell little of it [est]."""
NORMAL_90 = 1.645
FLAT_SHARE = 0.02
"""Standard deviation of touches across a plane, as a share of that along it, below which they tell
one face and no contour [est]."""
GAP = 1.6
"""A place of a free form that is as many times farther from any touch than evenly spread touches
are from each other lies on a side that was left open [est]."""
END_SHARE = 0.04
"""Of its height that a surface of revolution may reach beyond its touches [est]."""
_DIRECTIONS = 256


def superquadric_advice(sets: PointSets, found: SuperquadricFit, vague: Bool[np.ndarray, " fit"],
                        *, robust: bool, table_z_m: float | None) -> list[str]:
    """Notes of superquadrics that did not converge or lie far off, and of those that are `vague`.
    """
    notes = []
    if poor := _poor(sets.names, found):
        wrong = "" if robust else "if touches may be wrong, try --robust; "
        notes.append(f"{_POOR}: {named(poor)}; {wrong}if the body is no superquadric, "
                     "`warpgrasp fit implicit` follows it")
    if vague.any():
        names = [name for name, is_vague in zip(sets.names, vague, strict=True) if is_vague]
        table = ", or give --table-z" if table_z_m is None else ""
        notes.append(f"touches are few or leave a side open, so that volumes may be far off: "
                     f"{named(names)}; touch all around{table}")
    if table_z_m is not None and (high_up := _high_up(sets, found, table_z_m)):
        notes.append(f"no touch lies in the lower half, which is taken to reach down to the table: "
                     f"{named(high_up)}; check --table-z, or touch nearer to the table")
    return notes


def _high_up(sets: PointSets, found: SuperquadricFit, table_z_m: float) -> list[str]:
    """Sets whose lowest touch is above the middle between the table and the highest, and how high
    it is."""
    names = []
    for index, name in enumerate(sets.names):
        height = sets.touches_m[sets.slots(index)][:, 2] - table_z_m
        if is_fitted(found.status[index]) and np.nanmin(height) > 0.5 * np.nanmax(height):
            names.append(f"{name} (from {_mm(np.nanmin(height))} on)")
    return names


def revolution_advice(sets: PointSets, found: RevolutionFit, *, table_z_m: float | None
                      ) -> list[str]:
    """Notes of surfaces of revolution that did not converge or lie far off, were touched on one
    side or on one face, or end where no touch is."""
    notes = []
    if poor := _poor(sets.names, found):
        notes.append(f"{_POOR}: {named(poor)}; leave out touches that may be wrong; steps and "
                     "edges of a contour are rounded")
    sides, faces, ends = [], [], []
    for index, name in enumerate(sets.names):
        if not is_fitted(found.status[index]):
            continue
        arm = sets.touches_m[sets.slots(index)] - found.position_m[index]
        arm = arm[np.isfinite(arm).all(1)]
        along = arm @ found.axis[index]
        if _open_turn_rad(arm - along[:, None] * found.axis[index]) > OPEN_TURN_RAD:
            sides.append(name)
        spread = np.linalg.svd(arm - arm.mean(axis=0), compute_uv=False)
        if spread[2] < FLAT_SHARE * spread[0]:
            faces.append(name)
        height = found.height_m[index]
        stands = table_z_m is not None and found.axis[index, 2] > STANDS
        below = 0.0 if stands else along.min()
        beyond = max(height - along.max(), below)
        if beyond > END_SHARE * height:
            ends.append(f"{name} ({_mm(beyond)})")
    if sides:
        notes.append(f"all touches lie on one side of the axis, which they tell badly: "
                     f"{named(sides)}")
    if faces:
        notes.append(f"all touches lie in one plane, which tells no contour: {named(faces)}; touch "
                     "other sides, too")
    if ends:
        notes.append(f"bodies end beyond their last touches, where nothing tells their height: "
                     f"{named(ends)}")
    return notes


def plane_advice(sets: PointSets, found: PlaneFit) -> list[str]:
    """Notes of planes that their touches lie far off, and of those whose normals they tell badly:
    along a line, in two places, few."""
    notes = []
    if poor := _poor(sets.names, found):
        notes.append(f"{_POOR}: {named(poor)}; the touches may be of several faces, or of one that "
                     "is not flat")
    known = np.isfinite(found.covariance).all(axis=(1, 2))
    turns = np.where(np.isfinite(found.covariance), found.covariance, 0.0)[:, :2, :2]
    deviation = np.sqrt(np.maximum(np.linalg.eigvalsh(turns)[:, -1], 0.0))
    wide = np.where(known, NORMAL_90 * np.degrees(deviation), 90.0) > VAGUE_DEG
    vague = [name for name, is_vague in zip(sets.names, wide & is_fitted(found.status),
                                            strict=True) if is_vague]
    if vague:
        notes.append("touches are few, or too close to a line for their errors, so that normals "
                     f"may err by {VAGUE_DEG:g} degrees and more: {named(vague)}")
    return notes


def free_form_advice(names: tuple[str, ...], found: FreeForms) -> list[str]:
    """Notes of free forms that did not converge, have no surface, or a side that no touch tells of.
    """
    notes, fitted = [], is_fitted(found.status)
    if poor := _poor(names, found):
        notes.append(f"{_POOR}: {named(poor)}; leave out touches that may be wrong")
    if none := [name for name, mesh, good in zip(names, found.mesh, fitted, strict=True)
                if good and not len(mesh.faces)]:
        notes.append(f"no surface is left of {named(none)}; normals should point out of the body")
    with np.errstate(invalid="ignore"):  # where there is no surface
        wide = found.interval_m3[:, 1] > WIDE_FACTOR * found.interval_m3[:, 0]
        open_ = wide | (found.gap_m > GAP * found.spacing_m)
    if gaps := [f"{name} (up to {_mm(gap)} from any touch)" for name, gap, is_open in
                zip(names, found.gap_m, open_, strict=True) if is_open]:
        notes.append("touches are few or leave a side open, where the surface is a guess: "
                     f"{named(gaps)}; touch there, too")
    return notes


_POOR = f"not converged, or more than {1e3 * LARGE_RMS_M:g} mm off (rms)"


def named(found: list[str]) -> str:
    """The first of a list, and how many more there are."""
    more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
    return ", ".join(found[:MOST_NAMED]) + more


def _mm(length_m: float) -> str:
    """A length in millimetres, to two digits below 10 mm."""
    return f"{1e3 * length_m:.0f} mm" if length_m >= 0.01 else f"{1e3 * length_m:.2g} mm"


def _poor(names: tuple[str, ...], found: SuperquadricFit | RevolutionFit | FreeForms | PlaneFit
          ) -> list[str]:
    """Sets that did not converge or whose touches lie far off, with their rms."""
    return [f"{name} ({_mm(rms)})" for name, rms, status in
            zip(names, found.rms_m, found.status, strict=True)
            if status == FitStatus.not_converged or (
                status == FitStatus.converged and rms > LARGE_RMS_M)]


def vague_superquadrics(
    found: SuperquadricFit, points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"], table_z_m: float | None,
) -> Bool[np.ndarray, " fit"]:
    """Of which bodies the touches tell little: their volumes have wide intervals, or a cone about
    their middle holds no touch."""
    from fit.superquadric.uncertainty import superquadric_uncertainty

    vague = np.zeros(len(found), bool)
    rows = np.flatnonzero(is_fitted(found.status))
    if len(rows) == 0:
        return vague
    bodies, points = found[rows], points[rows]
    touched = mask[rows] & np.isfinite(points).all(2)
    low, high = superquadric_uncertainty(
        bodies, points, touched, table_z=table_z_m).volume_interval_m3().T
    vague[rows] = ((high > WIDE_FACTOR * low)
                   | (_open_deg(bodies, points, touched, table_z_m) > OPEN_DEG))
    return vague


def _open_deg(bodies: SuperquadricFit, points: Float[np.ndarray, "fit point 3"],
              mask: Bool[np.ndarray, "fit point"], table_z_m: float | None
              ) -> Float[np.ndarray, " fit"]:
    """Half the angle of the widest cone about each middle that holds no touch; the table counts as
    a touch below it."""
    from fit.superquadric.geometry import straight_coordinates

    if table_z_m is not None:
        below = bodies.position_m[:, None] * [1.0, 1.0, 0.0] + [0.0, 0.0, table_z_m]
        points = np.concatenate([points, below], axis=1)
        mask = np.pad(mask, [(0, 0), (0, 1)], constant_values=True)
    points = np.where(mask[..., None], points, bodies.position_m[:, None])
    straight = np.stack(straight_coordinates(bodies, points), axis=-1)
    straight = straight / np.maximum(bodies.size_m, 1e-9)[:, None]
    length = np.linalg.norm(straight, axis=2, keepdims=True)
    unit = np.where(mask[..., None] & (length > 1e-9), straight / np.maximum(length, 1e-9), 0.0)
    z = 1.0 - 2.0 * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    turn = np.arange(_DIRECTIONS) * np.pi * (3.0 - 5.0**0.5)
    ring = np.sqrt(1.0 - z**2)
    ways = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    nearest = np.array([(ways @ own.T).max(1).min() for own in unit])
    return np.degrees(np.arccos(np.clip(nearest, -1.0, 1.0)))


def _open_turn_rad(arm: Float[np.ndarray, "point 3"]) -> float:
    """The largest turn about an axis without a touch, of touches' radial vectors."""
    u, v = np.linalg.svd(arm, full_matrices=False)[2][:2]
    turn = np.sort(np.arctan2(arm @ v, arm @ u))
    return float(np.diff(turn, append=turn[0] + 2.0 * np.pi).max())
