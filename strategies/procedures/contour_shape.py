"""From touches along an axis to a body: the axis refined, linear segments, size and volume.

The touches of both contours are turned so that the given axis stands upright; a surface of
revolution is fitted to them (`fit.revolution.fit`, jaxopt), which refines the axis; about that axis
each section is a circle, and the contour runs straight from one section to the next.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fit.arrays import row_sums, with_rows
from fit.fit_status import is_fitted
from fit.revolution.fit import fit_revolution
from fit.revolution.record import Middle, RevolutionFit, RevolutionOptions
from strategies.procedures.contour_record import ContourExploration
from strategies.procedures.contour_sections import SectionProfile, section_circles

FIT = RevolutionOptions(nodes=10, upright=True, tilt_std_rad=np.radians(5), least_fall=1e-5)
"""An axis is known to some degrees [est], which touches of a short object do not tell better."""
_SPACING_M = 0.010  # of nodes
_LEAST_RADIUS_M = 0.005
LEANING = 0.2
"""Sine of the lean from which a body stands on its rim; axes of upright ones err by less [est]."""
_TURNED_RAD = 0.1  # normals of all sections together, at least [est]


@dataclass(frozen=True)
class Profile:
    """Recovered surfaces of revolution. Shapes start with (world,); NaN where nothing was felt."""

    foot_m: np.ndarray
    """Lower end of the refined axis, (world, 3)."""
    axis: np.ndarray
    """Its direction, upwards, (world, 3)."""
    height_m: np.ndarray
    """Of each node along the axis from the foot, rising, (world, node); NaN after the last."""
    radius_m: np.ndarray
    """(world, node)."""
    volume_m3: np.ndarray
    largest_radius_m: np.ndarray
    length_m: np.ndarray
    rms_m: np.ndarray
    """Of the touches about the contour."""
    fit: RevolutionFit
    """In the frame whose z is the axis as given, its origin that axis' foot."""


def profile_of(exploration: ContourExploration, *, refine: bool = True) -> Profile:
    """Refine the axes and make the contours of linear segments.

    Each node is a weighted line through the touches near it; the lowest radius is carried down to
    the table: until the axis meets it, or, of a body that leans, its rim. Without `refine` the
    given direction is kept, through the middle of the fitted axis, which ends on the table.

    Of low bodies that lean, few sections tell where the rim is: of four cylinders as wide as high,
    leaning by 20 degrees, one came out at 0.64 of its volume.
    """
    given = exploration.axis
    worlds = len(exploration.reason)
    points, mask = exploration.touches.sets(worlds, exploration.touches.above_table())
    ways, which = np.unique(np.nan_to_num(given.direction, nan=0.0), axis=0, return_inverse=True)
    turns = [_upright(way) for way in ways]
    to_axis, from_axis = ([each[k] for k in which.ravel()] for each in (
        turns, [turn.inv() for turn in turns]))
    local = np.stack([turn.apply(p - f) for turn, p, f in
                      zip(to_axis, points, np.nan_to_num(given.foot_m), strict=True)])
    fit = fit_revolution(local, mask, options=FIT, middle=_middles(exploration, to_axis))
    good = is_fitted(fit.status)
    axis_local = np.where(good[:, None], fit.axis, [0.0, 0.0, 1.0])
    point_local = np.where(good[:, None], fit.position_m, 0.0)
    if not refine:
        point_local = point_local + axis_local * (0.5 * fit.height_m)[:, None]
        axis_local = np.tile([0.0, 0.0, 1.0], (worlds, 1))
    arms = local - point_local[:, None]
    t = np.einsum("wpi,wi->wp", arms, axis_local)
    rho = np.linalg.norm(arms - t[..., None] * axis_local[:, None], axis=2)
    axis = np.stack([turn.apply(a) for turn, a in zip(from_axis, axis_local, strict=True)])
    through = np.stack([turn.apply(p) for turn, p in zip(from_axis, point_local, strict=True)])
    through = through + np.nan_to_num(given.foot_m)
    lean = np.hypot(axis[:, 0], axis[:, 1])
    rim = np.where(refine & (lean > LEANING), lean * _lowest(t, rho, mask), 0.0)
    bottom = (rim - through[:, 2]) / np.maximum(axis[:, 2], 0.1)
    top = np.where(mask, t, -np.inf).max(1, initial=-np.inf)
    known = good & (top > bottom)
    bottom, top = np.where(known, bottom, 0.0), np.where(known, top, 0.0)
    rows = np.flatnonzero(known)
    nodes = _segments((t - bottom[:, None])[rows], rho[rows], mask[rows], (top - bottom)[rows])
    height, radius = (with_rows(np.full((worlds, each.shape[1]), np.nan), rows, each)
                      for each in nodes)
    expected = np.stack([np.interp(x, h[np.isfinite(h)], r[np.isfinite(h)]) if k else x * np.nan
                         for x, h, r, k in zip(t - bottom[:, None], height, radius, known,
                                               strict=True)])
    count = np.maximum(mask.sum(1), 1)
    rms = np.sqrt(row_sums(np.where(mask, rho - expected, 0.0) ** 2) / count)
    low, high, step = radius[:, :-1], radius[:, 1:], np.diff(height, axis=1)
    volume = np.pi / 3 * row_sums(step * (low**2 + low * high + high**2))
    largest = np.where(known, np.where(np.isfinite(radius), radius, -1.0).max(1), np.nan)
    return Profile(through + axis * bottom[:, None], axis, height, radius,
                   np.where(known, volume, np.nan), largest,
                   np.where(known, top - bottom, np.nan), np.where(known, rms, np.nan), fit)


