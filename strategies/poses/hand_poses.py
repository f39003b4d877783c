"""From waypoint families to hand poses, for a whole batch of prior bounding cylinders."""

import csv
from collections.abc import Callable, Sequence
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from strategies.poses.hand_outline import HandOutline, outline_of
from strategies.poses.waypoints import (
    BoundingCylinder,
    Column,
    Csv,
    Hemisphere,
    Opposing,
    Placement,
    Random,
    Ring,
    Spiral,
    Top,
    WaypointError,
    check_prior,
)
from warpgrasp.core.array_checks import check_array
from warpgrasp.core.random import Purpose, counter_key, counter_uniform
from warpgrasp.parameters import HandTable

TABLE_CLEARANCE_M = 0.010
THIN_RADIUS_M = 0.020
UPRIGHT = 0.3
"""The level part of a unit vector below which its azimuth says little."""
LEVEL = 0.1
"""An approach that comes down less than this for each metre clears no table by backing off."""
FARTHEST_M = 5.0
"""Of a place of a hand in a file along each axis, more than the box of any wrist."""
CSV_COLUMNS = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


def waypoint_poses(
    waypoints: Sequence[object], prior: BoundingCylinder, hand: HandTable, key: np.ndarray
) -> np.ndarray:
    """Hand poses of all families, one after the other, shape (world, probe, 7).

    Position [m] and quaternion xyzw in the robot's base frame. `key` (world,) uint64 draws the
    random families. Raises WaypointError for a file that cannot be used, and for what is no family;
    ValueError or TypeError for keys of another shape or kind, and for a prior that is not finite or
    has sizes of 0 or less.
    """
    check_prior(prior)
    check_array("key", key, "whole numbers", "world", world=prior.worlds)
    if not isinstance(waypoints, Sequence):
        raise WaypointError(f"waypoints: are {waypoints!r}; should be a list of families, such as "
                            "[Ring(count=6)]")
    wrong = [family for family in waypoints if type(family) not in _FAMILY]
    if wrong or not len(waypoints):
        names = ", ".join(family.__name__ for family in _FAMILY)
        raise WaypointError(f"waypoints: {wrong[0] if wrong else waypoints!r} is no family; should "
                            f"be some of {names}, such as Ring(count=6)")
    stream = counter_key(key, int(Purpose.WAYPOINT))
    return np.concatenate([
        _FAMILY[type(family)](family, prior, hand, counter_key(stream, number))
        for number, family in enumerate(waypoints)], axis=1)


def pose_about(
    prior: BoundingCylinder, azimuth: np.ndarray, tilt: np.ndarray, roll: np.ndarray,
    aim: np.ndarray, aim_out: float, clearance_m: float, per_radius: float, hand: HandTable
) -> np.ndarray:
    """Hand poses about priors, angles [rad] of shape (world, probe) or broadcast to it.

    Angles and `aim` as the module `waypoints` defines them; a hand whose open fingers would come
    within TABLE_CLEARANCE_M of the table backs off along its approach, or, where that is level or
    from below, is raised; so is a hand that would itself be below the table. Its fingers close
    about the place aimed at. Distances are those of the default hand; others stay away in
    proportion to their reach, and come nearer to what is wide where their fingers open wider.
    Shape (world, probe, 7).
    """
    outline = outline_of(hand)
    x, y, height = (v[:, None] for v in (prior.x_m, prior.y_m, prior.height_m))
    azimuth, tilt, roll, aim, _ = np.broadcast_arrays(azimuth, tilt, roll, aim, x + azimuth)
    angle = azimuth + prior.front()[:, None]
    radius = prior.half_width(angle)
    sin_t, cos_t = np.sin(tilt), np.cos(tilt)
    approach = np.stack([-np.cos(angle) * sin_t, -np.sin(angle) * sin_t, -cos_t], -1)
    level = np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)], -1)
    third = np.cross(approach, level)
    c, s = np.cos(roll)[..., None], np.sin(roll)[..., None]
    frame = np.stack([c * level + s * third, c * third - s * level, approach], -1)
    with np.errstate(divide="ignore"):
        out = radius * aim_out
        sideways = np.where(sin_t > 1e-9, (radius - out) / np.maximum(sin_t, 1e-9), np.inf)
        end = np.where(cos_t > 0, height * (1 - aim), height * aim)
        endways = np.where(np.abs(cos_t) > 1e-9, end / np.maximum(np.abs(cos_t), 1e-9), np.inf)
    # A hand opens only so far: what does not fit between its fingers is touched from farther off.
    across = prior.half_width(_closing_azimuth(frame))
    stay = outline.scale * (
        clearance_m + per_radius * np.maximum(across / outline.wide - THIN_RADIUS_M, 0.0))
    away = np.maximum(np.minimum(sideways, endways), 0.0) + stay
    centre = np.stack([x + out * np.cos(angle), y + out * np.sin(angle), aim * height], -1)
    place = centre - approach * away[..., None]
    for axis, off in enumerate(outline.centre_m):
        if off:
            place = place - off * frame[..., axis]
    lowest = place[..., 2] + _open_fingers_below(outline, frame)
    short = np.maximum(TABLE_CLEARANCE_M - lowest, 0.0)
    level_or_up = cos_t < LEVEL
    back = np.where(level_or_up, 0.0, short / np.maximum(cos_t, LEVEL))
    place = place - approach * back[..., None]
    place[..., 2] += np.where(level_or_up, short, 0.0)
    # From below the palm is lower than its fingers; a place that no arm reaches is `unreachable`.
    place[..., 2] = np.where(place[..., 2] < 0.0, TABLE_CLEARANCE_M, place[..., 2])
    turn = Rotation.from_matrix(frame.reshape(-1, 3, 3)).as_quat().reshape(*aim.shape, 4)
    return np.concatenate([place, turn], -1)


