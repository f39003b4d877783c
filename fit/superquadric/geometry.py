"""Geometry of superquadrics in NumPy, in batch: inside-outside function, volume, surface.

The inside-outside function of Allen and Michelman (1990), equation (1), is

    F = ((x/a1)^(2/e2) + (y/a2)^(2/e2))^(e2/e1) + (z/a3)^(2/e1),   inside where F < 1,

with a linear taper, then a circular bend, then the pose (Solina and Bajcsy 1990):

    taper  x -> x (Kx z/a3 + 1),  y -> y (Ky z/a3 + 1)
    bend   by the angle k z in the plane that contains z and the direction alpha in x, y

A cylinder along z has e1 ~ 0.1 and e2 ~ 1. Lengths in metres, the bend's curvature k in 1/m.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import beta

from fit.option_checks import checked_array
from fit.rotation import matrix_of_quaternion
from fit.superquadric.record import SuperquadricFit

TINY = 1e-20
"""Added to squared scaled coordinates, so that logarithms are finite."""
UNIT = 1e-6
"""By how much a quaternion may be longer or shorter than 1."""
MIN_TAPER_FACTOR = 0.02
"""Least scale of a tapered section, so that it never shrinks to a point."""


class Superquadric(NamedTuple):
    """Parameters of bodies; the first axis of every field is the fit."""

    size_m: np.ndarray
    """Half extents a1, a2, a3 [m], shape [fit, 3]."""
    exponents: np.ndarray
    """e1 (along z) and e2 (across), shape [fit, 2]."""
    position_m: np.ndarray
    """Centre [m], shape [fit, 3]."""
    quaternion_xyzw: np.ndarray
    """Orientation, body to world, shape [fit, 4]."""
    taper: np.ndarray
    """Kx, Ky in [-1, 1], shape [fit, 2]."""
    bend: np.ndarray
    """Curvature [1/m] and direction alpha [rad], shape [fit, 2]."""


SuperquadricLike = Superquadric | SuperquadricFit
"""A record with the parameters of superquadrics."""


def superquadric(
    size_m, exponents, position_m=(0, 0, 0), quaternion_xyzw=(0, 0, 0, 1), taper=(0, 0), bend=(0, 0)
) -> Superquadric:
    """A `Superquadric` from single values and batches, shapes [n] or [fit, n].

    Raises ValueError for batches of several lengths or of other widths, and for numbers that are
    those of no superquadric. A body of NaN is one that is not known.
    """
    fields = [checked_array(name, np.atleast_2d(value), (None, width)) for name, value, width in (
        ("size_m", size_m, 3), ("exponents", exponents, 2), ("position_m", position_m, 3),
        ("quaternion_xyzw", quaternion_xyzw, 4), ("taper", taper, 2), ("bend", bend, 2))]
    counts = {len(v) for v in fields} - {1}
    if len(counts) > 1:
        raise ValueError(f"superquadric: batches of {', '.join(map(str, sorted(counts)))}, should "
                         "be of one length")
    count = counts.pop() if counts else 1
    body = Superquadric(*(np.broadcast_to(v, (count, v.shape[1])) for v in fields))
    length = np.linalg.norm(body.quaternion_xyzw, axis=1, keepdims=True)
    for name, wrong, wanted in (
            ("size_m", body.size_m <= 0.0, "above 0"),
            ("exponents", body.exponents <= 0.0, "above 0"),
            ("quaternion_xyzw", np.abs(length - 1.0) > UNIT, "of length 1"),
            ("taper", np.abs(body.taper) > 1.0, "from -1 to 1"),
            ("bend", body.bend < [0.0, -np.inf],
             "of a curvature from 0: turn its direction by pi instead")):
        if (rows := wrong.any(axis=1)).any():
            raise ValueError(f"{name}: {getattr(body, name)[rows][0].tolist()}, should be {wanted}")
    return body


def as_points(body: SuperquadricLike, points) -> Float[np.ndarray, "fit point 3"]:
    """Points as an array, for each of the bodies. Raises ValueError for another shape: rows of one
    set would be taken for sets."""
    points = checked_array("points", points, (None, None, 3))
    if len(points) != len(body.size_m) and 1 not in (len(points), len(body.size_m)):
        raise ValueError(f"points: {len(points)} sets for {len(body.size_m)} bodies, should be one "
                         "each")
    return points


def log_sum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """log(exp a + exp b), in half the time of `np.logaddexp`."""
    return np.maximum(a, b) + np.log1p(np.exp(-np.abs(a - b)))


def superquadric_inside_outside(
    body: SuperquadricLike, points: Float[np.ndarray, "fit point 3"]
) -> Float[np.ndarray, "fit point"]:
    """F^(e1/2) of points [m]: the scaled radius, 1 on the surface, < 1 inside.

    F = value ** (2 / e1) would overflow for small exponents. Raises ValueError for points of
    another shape.
    """
    x, y, z = straight_coordinates(body, as_points(body, points))
    e1, e2 = body.exponents[:, 0, None], body.exponents[:, 1, None]
    lx, ly, lz = (np.log((c / a[:, None]) ** 2 + TINY)
                  for c, a in zip((x, y, z), body.size_m.T, strict=True))
    section = e2 * log_sum(lx / e2, ly / e2)
    return np.exp(0.5 * e1 * log_sum(section / e1, lz / e1))


def superquadric_volume(body: SuperquadricLike) -> Float[np.ndarray, " fit"]:
    """Volume [m^3], exact: the superellipsoid's (Jaklic et al. 2000) times 1 + Kx Ky <(z/a3)^2>.

    Odd powers of z cancel. A bend keeps the volume of a body that does not fold, since it
    lengthens the outer half of each section as much as it shortens the inner one.
    """
    e1, e2 = body.exponents.T
    plain = 2 * np.prod(body.size_m, axis=1) * e1 * e2 * beta(e1 / 2 + 1, e1) * beta(e2 / 2, e2 / 2)
    mean_square_height = beta(1.5 * e1, e1 + 1) / beta(0.5 * e1, e1 + 1)
    return plain * (1 + body.taper[:, 0] * body.taper[:, 1] * mean_square_height)


def superquadric_surface(
    body: SuperquadricLike, n: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At least `n` surface points [m], outward unit normals, and the area [m^2] of each point.

    Shapes [fit, point, 3], [fit, point, 3], [fit, point]; the smallest 6 k^2 >= n points. A grid
    on a cube is projected radially in the frame scaled by the sizes, which covers faces and
    corners; the areas are those of the projected quadrilaterals.
    """
    vector = _facets(body, n)
    area = np.linalg.norm(vector, axis=-1)
    points = superquadric_points(body, n)
    normals = superquadric_normals(body, points)
    # Without a gradient, at a corner, use the normal of the facet.
    facet = vector / np.maximum(area, 1e-300)[..., None]
    found = np.isfinite(normals).all(axis=-1, keepdims=True)
    return points, np.where(found, normals, facet), area