def _middles(exploration: ContourExploration, to_axis: Sequence[Rotation]) -> Middle:
    """Where the axes go through, by the sections' own circles, in the frames of the given axes.

    Both touches of a section are told by places and normals; without normals two opposite touches
    fit any larger circle whose middle lies aside.
    """
    foot = np.nan_to_num(exploration.axis.foot_m)
    point, std = np.zeros((len(foot), 3)), np.full(len(foot), np.inf)
    for world, turn in enumerate(to_axis):
        centre, radius = section_circles(exploration, world)
        if len(centre) > 1:
            own = turn.apply(centre - foot[world])
            point[world] = np.median(own, axis=0)
            spread = own[:, :2].std(axis=0, ddof=1)
            std[world] = np.hypot(_TURNED_RAD * max(float(np.median(radius)), _LEAST_RADIUS_M),
                                  np.hypot(*spread) / np.sqrt(2 * len(own)))
    return Middle(point, std)


def _upright(direction: np.ndarray) -> Rotation:
    """The least turn that takes `direction` to z."""
    length = np.linalg.norm(direction)
    if length < 1e-9:
        return Rotation.identity()
    axis = np.cross(direction / length, [0.0, 0.0, 1.0])
    size = np.linalg.norm(axis)
    angle = np.arctan2(size, direction[2] / length)
    return Rotation.from_rotvec(axis / max(size, 1e-12) * angle)


