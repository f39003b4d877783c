"""What a hand touches of a body whose formula is no distance: the same body baked to a grid.

Fingers stop where a link's axis is a radius off the body, so the distance must be the true one
there. It is for single primitives, and outside unions of them. Where solids are cut out of others
or intersected, and for superquadrics, the formula has the right sign and the right surface, and
elsewhere falls short of the distance: a cup would seem to have a lid. Such a body is meshed, and
the distances to its mesh are baked; which side a node is on, the formula says. Where links touch,
8 mm off, these are right to 0.15 mm, but for places as near to two sides of a cut, which the
spline of the nodes rounds by up to 0.4 mm.
"""

import hashlib
from dataclasses import replace

import numpy as np

from warpgrasp.geometry.body import Body, BodyError, scene_of, signed_distance_to_bodies
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.geometry.meshing import body_mesh
from warpgrasp.geometry.scene import Join, Shape
from warpgrasp.objects.grid_baking import NODES, Distance, baked_body, cached_grid, lost, volumes_m3
from warpgrasp.objects.mesh_orientation import mesh_gap, mesh_of

_CELLS = 96
"""Of the mesh, along the longest side."""
_FINER = (NODES, 144, 192)
"""Nodes along the longest side: more where thin walls ask for them."""
_THIN, _SHARE_THIN = 0.1, 0.1
"""A part may be thin if this share of a mesh's vertices lie so much of a node's spacing off the
formula at the nodes. Nine in ten lie 0.03 off or less of mugs, bowls and bottles; of bodies with
rods or plates near the spacing, 0.13 and more."""
_SAMPLES = 2048
_OFF, _SHARE_OFF = 0.4, 0.02
"""Of a node's spacing; so much farther off the baked surface a share of the body's may lie. Where
two sides of a cut meet 1 % lie 0.3 off; where a rod is thinner than the spacing, far more."""


def distance_falls_short(body: Body) -> bool:
    """Whether the formula of a body is less than the distance outside it."""
    return (any(part.shape == Shape.SUPERQUADRIC for part in body.parts)
            or any(part.join != Join.UNION for part in body.parts[1:]))


def touched_body(body: Body) -> Body:
    """The body, or where its formula falls short the same one with true distances.

    Raises BodyError where its walls are too thin for that.
    """
    if not distance_falls_short(body):
        return body
    key = repr((body.content, body.low_m, body.high_m, _CELLS))  # the grid fills the body's box
    baked = cached_grid(hashlib.sha256(key.encode()).hexdigest(), lambda: _baked(body))
    return replace(baked, name=body.name, doc=body.doc)


def check_walls(body: Body) -> None:
    """Raise BodyError where walls or parts of a body are too thin for `touched_body`, which takes
    seconds and is made only where some may be."""
    if not distance_falls_short(body):
        return
    _, rough = _nodes_for(body)
    vertices, _ = body_mesh(body, _CELLS)
    if len(vertices) == 0:
        raise _too_thin(body, rough.parts[0].grid_cell_m)
    reach = np.concatenate([vertices.min(0) - body.low_m, body.high_m - vertices.max(0)])
    cell = rough.parts[0].grid_cell_m
    if reach.max() > cell or (_distance(rough, vertices) > _THIN * cell).mean() > _SHARE_THIN:
        touched_body(body)


def _nodes_for(body: Body) -> tuple[int, Body]:
    """How many nodes keep the walls of a body, and there its formula, which is right near the
    surface."""
    cell = 0.0
    for nodes in _FINER:
        rough = baked_body(np.array(body.low_m), np.array(body.high_m), _formula(body), nodes)
        if not lost(*volumes_m3(rough, _formula(body))):
            return nodes, rough
        cell = rough.parts[0].grid_cell_m
    raise _too_thin(body, cell)


def _distance(baked: Body, points: np.ndarray) -> np.ndarray:
    """How far points (n, 3) are from a baked surface [m]."""
    return np.abs(_formula(baked)(points))


def _too_thin(body: Body, cell_m: float) -> BodyError:
    return BodyError(
        f"{body.name}: it has superquadrics or cuts, whose distances are baked to nodes at least "
        f"{1000 * cell_m:.2g} mm apart: walls, gaps and parts of {2000 * cell_m:.2g} mm are kept; "
        "thicken them, or make it shorter")


def _formula(body: Body) -> Distance:
    scene = scene_of([body], "cpu")
    return lambda points: signed_distance_to_bodies(scene, np.zeros(1, int), points[None])[0]


def _baked(body: Body) -> Body:
    first, _ = _nodes_for(body)
    side, surface = _formula(body), sample_body(body, surface=_SAMPLES).surface_m
    cell = 0.0
    for nodes in _FINER[_FINER.index(first):]:
        vertices, faces = body_mesh(body, max(_CELLS, nodes))
        halves = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
        mesh = mesh_of(vertices, halves, winding=False)
        baked = baked_body(np.array(body.low_m), np.array(body.high_m), lambda points, mesh=mesh:
                           np.copysign(mesh_gap(mesh, points), side(points)), nodes)
        cell = baked.parts[0].grid_cell_m
        if (_distance(baked, surface) > _OFF * cell).mean() <= _SHARE_OFF:
            return baked
    raise _too_thin(body, cell)
