"""Bodies as kernels see them: a table of placed primitives joined by Boolean operations.

A body is a run of rows of the table; the first row is the base, each further row is united with,
taken from, or intersected with what stands before it (constructive solid geometry by min and max:
exact for unions outside, a bound elsewhere). Several bodies share one table, so that a batch may
hold different objects. A body stands on z = 0 of its own frame, the table top.
"""

from enum import IntEnum

import warp as wp

from warpgrasp.real import ONE, ZERO, real, transform, vec2, vec3, vec4
from warpgrasp.sdf_grid import sdf_grid_grad
from warpgrasp.sdf_primitive import (
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
from warpgrasp.sdf_superquadric import SuperquadricShape, sdf_superquadric_bound_grad


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


@wp.struct
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


@wp.struct
class Scene:
    """All bodies of a batch: rows `body_first[b]` to `body_first[b + 1]` make body b."""

    body_first: wp.array[int]
    primitives: wp.array[Primitive]
    profile: wp.array[vec2]  # (z, r) [m]
    grid: wp.array[wp.float32]  # [m]


@wp.func
def _primitive_distance(scene: Scene, k: int, p: vec3):
    shape = scene.primitives[k].shape
    size = scene.primitives[k].size
    if shape == _BLOCK:
        return sdf_block(p, size)
    if shape == _CYLINDER:
        return sdf_cylinder(p, size[0], size[2])
    if shape == _REVOLUTION:
        return sdf_revolution(p, scene.profile, scene.primitives[k].first,
                              scene.primitives[k].count)
    if shape == _WEDGE:
        return sdf_wedge(p, size)
    if shape == _SPHERE:
        return sdf_sphere(p, size[0])
    if shape == _CAPSULE:
        return sdf_capsule(p, size[0], size[2])
    if shape == _SUPERQUADRIC:
        return sdf_superquadric_bound_grad(p, scene.primitives[k].superquadric)[3]
    return sdf_grid_grad(p, scene.grid, scene.primitives[k].first, scene.primitives[k].nodes,
                         scene.primitives[k].origin, scene.primitives[k].cell)[3]


@wp.func
def _with_distance(g: vec3, d: real):
    return vec4(g[0], g[1], g[2], d)


@wp.func
def _primitive_distance_grad(scene: Scene, k: int, p: vec3):
    shape = scene.primitives[k].shape
    size = scene.primitives[k].size
    if shape == _BLOCK:
        return _with_distance(sdf_block_grad(p, size), sdf_block(p, size))
    if shape == _CYLINDER:
        return _with_distance(sdf_cylinder_grad(p, size[0], size[2]),
                              sdf_cylinder(p, size[0], size[2]))
    if shape == _REVOLUTION:
        first = scene.primitives[k].first
        count = scene.primitives[k].count
        return _with_distance(sdf_revolution_grad(p, scene.profile, first, count),
                              sdf_revolution(p, scene.profile, first, count))
    if shape == _WEDGE:
        return _with_distance(sdf_wedge_grad(p, size), sdf_wedge(p, size))
    if shape == _SPHERE:
        return _with_distance(sdf_sphere_grad(p, size[0]), sdf_sphere(p, size[0]))
    if shape == _CAPSULE:
        return _with_distance(sdf_capsule_grad(p, size[0], size[2]),
                              sdf_capsule(p, size[0], size[2]))
    if shape == _SUPERQUADRIC:
        return sdf_superquadric_bound_grad(p, scene.primitives[k].superquadric)
    return sdf_grid_grad(p, scene.grid, scene.primitives[k].first, scene.primitives[k].nodes,
                         scene.primitives[k].origin, scene.primitives[k].cell)


@wp.func
def _in_primitive_frame(scene: Scene, k: int, p: vec3):
    if scene.primitives[k].placed == 0:
        return p
    return wp.transform_point(wp.transform_inverse(scene.primitives[k].to_body), p)


@wp.func
def body_distance(scene: Scene, body: int, p: vec3):
    """Signed distance [m] of a point of the body's frame to body number `body`."""
    first = scene.body_first[body]
    d = _primitive_distance(scene, first, _in_primitive_frame(scene, first, p))
    for k in range(first + 1, scene.body_first[body + 1]):
        other = _primitive_distance(scene, k, _in_primitive_frame(scene, k, p))
        join = scene.primitives[k].join
        if join == _UNION:
            d = wp.min(d, other)
        elif join == _DIFFERENCE:
            d = wp.max(d, -other)
        else:
            d = wp.max(d, other)
    return d


@wp.func
def body_distance_grad(scene: Scene, body: int, p: vec3):
    """Gradient and distance (gx, gy, gz, d) [m] in the body's frame."""
    first = scene.body_first[body]
    value = _primitive_distance_grad(scene, first, _in_primitive_frame(scene, first, p))
    chosen = int(first)
    flip = real(1.0)
    for k in range(first + 1, scene.body_first[body + 1]):
        other = _primitive_distance_grad(scene, k, _in_primitive_frame(scene, k, p))
        join = scene.primitives[k].join
        s = ONE
        take = other[3] > value[3] * flip
        if join == _UNION:
            take = other[3] < value[3] * flip
        elif join == _DIFFERENCE:
            take = -other[3] > value[3] * flip
            s = -ONE
        if take:
            value = other
            chosen = k
            flip = s
    g = vec3(value[0], value[1], value[2])
    if scene.primitives[chosen].placed != 0:
        g = wp.quat_rotate(wp.transform_get_rotation(scene.primitives[chosen].to_body), g)
    return vec4(g[0] * flip, g[1] * flip, g[2] * flip, value[3] * flip)


@wp.func
def stand_distance(scene: Scene, body: int, p: vec3):
    """Signed distance [m] to the body and the table it stands on."""
    return wp.min(body_distance(scene, body, p), p[2])


@wp.func
def stand_distance_grad(scene: Scene, body: int, p: vec3):
    """Gradient and distance [m] to the body and the table it stands on."""
    if body_distance(scene, body, p) <= p[2]:
        return body_distance_grad(scene, body, p)
    return vec4(ZERO, ZERO, ONE, p[2])


