"""Whether a recovered body is to be believed: what it was felt by, swept space, table and prior may
contradict it, whatever model it came from."""

from collections.abc import Sequence

import numpy as np

from fit.arrays import row_sums
from fit.revolution.geometry import RevolutionBody, revolution_inside, revolution_volume
from fit.superquadric.geometry import SuperquadricLike, superquadric_points, superquadric_volume
from strategies.poses.waypoints import BoundingCylinder
from strategies.recovery.body_distances import contour_distances, surface_distances
from strategies.recovery.evidence import Evidence
from strategies.recovery.misfit import FARTHEST_M, UNBELIEVED_M

FEWEST_CONTACTS = 8
"""With fewer contacts no body is believed."""
BEYOND = 2.0
"""A body that reaches farther than this many times `margin_m` beyond the prior cylinder contradicts
it: six standard deviations of the prior's height, and four of its centre and its radius together.
"""
SUNK_M = 0.010
"""A body whose lowest point is deeper than this below the table contradicts the table [est]."""
FLOATING_M = 0.030
"""One whose lowest point is higher than this above the table does too: objects stand on it [est].
"""
INSIDE_M = 0.005
"""A ball of free space whose centre lies deeper than this contradicts the body [est]."""
MOST_INSIDE = 0.1
"""Share of the balls that may: links are not where they are believed to be [est]."""
LEAST_FILL = 0.01
"""A body that fills less than this share of the prior cylinder contradicts it: of the objects that
ship the least is 0.07 [est]."""
_SURFACE_POINTS = 216


def within_reach(fits: SuperquadricLike, prior: BoundingCylinder) -> np.ndarray:
    """Whether superquadrics stay within twice the reach of the prior cylinder and its error, bool
    (world,): enough to go on exploring by."""
    middle = np.stack([prior.x_m, prior.y_m, prior.height_m / 2], axis=1)
    reach = np.hypot(prior.radius_m, prior.height_m / 2) + prior.margin_m
    far = (np.linalg.norm(fits.position_m - middle, axis=1)
           + np.linalg.norm(fits.size_m, axis=1))
    return far <= 2.0 * reach


def plausible(
    body: SuperquadricLike, prior: BoundingCylinder, *, table_plane: bool = True,
    whole: bool = True,
) -> np.ndarray:
    """Whether superquadrics agree with the prior cylinder and with the table, bool (world,).

    Few contacts on one side may let a fit diverge; with the rough size as prior one would not
    believe it, and neither is it scored. A robot that does not know the table (`table_plane`
    switched off) is contradicted by the prior alone. Superquadrics that are not `whole` bodies but
    parts of one may be as small as they like.
    """
    away, low, high = _extent(body, prior)
    return (_within(away, low if table_plane else np.zeros_like(low), high, prior)
            & ~(_shrunk(superquadric_volume(body), prior) & whole))


def reaches_beyond(body: SuperquadricLike, prior: BoundingCylinder) -> np.ndarray:
    """Whether superquadrics reach farther beyond the prior cylinder than it may err, bool (world,).
    """
    away, _, high = _extent(body, prior)
    return ~_within(away, np.zeros_like(high), high, prior)


def why_implausible(body: SuperquadricLike, prior: BoundingCylinder, *, table_plane: bool = True
                    ) -> list[str]:
    """What of prior and table contradicts the superquadric of one world, in words that follow "it";
    nothing where `plausible` holds."""
    (away,), (low,), (high,) = _extent(body, prior)
    over = max(away - float(prior.radius_m[0]), high - float(prior.height_m[0]))
    said = []
    if over > BEYOND * prior.margin_m:
        said.append(f"reaches {1e3 * over:.0f} mm beyond the prior")
    if table_plane and low < -SUNK_M:
        said.append(f"is {-1e3 * low:.0f} mm deep in the table")
    if table_plane and low > FLOATING_M:
        said.append(f"ends {1e3 * low:.0f} mm above the table")
    if _shrunk(superquadric_volume(body), prior)[0]:
        said.append(f"fills less than {100 * LEAST_FILL:.0f} % of the prior")
    return said