def _lowest(t: np.ndarray, rho: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Radii of the lowest touches, (world,); 0 where there are none."""
    if not mask.shape[1]:
        return np.zeros(len(mask))
    first = np.where(mask, t, np.inf).argmin(1)[:, None]
    return np.where(mask.any(1), np.take_along_axis(rho, first, 1)[:, 0], 0.0)


def _segments(
    t: np.ndarray, rho: np.ndarray, mask: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (world, node) from the foot to the top: local lines through the touches around each."""
    most = max(int(np.ceil(length.max(initial=0.0) / _SPACING_M)), 1) + 1
    count = np.maximum(np.ceil(length / _SPACING_M).astype(int), 1)
    place = np.arange(most)[None]
    height = np.where(place <= count[:, None], place / count[:, None] * length[:, None], np.nan)
    lowest = np.where(mask, t, np.inf).min(1, initial=np.inf)
    at = np.clip(height, np.where(np.isfinite(lowest), lowest, 0.0)[:, None], None)
    near = (t[:, None] - np.nan_to_num(at)[:, :, None]) / _SPACING_M
    weight = np.where(mask[:, None], np.exp(-0.5 * (near / 0.6) ** 2), 0.0) + 1e-12 * mask[:, None]
    total = np.maximum(weight.sum(2), 1e-300)
    mean_t, mean_r = (weight * near).sum(2) / total, (weight * rho[:, None]).sum(2) / total
    dt = near - mean_t[..., None]
    slope = (weight * dt * rho[:, None]).sum(2) / ((weight * dt**2).sum(2) + 0.05 * total)
    return height, np.where(np.isfinite(height), np.maximum(mean_r - slope * mean_t, 0.0), np.nan)


def radius_at(profile: Profile | SectionProfile, height_m: np.ndarray) -> np.ndarray:
    """Radii (world, n) at heights (n,) above the foot, 0 beyond the top [m]."""
    return np.stack([np.interp(height_m, h[np.isfinite(h)], r[np.isfinite(h)], right=0.0)
                     if np.isfinite(h[:1]).all() else np.full(len(height_m), np.nan)
                     for h, r in zip(profile.height_m, profile.radius_m, strict=True)])


def match_profiles(
    profile: Profile | SectionProfile, candidates: dict[str, np.ndarray]
) -> list[str]:
    """The candidate each recovered contour is most like; "" where nothing was recovered.

    `candidates` are (z, r) [m], shape (point, 2). The measure is the mean difference of the radii
    over the taller of the two, at steps of 2 mm.
    """
    tallest = max(c[-1, 0] for c in candidates.values())
    tallest = max(tallest, float(np.nanmax(profile.length_m, initial=0.0)))
    grid = np.arange(0.001, tallest + 0.002, 0.002)
    ours = radius_at(profile, grid)
    apart = []
    for points in candidates.values():
        theirs = np.interp(grid, points[:, 0], points[:, 1], right=0.0)
        either = (ours > 0) | (theirs > 0)
        apart.append((np.abs(ours - theirs) * either).sum(1) / np.maximum(either.sum(1), 1))
    distance = np.stack(apart, 1)
    names = list(candidates)
    return [names[row.argmin()] if np.isfinite(row).all() else "" for row in distance]


def later_profile(old: Profile, new: Profile) -> Profile:
    """Contours of two followings: the later one, where it found anything."""
    found = np.isfinite(new.volume_m3)
    return _merged(old, new, lambda a, b: np.where(
        found.reshape(-1, *([1] * (a.ndim - 1))), b, a))


def with_profiles(whole: Profile, rows: np.ndarray, part: Profile) -> Profile:
    """The profiles, those of the worlds `rows` replaced by `part`."""
    return _merged(whole, part, lambda a, b: with_rows(a, rows, b))


def _merged(
    one: Profile, other: Profile, join: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Profile:
    """`join` of every field, padded to as many nodes in both."""
    def joined(a: Any, b: Any) -> dict[str, Any]:
        return {f.name: join(*_as_wide(getattr(a, f.name), getattr(b, f.name)))
                for f in fields(a) if isinstance(getattr(a, f.name), np.ndarray)}

    fit = type(one.fit)(**joined(one.fit, other.fit))
    return Profile(**joined(one, other), fit=fit)


def _as_wide(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, ...]:
    if a.ndim == 1 or a.shape[1] == b.shape[1]:
        return a, b
    width = max(a.shape[1], b.shape[1])
    return tuple(np.pad(v, ((0, 0), (0, width - v.shape[1])), constant_values=np.nan)
                 for v in (a, b))
