"""Bodies on the host: what an object is made of, its extent and content, and the kernels' scene."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import hypot
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.core.array_checks import check_range
from warpgrasp.core.dtypes import real, transform, vec2, vec3, vec4
from warpgrasp.core.kernel_launch import ShapeError, array_of, launch
from warpgrasp.geometry.scene import (
    Join,
    Primitive,
    Scene,
    Shape,
    distance_kernel,
    signed_distance_kernel,
)
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape

_EMPTY = np.zeros((0, 2))
_NO_GRID = np.zeros((0, 0, 0), np.float32)
_UNIT = 1e-6
"""By how much a quaternion may be longer or shorter than 1, and a capsule shorter than its ends."""


class BodyError(ValueError):
    """An object that cannot be built; the message says what is wrong and what would be right."""


def _check(name: str, value: Any, right: bool, wanted: str) -> None:
    """Raise BodyError where a value is not right, with what is wanted."""
    if not right:
        text = " ".join(repr(value).split())
        raise BodyError(f"{name} = {text[:77] + '...' if len(text) > 80 else text}: {wanted}")


def _are_numbers(values: Any, *shape: int | None) -> bool:
    """Whether values are finite numbers of a shape, None for any length."""
    try:
        array = np.asarray(values)
        return (array.dtype.kind in "iuf" and array.ndim == len(shape)
                and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
                and bool(np.isfinite(array).all()))
    except (TypeError, ValueError):  # rows of several lengths
        return False


@dataclass(frozen=True)
class Part:
    """One placed primitive of a body. Which fields count depends on `shape`.

    Raises BodyError for fields that are no such primitive: kernels take them at their word.
    """

    shape: Shape
    join: Join = Join.UNION
    place: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    """Position [m] and quaternion xyzw of the primitive in the body's frame."""
    size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Block, wedge: full size. Cylinder, capsule: radius, -, height. Sphere: radius."""
    superquadric: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    """a1, a2, a3 [m], eps1, eps2, Kx, Ky, bend [1/m], bend direction [rad]."""
    profile_m: np.ndarray = field(default_factory=lambda: _EMPTY)
    """Revolution: (z, r) [m], shape (point, 2), z rising."""
    grid_m: np.ndarray = field(default_factory=lambda: _NO_GRID)
    """Baked distances at nodes [m], shape (nx, ny, nz), float32."""
    grid_origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grid_cell_m: float = 0.0

    def __post_init__(self) -> None:
        _check("shape", self.shape, self.shape in tuple(Shape), "one of Shape is wanted")
        _check("join", self.join, self.join in tuple(Join), "one of Join is wanted")
        _check("place", self.place, _are_numbers(self.place, 7)
               and abs(hypot(*self.place[3:]) - 1.0) < _UNIT,
               "a position [m] and a quaternion xyzw of length 1 are wanted, seven numbers")
        if self.shape == Shape.SUPERQUADRIC:
            self._check_superquadric()
        elif self.shape == Shape.REVOLUTION:
            z_r = self.profile_m
            good = _are_numbers(z_r, None, 2) and len(z_r) >= 2
            _check("profile_m", z_r, good and bool(
                (np.diff(z_r, axis=0)[:, 0] > 0.0).all() and np.min(z_r, axis=0)[1] >= 0.0
                and np.max(z_r, axis=0)[1] > 0.0),
                "two rows (z, r) [m] at least are wanted, z rising, no r negative, one above 0")
        elif self.shape == Shape.GRID:
            _check("grid_m", self.grid_m, _are_numbers(self.grid_m, None, None, None)
                   and min(self.grid_m.shape) >= 2, "distances [m] at (nx, ny, nz) nodes are "
                   "wanted, at least two along each axis")
            _check("grid_cell_m", self.grid_cell_m,
                   _are_numbers(self.grid_cell_m) and self.grid_cell_m > 0.0,
                   "a length above 0 is wanted")
            _check("grid_origin_m", self.grid_origin_m, _are_numbers(self.grid_origin_m, 3),
                   "a position [m] is wanted")
        else:
            self._check_size()

    def _check_size(self) -> None:
        """Raise BodyError where `size_m` is not that of a block, wedge, cylinder, capsule or
        sphere."""
        count, wanted = {
            Shape.SPHERE: ([0], "(radius, 0, 0)"),
            Shape.CYLINDER: ([0, 2], "(radius, 0, height)"),
            Shape.CAPSULE: ([0, 2], "(radius, 0, height), the height twice the radius or more,"),
        }.get(self.shape, ([0, 1, 2], "(x, y, z)"))
        size = self.size_m
        _check("size_m", size, _are_numbers(size, 3) and all(size[k] > 0.0 for k in count)
               and (self.shape != Shape.CAPSULE or size[2] >= (2.0 - _UNIT) * size[0]),
               f"lengths {wanted} above 0 [m] are wanted of a {Shape(self.shape).name.lower()}")

    def _check_superquadric(self) -> None:
        """Raise BodyError where `superquadric` is none."""
        given = self.superquadric
        good = _are_numbers(given, 9) and min(given[:5]) > 0.0 and max(given[3:5]) <= 2.0
        _check("superquadric", given, good and max(map(abs, given[5:7])) <= 1.0
               and 0.0 <= given[7] * max(given[:3]) < 1.0,  # beyond, the body folds over
               "half axes above 0 [m], exponents above 0 to 2, tapers from -1 to 1, a bend from 0 "
               "to below 1 / the largest half axis [1/m] and its direction [rad] are wanted, nine "
               "numbers")


@dataclass(frozen=True)
class Body:
    """An object standing on z = 0 of its own frame, about the z axis.

    Raises BodyError for parts that are none, a first part that is no union, and corners that are
    those of no box.
    """

    name: str
    parts: tuple[Part, ...]
    low_m: tuple[float, float, float]
    """Corners of a box that holds the body, shape (3,)."""
    high_m: tuple[float, float, float]
    doc: str = ""
    grid_error_m: float = 0.0
    """Largest measured error of a baked grid near the surface; 0 for formulas."""

    def __post_init__(self) -> None:
        _check(f"{self.name}: parts", self.parts, len(self.parts) > 0
               and all(isinstance(part, Part) for part in self.parts)
               and self.parts[0].join == Join.UNION,
               "one Part at least is wanted, the first a union")
        box = (self.low_m, self.high_m)
        _check(f"{self.name}: (low_m, high_m)", box, _are_numbers(box, 2, 3)
               and all(low <= high for low, high in zip(*box, strict=True)),
               "two corners [m] are wanted, the lower one first")

    @property
    def content(self) -> str:
        """A hash of the body's shape; neither the name nor the types of its numbers enter."""
        digest = hashlib.sha256()
        for part in self.parts:
            numbers = (tuple(map(float, values)) for values in (
                part.place, part.size_m, part.superquadric, part.grid_origin_m))
            digest.update(repr((int(part.shape), int(part.join), *numbers,
                                float(part.grid_cell_m))).encode())
            digest.update(np.ascontiguousarray(part.profile_m, float).tobytes())
            digest.update(np.ascontiguousarray(part.grid_m, np.float32).tobytes())
        return digest.hexdigest()[:16]

    @property
    def has_exact_distance(self) -> bool:
        """Whether the signed distance is the true one everywhere, not a bound or an estimate."""
        return len(self.parts) == 1 and self.parts[0].shape not in (Shape.SUPERQUADRIC, Shape.GRID)


