"""Where the fingers of a hand would first meet believed superquadrics, for a whole batch."""

from functools import lru_cache

import numpy as np
import warp as wp

from fit.superquadric.geometry import Superquadric
from strategies.foresight.foresight_kernel import SweptLink, approach_kernel, first_touch_kernel
from strategies.procedures.containment import padded_commands
from strategies.recovery.body_distances import bodies_on
from warpgrasp.core.dtypes import real, transform, vec3
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.core.lanes import has_lanes
from warpgrasp.core.struct_array import record_type
from warpgrasp.hand_capsules import HandCapsules, capsules_of_hand
from warpgrasp.parameters import HandTable

_UNMOVED = 1e9
"""Steps a metre of a link that stands still."""
_SHAPES = {"shape": "world", "pose": "world", "wanted": "world probe", "hand_pose": "world probe",
           "base": "finger", "links": "grasp finger link step", "link_count": "finger",
           "radius": "finger link", "feels": "finger link", "bar": "bar 2", "bar_radius": "bar",
           "command_count": "grasp", "free": "world probe grasp",
           "point": "world probe grasp finger"}


def first_touches(
    bodies: Superquadric, hand: HandTable, closings: tuple[str, ...], hand_pose: np.ndarray,
    wanted: np.ndarray, device: str,
) -> np.ndarray:
    """Places in the base frame where fingers first meet the body of their world [m], (world, probe,
    grasp, finger, 3), NaN where they feel none.

    `hand_pose` (world, probe, 7) are poses of the hand, `wanted` (world, probe) those that are
    asked for. A finger moves freely along each of `closings` until a link meets body or table;
    where the open hand would strike one of them on its way there is no touch.
    """
    capsules = capsules_of_hand(hand)
    links, count = _links_on_device(capsules, closings, device)
    shape, pose = bodies_on(bodies, device)
    extents = {"world": len(hand_pose), "probe": hand_pose.shape[1], "grasp": len(closings)}
    free = wp.empty(
        tuple(extents.values()), dtype=wp.bool,  # pyright: ignore[reportArgumentType]
        device=device)

    def there(values: np.ndarray, dtype: type) -> wp.array:
        return array_of(values, dtype, device)

    given = {"has_lanes": has_lanes(device), "shape": shape, "pose": pose,
             "hand_pose": there(hand_pose, transform), "base": there(capsules.base, transform),
             "links": links, "link_count": there(capsules.count, int),
             "radius": there(capsules.radius_m, real), "free": free}
    launch(approach_kernel, extents, _SHAPES, {
        **given, "wanted": there(wanted, wp.bool), "bar": there(capsules.bars_m, vec3),
        "bar_radius": there(capsules.bar_radius_m, real)}, device=device)
    point = wp.empty((*extents.values(), capsules.fingers), dtype=vec3, device=device)
    launch(first_touch_kernel, {**extents, "finger": capsules.fingers}, _SHAPES, {
        **given, "feels": there(capsules.feels, wp.bool), "command_count": there(count, int),
        "point": point}, device=device)
    return point.numpy()


@lru_cache(maxsize=32)
def _links_on_device(
    hand: HandCapsules, closings: tuple[str, ...], device: str
) -> tuple[wp.array, np.ndarray]:
    """Rows of SweptLink (grasp, finger, link, step), and how many steps each path has."""
    commands, count = padded_commands(closings, hand.table)
    rows = np.stack([swept_links(hand, path) for path in commands])
    return wp.array(rows, dtype=SweptLink, device=device), count


def swept_links(hand: HandCapsules, commands_rad: np.ndarray) -> np.ndarray:
    """Rows of SweptLink (finger, link, step) along commands (finger, step, width)."""
    ends = np.moveaxis(hand.places_from_base(commands_rad), 1, 2)
    rows = np.zeros(ends.shape[:3], dtype=record_type(SweptLink))
    rows["start"], rows["end"] = ends[..., 0, :], ends[..., 1, :]
    # A point of a link moves no farther than the farther-moving of its ends.
    moved = np.linalg.norm(np.diff(ends, axis=2), axis=-1).max(-1)
    fastest = np.maximum.accumulate(moved[..., ::-1], axis=-1)[..., ::-1]
    rows["steps"] = _UNMOVED
    with np.errstate(divide="ignore"):
        rows["steps"][..., :-1] = np.minimum(1.0 / fastest, _UNMOVED)
    return rows
