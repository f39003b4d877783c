# type: ignore  # Warp functions, which type checkers cannot follow
"""Bodies as kernels see them: a table of placed primitives joined by Boolean operations.

A body is a range of rows. The first row is the base; each further row is united with, subtracted
from, or intersected with the result so far (constructive solid geometry by min and max: exact for
unions outside, a bound elsewhere, see `objects.body_baking`). Several bodies share one table, so
that a batch may hold different objects. A body stands on z = 0 of its own frame, the table top.
"""

from enum import IntEnum

import warp as wp

from warpgrasp.core.dtypes import (
    ONE,
    ZERO,
    greater,
    lesser,
    real,
    struct,
    transform,
    vec2,
    vec3,
    vec4,
)
from warpgrasp.geometry.sdf_grid import sdf_grid_grad
from warpgrasp.geometry.sdf_primitive import (
    sdf_block,
    sdf_block_grad,
    sdf_capsule,
    sdf_capsule_grad,
    sdf_cylinder,
    sdf_cylinder_grad,
    sdf_revolution,
    sdf_revolution_grad,
    sdf_sphere,
    sdf_sphere_grad,
    sdf_wedge,
    sdf_wedge_grad,
)
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape, sdf_superquadric_bound_grad


class Shape(IntEnum):
    """Kinds of primitive."""

    BLOCK = 0
    CYLINDER = 1
    WEDGE = 2
    SPHERE = 3
    CAPSULE = 4
    REVOLUTION = 5
    SUPERQUADRIC = 6
    GRID = 7


class Join(IntEnum):
    """How a primitive joins the ones before it."""

    UNION = 0
    DIFFERENCE = 1
    INTERSECTION = 2


_BLOCK = wp.constant(int(Shape.BLOCK))
_CYLINDER = wp.constant(int(Shape.CYLINDER))
_WEDGE = wp.constant(int(Shape.WEDGE))
_SPHERE = wp.constant(int(Shape.SPHERE))
_CAPSULE = wp.constant(int(Shape.CAPSULE))
_REVOLUTION = wp.constant(int(Shape.REVOLUTION))
_SUPERQUADRIC = wp.constant(int(Shape.SUPERQUADRIC))
_UNION = wp.constant(int(Join.UNION))
_DIFFERENCE = wp.constant(int(Join.DIFFERENCE))


@struct
class Primitive:
    """One placed primitive; which numbers count depends on `shape`."""

    shape: int
    join: int
    placed: int  # 0: the body's own frame, no transform needed
    to_body: transform
    size: vec3  # [m]
    superquadric: SuperquadricShape
    first: int  # first profile point or grid node
    count: int
    nodes: wp.vec3i
    origin: vec3
    cell: real


@struct
class Scene:
    """All bodies of a batch: rows `body_first[b]` to `body_first[b + 1]` make body b.

    The fields are addresses of arrays that `body.scene_of` keeps. Warp passes structs
    by value, and passing four array records to each call costs more than the distances themselves.
    """

    body_first: wp.uint64
    bodies: int
    primitives: wp.uint64
    primitive_count: int
    profile: wp.uint64  # (z, r) [m]
    grid: wp.uint64  # [m], float32


@wp.func
def _first_row(scene: Scene, body: int):
    rows = wp.array(ptr=scene.body_first, shape=(scene.bodies + 1,), dtype=int)
    return rows[body]


@wp.func(inline=False)
def _primitive_distance(
    primitives: wp.uint64, k: int, profiles: wp.uint64, grids: wp.uint64, x: real, y: real, z: real
):
    rows = wp.array(ptr=primitives, shape=(k + 1,), dtype=Primitive)
    row = rows[k]
    p = vec3(x, y, z)
    size = row.size
    if row.shape == _BLOCK:
        return sdf_block(p, size)
    if row.shape == _CYLINDER:
        return sdf_cylinder(p, size[0], size[2])
    if row.shape == _REVOLUTION:
        profile = wp.array(ptr=profiles, shape=(row.first + row.count,), dtype=vec2)
        return sdf_revolution(p, profile, row.first, row.count)
    if row.shape == _WEDGE:
        return sdf_wedge(p, size)
    if row.shape == _SPHERE:
        return sdf_sphere(p, size[0])
    if row.shape == _CAPSULE:
        return sdf_capsule(p, size[0], size[2])
    if row.shape == _SUPERQUADRIC:
        return sdf_superquadric_bound_grad(p, row.superquadric)[3]
    grid = wp.array(ptr=grids, shape=(1,), dtype=wp.float32)
    return sdf_grid_grad(p, grid, row.first, row.nodes, row.origin, row.cell)[3]