def superquadric_areas(body: SuperquadricLike, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] and areas [m^2] of `superquadric_surface`."""
    return superquadric_points(body, n), np.linalg.norm(_facets(body, n), axis=-1)


def superquadric_areas_of(
    body: SuperquadricLike, n: int, chosen: Int[np.ndarray, "fit chosen"]
) -> Float[np.ndarray, "fit chosen"]:
    """Areas [m^2] of the points `chosen` of `superquadric_points` with the same `n`."""
    return np.linalg.norm(_facets(body, n, chosen), axis=-1)


def _facets(body: SuperquadricLike, n: int, chosen: np.ndarray | None = None) -> np.ndarray:
    """Area times outward normal [m^2] of each quadrilateral, shape [fit, point, 3]; of those
    `chosen` [fit, point] alone."""
    corners, vertices = cube_grid(max(int(np.ceil(np.sqrt(n / 6))), 1))
    vertices = _placed(body, *_project(body, vertices))
    quads = (vertices[:, corners] if chosen is None
             else vertices[np.arange(len(vertices))[:, None, None], corners[chosen]])
    ax, ay, az = _planes(quads[:, :, 2] - quads[:, :, 0])
    bx, by, bz = _planes(quads[:, :, 3] - quads[:, :, 1])
    return 0.5 * np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def superquadric_points(
    body: SuperquadricLike, n: int, chosen: Int[np.ndarray, "fit chosen"] | None = None
) -> Float[np.ndarray, "fit point 3"]:
    """Points [m] of `superquadric_surface`; those `chosen` alone."""
    directions = _directions(n)
    return _placed(body, *_project(body, directions if chosen is None else directions[chosen]))


def superquadric_heights(body: SuperquadricLike, n: int) -> Float[np.ndarray, "fit point"]:
    """Heights [m] of `superquadric_points`."""
    return _placed(body, *_project(body, _directions(n)), axes=(2,))[..., 0]


def _directions(n: int) -> np.ndarray:
    """Middles of the quadrilaterals of `superquadric_surface` on the cube, (point, 3)."""
    corners, vertices = cube_grid(max(int(np.ceil(np.sqrt(n / 6))), 1))
    return vertices[corners].mean(axis=1)


def superquadric_normals(
    body: SuperquadricLike, points: Float[np.ndarray, "fit point 3"]
) -> Float[np.ndarray, "fit point 3"]:
    """Outward unit normals at points on or near the surface: directions of `radius_differences`.

    Raises ValueError for points of another shape.
    """
    gradient, _ = radius_differences(body, as_points(body, points))
    with np.errstate(invalid="ignore"):
        return gradient / np.linalg.norm(gradient, axis=-1, keepdims=True)


def radius_differences(
    body: SuperquadricLike, points: Float[np.ndarray, "fit point 3"]
) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of the scaled radius at points, and their step [m], shape [fit, 1].

    The step is a millionth of the smallest size; the derivative is difference / (2 step).
    """
    step = 1e-6 * body.size_m.min(axis=1)[:, None]
    difference = np.empty_like(points, dtype=float)
    for axis in range(3):
        offset = np.zeros((len(points), 1, 3))
        offset[:, :, axis] = step
        up, down = (superquadric_inside_outside(body, points + s * offset) for s in (1, -1))
        difference[..., axis] = up - down
    return difference, step