def scene_of(bodies: Sequence[Body], device: str) -> Scene:
    """The kernels' table of several bodies, body k being `bodies[k]`."""
    rows: list[Primitive] = []
    profiles: list[np.ndarray] = []
    grids: list[np.ndarray] = []
    firsts = [0]
    profile_count = grid_count = 0
    for body in bodies:
        for part in body.parts:
            row = Primitive()
            row.shape, row.join = int(part.shape), int(part.join)
            row.placed = int(part.place != (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            row.to_body = transform(*part.place)
            row.size = vec3(*part.size_m)
            s = SuperquadricShape()
            s.size = vec3(*part.superquadric[:3])
            s.e1, s.e2, s.kx, s.ky, s.bend, s.bend_angle = part.superquadric[3:]
            row.superquadric = s
            if part.shape == Shape.REVOLUTION:
                row.first, row.count = profile_count, len(part.profile_m)
                profiles.append(part.profile_m)
                profile_count += len(part.profile_m)
            elif part.shape == Shape.GRID:
                row.first = grid_count
                row.nodes = wp.vec3i(*part.grid_m.shape)
                row.origin = vec3(*part.grid_origin_m)
                row.cell = part.grid_cell_m
                grids.append(part.grid_m.ravel())
                grid_count += part.grid_m.size
            rows.append(row)
        firsts.append(len(rows))
    arrays = {
        "body_first": wp.array(firsts, dtype=int, device=device),
        "primitives": wp.array(rows, dtype=Primitive, device=device),
        "profile": wp.array(np.concatenate(profiles) if profiles else np.zeros((1, 2)),
                            dtype=vec2, device=device),
        "grid": wp.array(np.concatenate(grids) if grids else np.zeros(1, np.float32),
                         dtype=wp.float32, device=device)}
    scene = Scene()
    for name, array in arrays.items():
        setattr(scene, name, array.ptr)
    scene.bodies, scene.primitive_count = len(bodies), len(rows)
    scene.__dict__["kept"] = arrays  # as long as the scene lives, so do its arrays
    scene.__dict__["device"] = arrays["primitives"].device
    return scene


def distance_to_bodies(
    scene: Scene, body: np.ndarray, points_m: np.ndarray, *, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """Signed distances [m], shape (world, point), and gradients, shape (world, point, 3).

    `points_m` has shape (world, point, 3) and is in the frame of body number `body[world]` (shape
    (world,) or (1,), shared). Raises ShapeError where shapes disagree or the scene is on another
    device, ValueError for a body that the scene has not.
    """
    values = _asked(distance_kernel, vec4, scene, body, points_m, device)
    return values[..., 3], values[..., :3]


def distances_of(body: Body) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """`distance_to_bodies` of one body, as a function of points (point, 3) in its frame: signed
    distances [m], (point,), and gradients, (point, 3)."""
    scene = scene_of([body], "cpu")

    def distances(points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, slope = distance_to_bodies(scene, np.zeros(1, int), points_m[None])
        return found[0], slope[0]

    return distances


def signed_distance_to_bodies(
    scene: Scene, body: np.ndarray, points_m: np.ndarray, *, device: str = "cpu"
) -> np.ndarray:
    """The distances [m] of `distance_to_bodies` alone, (world, point), in half of the time; it
    raises the same errors."""
    return _asked(signed_distance_kernel, real, scene, body, points_m, device)


def _asked(
    kernel: Any, answer: Any, scene: Scene, body: np.ndarray, points_m: np.ndarray, device: str
) -> np.ndarray:
    """What one of the scene's kernels, whose numbers are of the type `answer`, says of points."""
    check_range("body", body, 0, scene.bodies - 1)
    if np.ndim(points_m) != 3 or np.shape(points_m)[2] != 3:
        raise ShapeError(f"points_m: of shape {np.shape(points_m)}; should be (world, point, 3)")
    points_m = np.asarray(points_m)
    worlds, count = points_m.shape[:2]
    found = wp.empty((worlds, count), dtype=answer, device=device)
    launch(kernel, {"world": worlds, "point": count},
           {"body": "world?", "point": "world point", "found": "world point"},
           {"scene": scene, "body": array_of(body, int, device),
            "point": array_of(points_m, vec3, device), "found": found}, device=device)
    return found.numpy()
