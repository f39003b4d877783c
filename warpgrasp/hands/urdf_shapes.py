"""Collision shapes of a URDF's links: boxes and balls as they are, cylinders with a ball at either
end as capsules, other cylinders and meshes as fitted capsules, or as boxes where these are nearer.
"""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from warpgrasp.hands.capsule_fit import capsule_of_cylinder, fit_shape
from warpgrasp.hands.hand_checks import MOST_SHAPE_M
from warpgrasp.hands.hand_frames import place_of
from warpgrasp.hands.hand_model import (
    UNITS_OF_FILES,
    Box,
    Capsule,
    HandError,
    Shape,
    Vector,
    vector_of,
)

_LEAST_M = 1e-6


def shapes_of(file: Path, link: Any, frame: np.ndarray) -> list[tuple[Shape, Capsule | None]]:
    """The shapes of a link, `frame` (4, 4) in the frame that they are wanted in; of a cylinder also
    the capsule that it is with a ball at either end (`with_capsules`).

    Raises HandError for a shape without size and a mesh that is missing or flat.
    """
    found: list[Shape] = []
    rods: dict[int, Capsule] = {}  # by place in `found`
    for collision in link.collisions:
        geometry = collision.geometry
        where = f"{file}: link {link.name}"
        origin = np.eye(4) if collision.origin is None else np.asarray(collision.origin)
        if not np.isfinite(origin).all():
            raise HandError(f"{where}: a collision's origin is not finite; should be")
        at = frame @ origin
        if geometry is None:
            raise HandError(f"{where}: a collision without geometry; should have a shape")
        if geometry.box is not None:
            x, y, z = _sizes(where, "box", geometry.box.size, 3)
            found.append(Box(place_of(at), (x, y, z)))
        elif geometry.sphere is not None:
            radius, = _sizes(where, "sphere", [geometry.sphere.radius], 1)
            found.append(Capsule(vector_of(at[:3, 3]), vector_of(at[:3, 3]), radius))
        elif geometry.cylinder is not None:
            radius, length = _sizes(where, "cylinder", [geometry.cylinder.radius,
                                                        geometry.cylinder.length], 2)
            rods[len(found)] = _along(at, length / 2, radius)
            if length < radius:  # a plate: a box of as large an area is nearer than any capsule
                side = radius * np.sqrt(np.pi)
                found.append(Box(place_of(at), (side, side, length)))
            else:
                half, fitted, error = capsule_of_cylinder(radius, length)
                found.append(_along(at, half, fitted, error))
        else:
            mesh = geometry.mesh
            scale = 1.0 if mesh.scale is None else np.asarray(mesh.scale, float)
            if not np.isfinite(scale).all():
                raise HandError(f"{where}: mesh {mesh.filename}: its scale is not finite; should "
                                "be")
            vertices = _vertices(where, file, mesh.filename) * scale
            if (size := float(np.ptp(vertices, axis=0).max())) > MOST_SHAPE_M:
                raise HandError(f"{where}: mesh {mesh.filename} is {size:.4g} m long; should be "
                                f"less than {MOST_SHAPE_M:g} m: a mesh in mm has "
                                'scale="0.001 0.001 0.001"')
            found.append(_fitted(f"{where}: mesh {mesh.filename}", vertices, at))
    return [(shape, rods.get(n)) for n, shape in enumerate(found)]


def with_capsules(found: list[tuple[Shape, Capsule | None]]) -> tuple[Shape, ...]:
    """The shapes of links that are one body, with capsules in place of those of their cylinders
    that have balls as thick at both ends, and without these balls: URDF has no capsule."""
    shapes = [shape for shape, _ in found]
    caps: set[int] = set()
    for n, (_, rod) in enumerate(found):
        if rod is None:
            continue
        own = [{k for k, shape in enumerate(shapes) if _is_ball(shape, end, rod.radius)}
               for end in (rod.start, rod.end)]
        if all(own):
            shapes[n] = rod
            caps |= set.union(*own)
    return tuple(shape for k, shape in enumerate(shapes) if k not in caps)


def _is_ball(shape: Shape, centre: Vector, radius: float) -> bool:
    return (isinstance(shape, Capsule) and shape.start == shape.end
            and abs(shape.radius - radius) < _LEAST_M and math.dist(shape.start, centre) < _LEAST_M)


def _sizes(where: str, kind: str, numbers: Any, wanted: int) -> list[float]:
    values = [float(v) for v in numbers]
    if len(values) != wanted:
        raise HandError(f"{where}: a {kind} of {len(values)} sizes; should have {wanted}")
    if not all(_LEAST_M < v < MOST_SHAPE_M for v in values):
        raise HandError(f"{where}: a {kind} of {' x '.join(f'{v:g}' for v in values)} m; every "
                        f"size should be more than 0 and less than {MOST_SHAPE_M:g} m: "
                        f"{UNITS_OF_FILES}")
    return values


def _along(at: np.ndarray, half_m: float, radius_m: float, fit_error_m: float = 0.0) -> Capsule:
    """A capsule along the z axis of a frame (4, 4)."""
    start, end = (at[:3, 3] + way * at[:3, 2] for way in (-half_m, half_m))
    return Capsule(vector_of(start), vector_of(end), radius_m, fit_error_m)


def _fitted(where: str, vertices: np.ndarray, at: np.ndarray) -> Shape:
    try:
        return fit_shape(vertices @ at[:3, :3].T + at[:3, 3])
    except ValueError as error:
        raise HandError(f"{where}: {error}; a shape should have a volume") from None


def _vertices(where: str, urdf: Path, name: str) -> np.ndarray:
    path = _mesh_path(urdf, name)
    if path is None:
        raise HandError(f"{where}: mesh {name} is missing; should be a file, its path relative to "
                        f"{urdf.parent}")
    try:
        mesh: Any = trimesh.load(path, force="mesh", process=False)
        if mesh.units is not None:  # of COLLADA, which says how long its unit is
            mesh.convert_units("meters")
        mesh.remove_unreferenced_vertices()
        vertices = np.asarray(mesh.vertices, float)
    except Exception as error:  # whatever a reader of meshes comes upon
        raise HandError(f"{where}: mesh {name} cannot be read: {error}; should be STL, OBJ, "
                        "PLY or DAE") from None
    if len(vertices) < 4 or not np.isfinite(vertices).all():
        raise HandError(f"{where}: mesh {name} has {len(vertices)} vertices; should be at least 4")
    return vertices


def _mesh_path(urdf: Path, name: str) -> Path | None:
    """A mesh's file: relative to the URDF, or of a package, sought in the folders above it. Where
    none has its package's name, a folder may be the package under another name."""
    plain = name.removeprefix("file://")
    if not name.startswith("package://"):
        path = urdf.parent / plain
        return path if path.is_file() else None
    whole = name.removeprefix("package://")
    package, _, inner = whole.partition("/")
    above = [urdf.parent, *urdf.resolve().parents]
    renamed = [folder for folder in above if not _is_another(folder, package)]
    paths = [*(folder / whole for folder in above), *(folder / inner for folder in renamed)]
    return next((path for path in paths if path.is_file()), None)


def _is_another(folder: Path, package: str) -> bool:
    """Whether a folder is a ROS package of another name."""
    manifest = folder / "package.xml"
    return manifest.is_file() and not re.search(
        rf"<name>\s*{re.escape(package)}\s*</name>", manifest.read_text(errors="replace"))