def _extent(body: SuperquadricLike, prior: BoundingCylinder
            ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The farthest distance from the prior's axis, the lowest and the highest point of each
    superquadric [m], (world,) each."""
    with np.errstate(invalid="ignore", divide="ignore"):  # where nothing was fitted
        points = np.nan_to_num(superquadric_points(body, _SURFACE_POINTS))
    away = np.hypot(points[..., 0] - prior.x_m[:, None], points[..., 1] - prior.y_m[:, None])
    return away.max(1), points[..., 2].min(1), points[..., 2].max(1)


def plausible_contour(
    body: RevolutionBody, evidence: Evidence, prior: BoundingCylinder, *, table_plane: bool = True,
    free_space: bool = True
) -> np.ndarray:
    """Whether bodies of revolution agree with prior, table, contacts and free space, bool (world,).

    False where there is no contour, or too few contacts to believe any. Without `table_plane` no
    table is known, without `free_space` nothing of where links met nothing.
    """
    known = np.isfinite(body.height_m) & np.isfinite(body.radius_m)
    height, radius = np.where(known, body.height_m, 0.0), np.where(known, body.radius_m, 0.0)
    centre = body.foot_m[:, None] + height[..., None] * body.axis[:, None]
    rise = radius * np.sqrt(np.maximum(1.0 - body.axis[:, None, 2] ** 2, 0.0))
    away = np.hypot(centre[..., 0] - prior.x_m[:, None], centre[..., 1] - prior.y_m[:, None])
    low = np.where(known, centre[..., 2] - rise, np.inf).min(1)
    within = _within(np.where(known, away + radius, -np.inf).max(1),
                     low if table_plane else np.where(np.isfinite(low), 0.0, low),
                     np.where(known, centre[..., 2] + rise, -np.inf).max(1), prior)
    felt = contour_distances(body, evidence.points_m, evidence.mask)
    free = contour_distances(body, evidence.free_m, evidence.free_mask)
    inside = revolution_inside(body, evidence.free_m)
    # Nodes that there are not lie at the height of the last: they add nothing.
    volume = revolution_volume(RevolutionBody(
        body.foot_m, body.axis, np.maximum.accumulate(height, axis=1), radius))
    through = swept_by(np.where(inside, -free, free), evidence.free_mask)
    return (within & known.any(1) & ~_shrunk(volume, prior)
            & (evidence.mask.sum(1) >= FEWEST_CONTACTS)
            & (_mean_away(felt, evidence.mask) < UNBELIEVED_M)
            & ~(through & free_space))


def plausible_vertices(
    vertices_m: Sequence[np.ndarray], prior: BoundingCylinder, *, table_plane: bool = True
) -> np.ndarray:
    """Whether surfaces with vertices [m] (vertex, 3), one of each world, agree with prior and
    table, bool (world,); False for those without any. Without `table_plane` none is known."""
    reach, low, high = (np.full(len(vertices_m), np.inf) for _ in range(3))
    for world, v in enumerate(vertices_m):
        if len(v):
            reach[world] = np.hypot(v[:, 0] - prior.x_m[world], v[:, 1] - prior.y_m[world]).max()
            low[world], high[world] = v[:, 2].min(), v[:, 2].max()
    if not table_plane:
        low = np.where(np.isfinite(low), 0.0, low)
    return _within(reach, low, high, prior)


def swept(body: SuperquadricLike, evidence: Evidence) -> np.ndarray:
    """Whether links passed through superquadrics without touching them, bool (world,)."""
    distance, _ = surface_distances(body, evidence.free_m, evidence.free_mask)
    return swept_by(distance, evidence.free_mask)


def swept_by(distance: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The same by the signed distances [m] of free balls' centres from bodies, (world, ball)."""
    deep = (mask & (distance < -INSIDE_M)).sum(1)
    return deep > MOST_INSIDE * mask.sum(1)


def _mean_away(distance: np.ndarray, mask: np.ndarray) -> np.ndarray:
    total = row_sums(np.where(mask, np.minimum(np.abs(distance), FARTHEST_M), 0.0))
    return total / np.maximum(mask.sum(1), 1)


def _shrunk(volume_m3: np.ndarray, prior: BoundingCylinder) -> np.ndarray:
    """Whether bodies leave all but nothing of the prior cylinder filled, bool (world,)."""
    with np.errstate(invalid="ignore"):  # where nothing was fitted
        return ~(volume_m3 >= LEAST_FILL * np.pi * prior.radius_m**2 * prior.height_m)


def _within(reach: np.ndarray, low: np.ndarray, high: np.ndarray,
            prior: BoundingCylinder) -> np.ndarray:
    """Of the farthest distance from the prior's axis, the lowest and the highest point."""
    beyond = BEYOND * prior.margin_m
    return ((reach <= prior.radius_m + beyond) & (high <= prior.height_m + beyond)
            & (low >= -SUNK_M) & (low <= FLOATING_M))