def _closing_azimuth(frame: np.ndarray) -> np.ndarray:
    """Azimuth of the direction that fingers close in; where that is upright, of the level one
    across the approach, (world, probe)."""
    closing, other = frame[..., :2, 0], frame[..., :2, 1]
    upright = np.linalg.norm(closing, axis=-1) < UPRIGHT
    x, y = np.moveaxis(np.where(upright[..., None], other, closing), -1, 0)
    return np.arctan2(y, x)


def _open_fingers_below(outline: HandOutline, frame: np.ndarray) -> np.ndarray:
    """Height of the lowest point of the open fingers over the hand's origin [m], (world, probe)."""
    heights = np.einsum("wpk,tk->wpt", frame[..., 2, :], outline.open_m)
    return (heights - outline.open_radius_m).min(-1)


def _about(f: Placement, prior: BoundingCylinder, hand: HandTable, azimuth: np.ndarray, *,
           tilt: Any = None, roll: Any = None, aim: Any = None) -> np.ndarray:
    return pose_about(prior, np.atleast_2d(azimuth) + f.azimuth_rad,
                      np.asarray(f.tilt_rad if tilt is None else tilt),
                      np.asarray(0.0 if roll is None else roll) + f.roll_rad,
                      np.asarray(f.aim if aim is None else aim), f.aim_out,
                      f.palm_clearance_m, f.clearance_per_radius, hand)


def _ring(f: Ring, prior: BoundingCylinder, hand: HandTable, key: np.ndarray) -> np.ndarray:
    return _about(f, prior, hand, 2 * pi * np.arange(f.count) / f.count)