def from_straight_frame(body: SuperquadricLike, points: np.ndarray) -> np.ndarray:
    """World points [m] from points [m] in the frame before taper and bend, [fit, point, 3].

    Raises ValueError for points of another shape.
    """
    return _placed(body, *_planes(as_points(body, points)))


def _planes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates of points [..., 3], each contiguous: arithmetic is twice as fast on them."""
    x, y, z = (np.ascontiguousarray(points[..., k]) for k in range(3))
    return x, y, z


def _placed(body: SuperquadricLike, x, y, z, axes: tuple[int, ...] = (0, 1, 2)) -> np.ndarray:
    """`from_straight_frame` of coordinates, each of shape [fit, point]; along `axes` alone."""
    height = np.clip(z / body.size_m[:, 2, None], -1.0, 1.0)
    x = x * np.maximum(1 + body.taper[:, 0, None] * height, MIN_TAPER_FACTOR)
    y = y * np.maximum(1 + body.taper[:, 1, None] * height, MIN_TAPER_FACTOR)
    if body.bend[:, 0].any():
        x, y, z = _bent(body, x, y, z)
    # Written out: einsum takes longer, and the rounding of a matrix product depends on layout.
    rotation = matrix_of_quaternion(body.quaternion_xyzw)[..., None]
    placed = np.empty((*x.shape, len(axes)))
    for at, k in enumerate(axes):
        placed[..., at] = (rotation[:, k, 0] * x + rotation[:, k, 1] * y + rotation[:, k, 2] * z
                           + body.position_m[:, k, None])
    return placed


def straight_coordinates(
    body: SuperquadricLike, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverse of `from_straight_frame`: x, y and z, each of shape [fit, point]."""
    rotation = matrix_of_quaternion(body.quaternion_xyzw)[..., None]
    dx, dy, dz = (points[..., k] - body.position_m[:, k, None] for k in range(3))
    # Written out: einsum takes eleven times as long.
    x, y, z = (dx * rotation[:, 0, k] + dy * rotation[:, 1, k] + dz * rotation[:, 2, k]
               for k in range(3))
    if body.bend[:, 0].any():
        x, y, z = _unbent(body, x, y, z)
    height = np.clip(z / body.size_m[:, 2, None], -1.0, 1.0)
    x = x / np.maximum(1 + body.taper[:, 0, None] * height, MIN_TAPER_FACTOR)
    y = y / np.maximum(1 + body.taper[:, 1, None] * height, MIN_TAPER_FACTOR)
    return x, y, z


