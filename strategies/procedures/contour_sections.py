"""The contour as the paper has it: a circle fitted to each section, linear segments along the axis.

Allen and Michelman (1990), section IV-E: thumb and index finger give two touches a section. Their
places and normals give the section's circle (`section_circle`). The radii along the axis are split
into straight segments (Duda and Hart 1973, Pattern Classification and Scene Analysis, 9.2: iterated
end points), whose nodes are then fitted by least squares. The axis keeps the direction given; a
section has its own centre. `contour_shape` refines the axis, and fits all touches at once.
"""

from dataclasses import dataclass

import numpy as np

from strategies.procedures.contour_follower import section_circle
from strategies.procedures.contour_record import ContourExploration

SPLIT_M = 0.0015
"""A segment is split where a radius is farther than this from it [est]: twice the deviation of a
section's radius from the true one."""
_RADII_M = (0.002, 0.2)


@dataclass(frozen=True)
class SectionProfile:
    """Bodies of circular sections between linear segments. Shapes start with (world,)."""

    foot_m: np.ndarray
    """Middle of the sections' centres, at the lower end, (world, 3)."""
    height_m: np.ndarray
    """Of each node along the axis from the lower end, rising, (world, node); NaN after the last."""
    radius_m: np.ndarray
    """(world, node)."""
    volume_m3: np.ndarray
    """NaN where fewer than two sections were felt, as the two that follow."""
    largest_radius_m: np.ndarray
    length_m: np.ndarray


def profile_by_sections(exploration: ContourExploration) -> SectionProfile:
    """The contours of all worlds; the lowest radius is carried down to the table."""
    worlds = len(exploration.reason)
    found = [_contour(exploration, world) for world in range(worlds)]
    most = max((len(nodes) for _, nodes in found), default=1)
    wide = np.stack([np.pad(nodes, ((0, most - len(nodes)), (0, 0)), constant_values=np.nan)
                     for _, nodes in found])
    height, radius = wide[..., 0], wide[..., 1]
    low, high, step = radius[:, :-1], radius[:, 1:], np.diff(height, axis=1)
    known = np.isfinite(height[:, 0])
    nothing = np.where(known, 0.0, np.nan)
    return SectionProfile(
        np.stack([foot for foot, _ in found]), height, radius,
        np.pi / 3 * np.nansum(step * (low**2 + low * high + high**2), axis=1) + nothing,
        np.where(np.isfinite(radius), radius, -1.0).max(1) + nothing,
        np.where(np.isfinite(height), height, -1.0).max(1) + nothing)


def _contour(exploration: ContourExploration, world: int) -> tuple[np.ndarray, np.ndarray]:
    """Foot (3,) and nodes (node, height and radius) of one world."""
    axis = exploration.axis
    centre, radius = section_circles(exploration, world)
    if len(centre) < 2:
        return np.full(3, np.nan), np.full((1, 2), np.nan)
    along = axis.direction[world] / np.linalg.norm(axis.direction[world])
    height = (centre - axis.foot_m[world]) @ along
    order = np.argsort(height, kind="stable")
    height, radius = height[order], np.clip(radius[order], *_RADII_M)
    across = centre - axis.foot_m[world]
    across = np.median(across - (across @ along)[:, None] * along, axis=0)
    beside = axis.foot_m[world] + across  # through the middle of the sections, not as given
    begin = -beside[2] / max(along[2], 0.1)
    nodes = linear_segments(height, radius, SPLIT_M)
    if begin < height[0]:
        nodes = np.concatenate([[[begin, nodes[0, 1]]], nodes])
    return beside + begin * along, nodes - [begin, 0.0]


def section_circles(exploration: ContourExploration, world: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres (section, 3) and radii (section,) [m] of the sections of a world with two touches,
    neither of which is of the table."""
    table, axis = exploration.touches, exploration.axis
    mine = np.flatnonzero((table.world == world) & np.isfinite(table.point_m).all(1)
                          & np.isfinite(table.normal).all(1) & table.above_table())
    thumb = {table.part[row]: row for row in mine if table.finger[row] == exploration.thumb}
    index = {table.part[row]: row for row in mine if table.finger[row] != exploration.thumb}
    both = sorted(thumb.keys() & index.keys())
    one, other = (np.array([of[part] for part in both], int) for of in (thumb, index))
    if len(both) == 0:
        return np.zeros((0, 3)), np.zeros(0)
    along = axis.direction[world] / np.linalg.norm(axis.direction[world])
    return section_circle(table.point_m[one], table.normal[one], table.point_m[other],
                          table.normal[other], np.tile(along, (len(one), 1)))


def linear_segments(height: np.ndarray, radius: np.ndarray, split_m: float) -> np.ndarray:
    """Nodes (node, 2) of straight segments through radii (n,) at rising heights (n,).

    The line between the ends is split at the point farthest from it, as long as one is farther
    than `split_m`; the radii of the nodes are then those of least squares.
    """
    kept, left = {0, len(height) - 1}, [(0, len(height) - 1)]
    while left:
        first, last = left.pop()
        inner = np.arange(first + 1, last)
        if len(inner) == 0:
            continue
        line = np.interp(height[inner], height[[first, last]], radius[[first, last]])
        off = np.abs(radius[inner] - line)
        if off.max() > split_m:
            at = int(inner[off.argmax()])
            kept.add(at)
            left += [(first, at), (at, last)]
    places = height[sorted(kept)]
    hats = np.stack([np.interp(height, places, row) for row in np.eye(len(places))], axis=1)
    fitted = np.linalg.lstsq(hats, radius, rcond=None)[0]
    return np.stack([places, np.maximum(fitted, 0.0)], axis=1)