def _column(f: Column, prior: BoundingCylinder, hand: HandTable, key: np.ndarray) -> np.ndarray:
    level = np.arange(f.count) % f.levels
    around = np.arange(f.count) // f.levels
    per_level = -(-f.count // f.levels)
    # Each level is turned by a share of the spacing, so that no two fingers retrace a line.
    azimuth = 2 * pi * (around + level / f.levels) / per_level
    share = level / max(1, f.levels - 1)
    return _about(f, prior, hand, azimuth, aim=f.aim_low + (f.aim_high - f.aim_low) * share)


def _opposing(f: Opposing, prior: BoundingCylinder, hand: HandTable, key: np.ndarray) -> np.ndarray:
    pair = np.arange(f.count) // 2
    pairs = -(-f.count // 2)
    return _about(f, prior, hand, pi * pair / pairs + pi * (np.arange(f.count) % 2))


def _top(f: Top, prior: BoundingCylinder, hand: HandTable, key: np.ndarray) -> np.ndarray:
    roll = pi * np.arange(f.count) / f.count
    return _about(f, prior, hand, np.zeros(f.count), tilt=0.0, roll=roll)


def _random(f: Random, prior: BoundingCylinder, hand: HandTable, key: np.ndarray) -> np.ndarray:
    draw = counter_uniform(counter_key(
        key[:, None, None], np.arange(f.count)[None, :, None], np.arange(4)))
    cos_tilt = 1.0 - draw[..., 1] * (1.0 - np.cos(f.tilt_rad))
    return _about(f, prior, hand, 2 * pi * draw[..., 0], tilt=np.arccos(cos_tilt),
                  roll=2 * pi * draw[..., 2],
                  aim=f.aim_low + (f.aim_high - f.aim_low) * draw[..., 3])


def _spiral(f: Spiral, prior: BoundingCylinder, hand: HandTable, key: np.ndarray) -> np.ndarray:
    share = np.arange(f.count) / max(1, f.count - 1)
    return _about(f, prior, hand, 2 * pi * f.turns * share,
                  aim=f.aim_low + (f.aim_high - f.aim_low) * share)


def _hemisphere(f: Hemisphere, prior: BoundingCylinder, hand: HandTable,
                key: np.ndarray) -> np.ndarray:
    # Swinbank and Purser 2006, Fibonacci grids: equal areas, azimuths by the golden angle.
    share = (np.arange(f.count) + 0.5) / f.count
    tilt = np.arccos(1.0 - share * (1.0 - np.cos(f.tilt_rad)))
    return _about(f, prior, hand, pi * (3.0 - np.sqrt(5.0)) * np.arange(f.count), tilt=tilt)


def _csv(f: Csv, prior: BoundingCylinder, hand: HandTable, key: np.ndarray) -> np.ndarray:
    poses = poses_from_csv(Path(f.file))
    return np.broadcast_to(poses, (len(prior.x_m), *poses.shape)).copy()


_FAMILY: dict[type, Callable[[Any, BoundingCylinder, HandTable, np.ndarray], np.ndarray]] = {
    Ring: _ring, Column: _column, Opposing: _opposing, Top: _top, Random: _random,
    Spiral: _spiral, Hemisphere: _hemisphere, Csv: _csv,
}


def poses_from_csv(path: Path) -> np.ndarray:
    """Hand poses of a file with columns x_m, y_m, z_m, qx, qy, qz, qw, shape (probe, 7).

    Raises WaypointError naming the line: text for a number, NaN, a place below the table or out of
    any arm's reach, a quaternion far from length 1.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise WaypointError(f"{path}: cannot be read: {error}") from None
    if not rows or tuple(c.strip() for c in rows[0]) != CSV_COLUMNS:
        raise WaypointError(f"{path}:1: the first line must be {','.join(CSV_COLUMNS)}")
    poses: list[list[float]] = []
    for number, row in enumerate(rows[1:], 2):
        if not row:
            continue
        if len(row) != len(CSV_COLUMNS):
            raise WaypointError(f"{path}:{number}: {len(row)} cells, {len(CSV_COLUMNS)} are wanted")
        values = []
        for column, cell in zip(CSV_COLUMNS, row, strict=True):
            try:
                value = float(cell)
            except ValueError:
                raise WaypointError(
                    f"{path}:{number}: {column}: {cell!r} is not a number") from None
            if not isfinite(value):
                raise WaypointError(f"{path}:{number}: {column}: {cell.strip()} is not finite")
            values.append(value)
        if values[2] < 0.0:
            raise WaypointError(f"{path}:{number}: z_m: {values[2]:g} is below the table; 0 and "
                                "more is right")
        for column, value in zip(CSV_COLUMNS, values[:3], strict=False):
            if abs(value) > FARTHEST_M:
                raise WaypointError(f"{path}:{number}: {column}: {value:g} m is out of every arm's "
                                    "reach; places are in metres")
        norm = float(np.linalg.norm(values[3:]))
        if abs(norm - 1.0) > 1e-3:
            raise WaypointError(f"{path}:{number}: qx..qw: a quaternion of length {norm:.4g}; 1 is "
                                "right")
        poses.append([*values[:3], *(v / norm for v in values[3:])])
    if not poses:
        raise WaypointError(f"{path}: no poses in it")
    if len(poses) > 256:
        raise WaypointError(f"{path}: {len(poses)} poses; at most 256")
    return np.asarray(poses)