@wp.func(inline=False)
def _primitive_distance_grad(
    primitives: wp.uint64, k: int, profiles: wp.uint64, grids: wp.uint64, x: real, y: real, z: real
):
    rows = wp.array(ptr=primitives, shape=(k + 1,), dtype=Primitive)
    row = rows[k]
    p = vec3(x, y, z)
    size = row.size
    if row.shape == _BLOCK:
        return sdf_block_grad(p, size)
    if row.shape == _CYLINDER:
        return sdf_cylinder_grad(p, size[0], size[2])
    if row.shape == _REVOLUTION:
        profile = wp.array(ptr=profiles, shape=(row.first + row.count,), dtype=vec2)
        return sdf_revolution_grad(p, profile, row.first, row.count)
    if row.shape == _WEDGE:
        return sdf_wedge_grad(p, size)
    if row.shape == _SPHERE:
        return sdf_sphere_grad(p, size[0])
    if row.shape == _CAPSULE:
        return sdf_capsule_grad(p, size[0], size[2])
    if row.shape == _SUPERQUADRIC:
        return sdf_superquadric_bound_grad(p, row.superquadric)
    grid = wp.array(ptr=grids, shape=(1,), dtype=wp.float32)
    return sdf_grid_grad(p, grid, row.first, row.nodes, row.origin, row.cell)


@wp.func
def body_is_convex(scene: Scene, body: int):
    """Whether a body certainly is convex: one primitive of a convex kind."""
    rows = wp.array(ptr=scene.primitives, shape=(scene.primitive_count,), dtype=Primitive)
    first = _first_row(scene, body)
    return _first_row(scene, body + 1) - first == 1 and rows[first].shape <= _CAPSULE


@wp.func
def _in_primitive_frame(row: Primitive, p: vec3):
    if row.placed == 0:
        return p
    return wp.transform_point(wp.transform_inverse(row.to_body), p)


@wp.func
def body_distance(scene: Scene, body: int, p: vec3):
    """Signed distance [m] of a point of the body's frame to body number `body`."""
    rows = wp.array(ptr=scene.primitives, shape=(scene.primitive_count,), dtype=Primitive)
    first = _first_row(scene, body)
    d = real(0.0)
    for k in range(first, _first_row(scene, body + 1)):
        q = _in_primitive_frame(rows[k], p)
        other = _primitive_distance(scene.primitives, k, scene.profile, scene.grid, q[0], q[1],
                                    q[2])
        join = rows[k].join
        if k == first:
            d = other
        elif join == _UNION:
            d = lesser(d, other)
        elif join == _DIFFERENCE:
            d = greater(d, -other)
        else:
            d = greater(d, other)
    return d


@wp.func
def _placed_distance_grad(scene: Scene, k: int, p: vec3):
    rows = wp.array(ptr=scene.primitives, shape=(scene.primitive_count,), dtype=Primitive)
    q = _in_primitive_frame(rows[k], p)
    other = _primitive_distance_grad(scene.primitives, k, scene.profile, scene.grid, q[0], q[1],
                                     q[2])
    if rows[k].placed == 0:
        return other
    turn = wp.transform_get_rotation(rows[k].to_body)
    g = wp.quat_rotate(turn, vec3(other[0], other[1], other[2]))
    return vec4(g[0], g[1], g[2], other[3])


@struct
class _Found:
    """The result of a search. A field changes in place; a variable in a branch is copied."""

    value: vec4


@wp.func
def body_distance_grad(scene: Scene, body: int, p: vec3):
    """Gradient and distance (gx, gy, gz, d) [m] in the body's frame."""
    rows = wp.array(ptr=scene.primitives, shape=(scene.primitive_count,), dtype=Primitive)
    first = _first_row(scene, body)
    found = _Found()
    for k in range(first, _first_row(scene, body + 1)):
        join = rows[k].join
        other = _placed_distance_grad(scene, k, p) * wp.where(
            k > first and join == _DIFFERENCE, -ONE, ONE)
        take = other[3] > found.value[3]
        if join == _UNION:
            take = other[3] < found.value[3]
        if k == first or take:
            found.value = other
    return found.value


@wp.func
def body_table_distance(scene: Scene, body: int, p: vec3):
    """Signed distance [m] to the body and the table it stands on."""
    return lesser(body_distance(scene, body, p), p[2])


@wp.func
def body_table_distance_grad(scene: Scene, body: int, p: vec3):
    """Gradient and distance [m] to the body and the table it stands on."""
    g = body_distance_grad(scene, body, p)
    if g[3] <= p[2]:
        return g
    return vec4(ZERO, ZERO, ONE, p[2])


@wp.kernel(enable_backward=False)
def distance_kernel(
    first: int,
    # Scene:
    scene: Scene,
    # Query in:
    body: wp.array[int],
    point: wp.array2d[vec3],
    # Distance out:
    found: wp.array2d[vec4],
):
    """Gradient and distance of every point to its world's body."""
    w, i = wp.tid()
    w += first
    found[w, i] = body_distance_grad(scene, body[w % body.shape[0]], point[w, i])


@wp.kernel(enable_backward=False)
def signed_distance_kernel(
    first: int,
    # Scene:
    scene: Scene,
    # Query in:
    body: wp.array[int],
    point: wp.array2d[vec3],
    # Distance out:
    found: wp.array2d[real],
):
    """Distance of every point to its world's body."""
    w, i = wp.tid()
    w += first
    found[w, i] = body_distance(scene, body[w % body.shape[0]], point[w, i])