def _bent(body: SuperquadricLike, x, y, z) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates [fit, point] after the bend."""
    k, alpha = body.bend[:, 0, None], body.bend[:, 1, None]
    cos, sin = np.cos(alpha), np.sin(alpha)
    inward = 1 - k * (x * cos + y * sin)
    # (1/k - r)(1 - cos kz) and (1/k - r) sin kz without division by k.
    shift = inward * 0.5 * k * z**2 * np.sinc(0.5 * k * z / np.pi) ** 2
    rise = inward * z * np.sinc(k * z / np.pi)
    return x + cos * shift, y + sin * shift, rise


def _unbent(body: SuperquadricLike, x, y, z) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates [fit, point] before the bend."""
    k, alpha = body.bend[:, 0, None], body.bend[:, 1, None]
    cos, sin = np.cos(alpha), np.sin(alpha)
    outer = x * cos + y * sin
    ahead = 1 - k * outer
    radius = np.hypot(ahead, k * z)
    longer = (outer * (k * outer - 2) + k * z**2) / (1 + radius)
    shift = k * (outer * longer + outer**2 + z**2) / (1 + radius)
    straight = np.where(k < 1e-12, z, np.arctan2(k * z, ahead) / np.maximum(k, 1e-12))
    return x - cos * shift, y - sin * shift, straight


def _project(
    body: SuperquadricLike, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates [fit, point] of the straight body's surface along `directions` [point, 3] or
    [fit, point, 3] of the scaled frame."""
    e1, e2 = body.exponents[:, 0, None], body.exponents[:, 1, None]
    along = _planes(directions)
    lx, ly, lz = (np.log(c**2 + TINY) for c in along)
    section = e2 * log_sum(lx / e2, ly / e2)
    radius = np.exp(0.5 * e1 * log_sum(section / e1, lz / e1))
    x, y, z = (c / radius * a[:, None] for c, a in zip(along, body.size_m.T, strict=True))
    return x, y, z


def cube_grid(cells: int, line: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Quadrilaterals [6 cells^2, 4] and vertices [6 (cells+1)^2, 3] of the cube [-1, 1]^3.

    `line` holds the coordinates of a face's lines, (cells + 1,); without it they are at tangents of
    even angles, for even projected spacing. Corners are counter-clockwise seen from outside.
    """
    if line is None:
        line = np.tan(np.linspace(-np.pi / 4, np.pi / 4, cells + 1))
    u, v = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    one = np.ones_like(u)
    faces = [(one, u, v), (-one, v, u), (v, one, u), (u, -one, v), (u, v, one), (v, u, -one)]
    vertices = np.concatenate([np.stack(face, axis=-1) for face in faces])
    i, j = (grid.ravel() for grid in np.meshgrid(*[np.arange(cells)] * 2, indexing="ij"))
    side = cells + 1
    first, second = i * side + j, (i + 1) * side + j
    quad = np.stack([first, second, second + 1, first + 1], axis=-1)
    return np.concatenate([quad + face * side**2 for face in range(6)]), vertices
