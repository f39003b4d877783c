"""What a strategy may ask for next: grasps, faces to cross, a contour to follow.

A strategy answers with a list of these for the whole batch; an empty list, or one that wants
nothing in any world, ends the episode.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from strategies.poses.hand_outline import outline_of
from strategies.procedures.containment import closing_names
from strategies.procedures.contour_record import Axis, ContourOptions
from strategies.procedures.planar_record import PlanarOptions
from warpgrasp.parameters import HandTable

TABLE_M = 0.0
"""A hand pose whose origin is below this height is a fault of the strategy."""


@dataclass(frozen=True)
class Grasp:
    """Grasping by containment at hand poses, in turn."""

    hand_pose: np.ndarray
    """Position [m] and quaternion xyzw of the hand in the base frame, (world, probe, 7)."""
    wanted: np.ndarray | None = None
    """Which of them to make, bool (world, probe); all where None."""
    closings: tuple[str, ...] = ()
    """Closing paths at each pose; the strategy's own where empty."""
    fingers: np.ndarray | None = None
    """Which fingers close, bool (world, probe, finger); all where None. The others stay open and
    cost no touch."""


@dataclass(frozen=True)
class CrossFaces:
    """Planar surface exploration of faces, one after the other."""

    point_m: np.ndarray
    """A point near each face, (world, face, 3)."""
    normal: np.ndarray
    """Its outward normal, (world, face, 3)."""
    wanted: np.ndarray | None = None
    """Bool (world, face); all where None."""
    options: PlanarOptions | None = None


@dataclass(frozen=True)
class FollowContour:
    """Contour following along an axis."""

    axis: Axis
    """Shapes (world, ...)."""
    wanted: np.ndarray | None = None
    """Bool (world,); all where None."""
    options: ContourOptions | None = None
    refine: bool = True
    """Fit the axis to the touches; else the direction is kept as given."""


Probe = Grasp | CrossFaces | FollowContour
_PROBES = "Grasp, CrossFaces and FollowContour"


MOST_PROBES = 10_000
"""Of a world in one answer, which are made without a look at what they feel."""


class ProbeError(ValueError):
    """A probe that cannot be asked for; the message says what is wrong and what would be right."""


def listed(answer: Any) -> list[Probe]:
    """The probes that a strategy answered with. Raises ProbeError for what is no list."""
    if isinstance(answer, str) or not isinstance(answer, Iterable):
        what = "None" if answer is None else type(answer).__name__
        raise ProbeError(f"answered with {what}; should be a list of {_PROBES}")
    return list(answer)


def wanted_of(probe: Probe, worlds: int, hand: HandTable) -> np.ndarray:
    """Which probes are wanted, bool (world, probe or face or 1). Raises ProbeError for shapes, and
    for closing paths that `hand` has not; a grasp that no finger is to make is not wanted."""
    if isinstance(probe, Grasp):
        pose = _checked("Grasp.hand_pose", probe.hand_pose, worlds, 7)
        known = closing_names(hand)
        if not isinstance(probe.closings, tuple | list) or not set(probe.closings) <= set(known):
            raise ProbeError(f"Grasp.closings is {probe.closings!r}; should be a tuple of names "
                             f"of: {', '.join(known)}")
        fingers = (*pose.shape[:2], outline_of(hand).fingers)
        closes = _mask("Grasp.fingers", probe.fingers, fingers)
        return _mask("Grasp.wanted", probe.wanted, pose.shape[:2]) & closes.any(2)
    if isinstance(probe, CrossFaces):
        point = _checked("CrossFaces.point_m", probe.point_m, worlds, 3)
        normal = _checked("CrossFaces.normal", probe.normal, worlds, 3)
        if point.shape != normal.shape:
            raise ProbeError(f"CrossFaces.point_m has shape {point.shape}, its normal "
                             f"{normal.shape}; both should be (world {worlds}, face, 3)")
        _check_options("CrossFaces", probe.options, PlanarOptions)
        return _mask("CrossFaces.wanted", probe.wanted, point.shape[:2])
    if isinstance(probe, FollowContour):
        _check_options("FollowContour", probe.options, ContourOptions)
        if not isinstance(probe.axis, Axis):
            raise ProbeError(f"FollowContour.axis is {type(probe.axis).__name__}; should be an "
                             "Axis (strategies.procedures.contour_record)")
        for name, width in (("foot_m", 3), ("direction", 3), ("length_m", 0), ("radius_m", 0)):
            value = _whole(f"FollowContour.axis.{name}", getattr(probe.axis, name))
            shape = (worlds, width) if width else (worlds,)
            if value.shape != shape or value.dtype.kind not in "fiu":
                raise ProbeError(f"FollowContour.axis.{name} is {value.dtype} of shape "
                                 f"{value.shape}; should be numbers of shape {shape}")
        return _mask("FollowContour.wanted", probe.wanted, (worlds,))[:, None]
    raise ProbeError(f"answered with {type(probe).__name__} in a list; should be a list of "
                     f"{_PROBES}")


