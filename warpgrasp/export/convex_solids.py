"""An object as the convex solids other simulators know: boxes, cylinders, meshes.

Profiles of revolution become slices that are convex (64-sided, the polygon's radii lying half
inside and half outside the circle: within 0.06 % of the radius), so that engines which collide
convex hulls keep their necks. Superquadrics become ellipsoids or meshes of their surface.
"""

from dataclasses import dataclass, field

import numpy as np

from warpgrasp.geometry.body import Body, BodyError, Part
from warpgrasp.geometry.scene import Join, Shape

_SIDES = 64
_HOLLOW = 5e-3  # share of a body's volume that its hull may have filled
_INSTEAD = "export a mesh of it, which MuJoCo needs in convex pieces (CoACD makes them)"
_NONE = np.zeros((0, 3))


@dataclass(frozen=True)
class Solid:
    """One solid in the object's frame; numbers by kind, [m].

    box: full size; cylinder, capsule: radius, height; sphere: radius; ellipsoid: half axes;
    mesh: `vertices` (n, 3), `faces` (m, 3). All but meshes are centred on `place` (xyz, xyzw).
    """

    kind: str
    size: tuple[float, ...]
    place: tuple[float, ...]
    vertices: np.ndarray = field(default_factory=lambda: _NONE)
    faces: np.ndarray = field(default_factory=lambda: _NONE)


def object_solids(
    body: Body, triangles: tuple[np.ndarray, np.ndarray] | None = None
) -> list[Solid]:
    """The solids of a body; a baked mesh needs its `triangles` (vertices, faces).

    Raises BodyError for what these formats cannot express: parts taken away, bends, and tapers that
    leave a hollow.
    """
    if any(part.join != Join.UNION for part in body.parts):
        raise BodyError(f"{body.name}: MJCF and URDF know no difference or intersection of solids; "
                        f"{_INSTEAD}")
    solids: list[Solid] = []
    for part in body.parts:
        solids += _part_solids(body.name, part, triangles)
    return solids


def _part_solids(
    name: str, part: Part, triangles: tuple[np.ndarray, np.ndarray] | None
) -> list[Solid]:
    x, y, z = part.size_m
    lifted = _lifted(part.place, z / 2)
    if part.shape == Shape.BLOCK:
        return [Solid("box", (x, y, z), lifted)]
    if part.shape == Shape.CYLINDER:
        return [Solid("cylinder", (x, z), lifted)]
    if part.shape == Shape.CAPSULE and z > 2 * x:
        return [Solid("capsule", (x, z), lifted)]
    if part.shape in (Shape.SPHERE, Shape.CAPSULE):
        return [Solid("sphere", (x,), _lifted(part.place, x))]
    if part.shape == Shape.WEDGE:
        corners = [[sx * x / 2, sy * y / 2, 0.0] for sx in (-1, 1) for sy in (-1, 1)]
        return [_hull(np.array([*corners, [0.0, -y / 2, z], [0.0, y / 2, z]]), part.place)]
    if part.shape == Shape.REVOLUTION:
        return [_hull(_rings(run), part.place) for run in convex_runs(part.profile_m)]
    if part.shape == Shape.SUPERQUADRIC:
        return [_superquadric(name, part)]
    if triangles is None:
        raise BodyError(f"{name}: a mesh is exported from its file, with --units")
    return [Solid("mesh", (), part.place, *triangles)]


def hull_excess(solid: Solid) -> float:
    """By what share of its volume the convex hull of a mesh is larger than the mesh, 0 within
    `_HOLLOW`: MuJoCo and most simulators touch the hull."""
    share = _volume(_hull(solid.vertices, solid.place)) / _volume(solid) - 1.0
    return share if share > _HOLLOW else 0.0


def convex_runs(profile: np.ndarray) -> list[np.ndarray]:
    """A radius profile (z, r) cut into the longest runs from below whose solids are convex."""
    slope = np.diff(profile[:, 1]) / np.diff(profile[:, 0])
    runs, first = [], 0
    for k in range(1, len(slope)):
        if slope[k] > slope[k - 1] + 1e-9:
            runs.append(profile[first:k + 1])
            first = k
    return [*runs, profile[first:]]


def _rings(profile: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    radius = profile[:, 1:] * 2.0 / (1.0 + np.cos(np.pi / _SIDES))
    height = np.repeat(profile[:, :1], _SIDES, 1)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1).reshape(-1, 3)


def _superquadric(name: str, part: Part) -> Solid:
    a1, a2, a3, e1, e2, kx, ky, bend, _ = part.superquadric
    if bend > 0.0:
        raise BodyError(f"{name}: a bent superquadric is not convex; {_INSTEAD}")
    if (e1, e2, kx, ky) == (1.0, 1.0, 0.0, 0.0):
        return Solid("ellipsoid", (a1, a2, a3), part.place)
    u, v = np.meshgrid(np.linspace(-1, 1, 65), np.linspace(-1, 1, 129), indexing="ij")
    s, t = np.sin(u * np.pi / 2), np.cos(u * np.pi / 2)
    x = np.abs(t) ** e1 * np.sign(np.cos(np.pi * v)) * np.abs(np.cos(np.pi * v)) ** e2
    y = np.abs(t) ** e1 * np.sign(np.sin(np.pi * v)) * np.abs(np.sin(np.pi * v)) ** e2
    z = np.sign(s) * np.abs(s) ** e1
    points = np.stack([a1 * x * (1 + kx * z), a2 * y * (1 + ky * z), a3 * z], -1)
    solid = _hull(points.reshape(-1, 3), part.place)
    if _volume(solid) > (1.0 + _HOLLOW) * _ring_volume(points):
        raise BodyError(f"{name}: a superquadric of this taper is not convex; "
                        f"{_INSTEAD}")
    return solid


def _volume(solid: Solid) -> float:
    return float(np.linalg.det(solid.vertices[solid.faces]).sum()) / 6.0


def _ring_volume(rings: np.ndarray) -> float:
    """Volume between closed rings of points, one above the other, (ring, point, 3)."""
    def area(ring: np.ndarray) -> np.ndarray:
        x, y = ring[..., 0], ring[..., 1]
        return 0.5 * (x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(1)

    low, high = rings[:-1], rings[1:]
    rise = high[:, 0, 2] - low[:, 0, 2]
    return float(rise @ (area(low) + 4.0 * area((low + high) / 2.0) + area(high))) / 6.0


def _hull(points: np.ndarray, place: tuple[float, ...]) -> Solid:
    from scipy.spatial import ConvexHull

    points = np.unique(np.round(points, 9), axis=0)
    hull = ConvexHull(points)
    used = np.unique(hull.simplices)
    faces = np.searchsorted(used, hull.simplices)
    vertices = points[used]
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = (normal * hull.equations[:, :3]).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Solid("mesh", (), place, vertices, faces)


def _lifted(place: tuple[float, ...], height: float) -> tuple[float, ...]:
    """Our primitives stand on z = 0 of their frame; other formats centre them."""
    from scipy.spatial.transform import Rotation

    up = Rotation.from_quat(place[3:]).apply([0.0, 0.0, height])
    return (*(float(p + u) for p, u in zip(place[:3], up, strict=True)), *place[3:])