def misfits(probe: Probe) -> list[tuple[np.ndarray, str]]:
    """What cannot be made of a probe of sound shapes: bool (world, probe or face or 1), and why."""
    if isinstance(probe, Grasp):
        pose = np.asarray(probe.hand_pose, float)
        with np.errstate(invalid="ignore"):
            turned = np.asarray(np.abs(np.linalg.norm(pose[..., 3:], axis=-1) - 1.0) > 1e-3)
        return [(np.asarray(~np.isfinite(pose).all(-1)), "a hand pose that is not finite"),
                (turned, "a quaternion whose length is not 1"),
                (pose[..., 2] < TABLE_M, "a hand pose through the table (z below 0)")]
    if isinstance(probe, CrossFaces):
        return _misfits_of("a face", np.asarray(probe.point_m, float),
                           np.asarray(probe.normal, float))
    axis = probe.axis
    numbers = np.column_stack([axis.foot_m, axis.length_m, axis.radius_m])[:, None]
    thin = np.asarray(axis.radius_m, float)[:, None] <= 0.0
    return [*_misfits_of("an axis", numbers, np.asarray(axis.direction, float)[:, None]),
            (thin, "an axis whose radius is not above 0")]


def _misfits_of(what: str, numbers: np.ndarray, way: np.ndarray) -> list[tuple[np.ndarray, str]]:
    finite = np.isfinite(np.concatenate([numbers, way], -1)).all(-1)
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(way, axis=-1)
    return [(np.asarray(~finite), f"{what} that is not finite"),
            (np.asarray(finite & ~((length > 0.0) & np.isfinite(length))),
             f"{what} whose direction has no length, or none that can be told")]


def _check_options(name: str, options: object, kind: type) -> None:
    if options is not None and not isinstance(options, kind):
        raise ProbeError(f"{name}.options is {type(options).__name__}; should be {kind.__name__}")


def _whole(name: str, value: np.ndarray) -> np.ndarray:
    """An array without a mask of NumPy's own, which would be lost without a word."""
    if np.ma.is_masked(value):
        raise ProbeError(f"{name} is a masked array; should be a plain one. What is not to be made "
                         "is said by `wanted`")
    return np.asarray(value)


def _checked(name: str, value: np.ndarray, worlds: int, width: int) -> np.ndarray:
    array = _whole(name, value)
    if array.ndim != 3 or array.shape[0] != worlds or array.shape[2] != width or (
            array.dtype.kind not in "fiu"):
        raise ProbeError(f"{name} is {array.dtype} of shape {array.shape}; "
                         f"should be numbers of shape (world {worlds}, any, {width})")
    if array.shape[1] > MOST_PROBES:
        raise ProbeError(f"{name} has {array.shape[1]:,} rows a world; should have at most "
                         f"{MOST_PROBES:,} in one answer")
    return array


def _mask(name: str, value: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    if value is None:
        return np.ones(shape, bool)
    array = _whole(name, value)
    if array.shape != shape or array.dtype != bool:
        raise ProbeError(f"{name} is {array.dtype} of shape {array.shape}; "
                         f"should be bool of shape {shape}")
    return array
