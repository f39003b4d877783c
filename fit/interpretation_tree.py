"""Recognition by faces: the interpretation tree of Grimson and Lozano-Perez (1984, 1987).

Touches (a point and an outward normal each) are assigned to the faces of a model one by one. A
branch is pruned when a pair of assignments violates one of three constraints: the angle between
normals, the range of distances between points, or the range of the components of their separation
along the normals. Each remaining assignment gives a pose, which is verified: every touch must lie
within the bounds of its face. A touch may belong to no face (the null face of 1987), if so few do
that the others still decide.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from fit.polyhedron import ROUNDED, polyhedron_faces
from fit.rotation import matrix_of_quaternion, quaternion_of_matrix

NULL = -1
"""The face of a touch that is none of the model's."""
MOST = 100
"""Assignments that are verified."""
UNDETERMINED = 1e-6
"""Normals of faces with a part below this along a direction leave a place open along it."""


@dataclass(frozen=True)
class FaceModel:
    """A polyhedron, given by its faces."""

    name: str
    faces: tuple[Float[np.ndarray, "_ 3"], ...]
    """Corners of each convex face [m], counter-clockwise seen from outside."""

    @cached_property
    def normals(self) -> Float[np.ndarray, "face 3"]:
        """Outward unit normals, by Newell's method."""
        sums = [np.cross(c, np.roll(c, -1, axis=0)).sum(axis=0) for c in self.faces]
        return np.array([s / np.linalg.norm(s) for s in sums])

    @cached_property
    def offsets(self) -> Float[np.ndarray, " face"]:
        """Of the faces' planes along their normals [m]."""
        return np.array([c[0] @ n for c, n in zip(self.faces, self.normals, strict=True)])

    @cached_property
    def centres(self) -> Float[np.ndarray, "face 3"]:
        """Mean of each face's corners [m]."""
        return np.array([c.mean(axis=0) for c in self.faces])

    @cached_property
    def inward(self) -> tuple[Float[np.ndarray, "_ 3"], ...]:
        """Of each face: unit vectors within its plane, from each edge inwards."""
        across = [np.cross(n, np.roll(c, -1, axis=0) - c)
                  for c, n in zip(self.faces, self.normals, strict=True)]
        return tuple(v / np.linalg.norm(v, axis=1, keepdims=True) for v in across)

    @cached_property
    def distance_range(self) -> Float[np.ndarray, "face face 2"]:
        """Bounds [m] of the distance between points of two faces.

        The greatest distance is that of two corners. The least is bounded below by the separation
        along the normals and along the line of centres.
        """
        n = len(self.faces)
        table = np.zeros((n, n, 2))
        for i, a in enumerate(self.faces):
            for j, b in enumerate(self.faces):
                apart = b[None] - a[:, None]
                table[i, j, 1] = np.linalg.norm(apart, axis=2).max()
                line = b.mean(axis=0) - a.mean(axis=0)
                length = np.linalg.norm(line)
                for axis in (self.normals[i], self.normals[j], line / max(length, 1e-12)):
                    along = apart @ axis
                    gap = max(along.min(), -along.max(), 0.0)
                    table[i, j, 0] = max(table[i, j, 0], gap)
        return table

    @cached_property
    def component_range(self) -> Float[np.ndarray, "face face 2"]:
        """Range [m] of (q - p).n_i over points p of face i and q of face j, attained at corners."""
        along = [[(b[None] - a[:, None]) @ self.normals[i] for b in self.faces]
                 for i, a in enumerate(self.faces)]
        return np.array([[[x.min(), x.max()] for x in row] for row in along])


@dataclass(frozen=True)
class Interpretation:
    """One verified assignment of touches to faces of a model."""

    model: str
    assignment: tuple[int, ...]
    """Model face of each touch, or `NULL`."""
    quaternion_xyzw: Float[np.ndarray, " 4"]
    """Rotation from model to world."""
    position_m: Float[np.ndarray, " 3"]
    away_m: Float[np.ndarray, " touch"]
    """Signed distance of each touch to the plane of its face [m]; 0 for one of none."""

    @property
    def assigned(self) -> int:
        """Number of touches that belong to a face."""
        return sum(face != NULL for face in self.assignment)

    @property
    def rms_m(self) -> float:
        """Root mean square distance of the touches to the planes of their faces [m]."""
        return float(np.sqrt((self.away_m**2).sum() / max(self.assigned, 1)))

    def planes(self, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normals (touch, 3) and offsets (touch,) [m] of the touched planes in the model's frame.
        """
        rotation = matrix_of_quaternion(self.quaternion_xyzw[None])[0]
        local = normals @ rotation
        return local, ((points - self.position_m) @ rotation * local).sum(1)


def interpret(
    points: Float[np.ndarray, "touch 3"],
    normals: Float[np.ndarray, "touch 3"],
    model: FaceModel,
    *,
    angle_rad: float,
    distance_m: float,
    most_null: int = 0,
) -> list[Interpretation]:
    """Interpretations of touches [m] with outward normals, best first; empty if none is possible.

    The best are those of least distances. `angle_rad` and `distance_m` bound the errors of a normal
    and a point. At most `most_null` touches belong to no face, and as few as possible. At most
    `MOST` assignments are verified; symmetric bodies have several equivalent ones. Raises
    ValueError for arrays of the wrong shape, and normals that are no unit vectors.
    """
    points, normals = np.asarray(points, float), np.asarray(normals, float)
    if points.ndim != 2 or points.shape[1] != 3 or normals.shape != points.shape:
        raise ValueError(f"touches: points {points.shape}, normals {normals.shape}, "
                         "should both be (touch, 3)")
    return interpret_sets(points[None], normals[None], model, angle_rad=angle_rad,
                          distance_m=distance_m, most_null=most_null)[0]


def interpret_sets(
    points: Float[np.ndarray, "set touch 3"],
    normals: Float[np.ndarray, "set touch 3"],
    model: FaceModel,
    *,
    angle_rad: float,
    distance_m: float,
    most_null: int = 0,
) -> list[list[Interpretation]]:
    """`interpret` of each of several sets with one number of touches [m].

    Raises ValueError as `interpret` does.
    """
    points, normals = np.asarray(points, float), np.asarray(normals, float)
    if points.ndim != 3 or points.shape[2] != 3 or normals.shape != points.shape:
        raise ValueError(f"sets of touches: points {points.shape}, normals {normals.shape}, "
                         "should both be (set, touch, 3)")
    if not (np.abs(np.linalg.norm(normals, axis=2) - 1.0) <= ROUNDED).all():  # angles are by them
        raise ValueError("sets of touches: a normal is no unit vector; divide it by its length, or "
                         "leave that touch out")
    found: list[list[Interpretation]] = [[] for _ in points]
    if not model.faces:
        return found
    owner, branches = np.arange(len(points)), np.zeros((len(points), 0), int)
    compatible = _compatible(points, normals, model, angle_rad, distance_m)
    for touch in range(points.shape[1]):
        may = np.ones((len(branches), len(model.faces)), bool)
        for k in range(touch):
            may &= ((branches[:, k] == NULL)[:, None]
                    | compatible[owner, k, touch, branches[:, k]])
        branch, face = np.nonzero(may)
        spare = np.flatnonzero((branches == NULL).sum(1) < most_null)
        owner = np.concatenate([owner[branch], owner[spare]])
        branches = np.concatenate([
            np.column_stack([branches[branch], face]),
            np.column_stack([branches[spare], np.full(len(spare), NULL)])])
        # Bound the breadth; the last levels prune most, and a cube has 24 equivalent answers.
        first = _first_of_each(owner, 50 * MOST)
        owner, branches = owner[first], branches[first]
    nulls = (branches == NULL).sum(1)
    for null in range(most_null + 1):  # with fewer left over, those with more explain nothing new
        rows = np.flatnonzero((nulls == null) & np.array([not one for one in found], bool)[owner])
        rows = rows[_first_of_each(owner[rows], MOST)]
        for row, one in _verified(points[owner[rows]], normals[owner[rows]], model,
                                  branches[rows], angle_rad, distance_m):
            found[owner[rows[row]]].append(one)
    return [sorted(each, key=lambda one: one.rms_m) for each in found]


def _first_of_each(owner: Int[np.ndarray, " branch"], most: int) -> Int[np.ndarray, " _"]:
    """The first `most` branches of each set, set by set."""
    order = np.argsort(owner, kind="stable")
    number = np.arange(len(order)) - np.searchsorted(owner[order], owner[order])
    return order[number < most]


def _compatible(points, normals, model, angle_rad, distance_m) -> np.ndarray:
    """Whether pairs of touches may lie on pairs of faces, shape [set, touch, touch, face, face]."""
    turn = np.arccos(np.clip(normals @ normals.swapaxes(1, 2), -1, 1))[..., None, None]
    true = np.arccos(np.clip(model.normals @ model.normals.T, -1, 1))
    fits = np.abs(turn - true) <= 2 * angle_rad
    apart = points[:, None] - points[:, :, None]
    length = np.linalg.norm(apart, axis=3)[..., None, None]
    low, high = np.moveaxis(model.distance_range, 2, 0)
    fits &= (length >= low - 2 * distance_m) & (length <= high + 2 * distance_m)
    # An error of a normal changes the component in proportion to the distance.
    slack = 2 * distance_m + length * np.sin(angle_rad)
    low, high = np.moveaxis(model.component_range, 2, 0)
    along = np.einsum("sabi,sai->sab", apart, normals)[..., None, None]
    fits &= (along >= low - slack) & (along <= high + slack)
    back = -np.einsum("sabi,sbi->sab", apart, normals)[..., None, None]
    return fits & (back >= low.T - slack) & (back <= high.T + slack)


def _verified(
    points, normals, model, assignment: Int[np.ndarray, "branch touch"], angle_rad, distance_m
) -> Iterator[tuple[int, Interpretation]]:
    """Branches, all of which leave as many touches over, in whose pose every touch lies inside its
    face; `points` and `normals` [branch, touch, 3]."""
    on = assignment != NULL
    count = int(on[:1].sum())
    if count < 2:
        return
    faces, points, normals = (values[on].reshape(len(on), count, *values.shape[2:])
                              for values in (assignment, points, normals))
    true = model.normals[faces]
    u, values, vt = np.linalg.svd(normals.swapaxes(1, 2) @ true)
    u[..., 2] *= np.linalg.det(u @ vt)[:, None]
    rotation = u @ vt
    turned = true @ rotation.swapaxes(1, 2)
    along = np.einsum("bti,bti->bt", turned, normals)
    # Of parallel normals the rotation about them is undetermined.
    kept = np.flatnonzero((values[:, 1] >= 1e-3) & (along >= np.cos(angle_rad)).all(1))
    faces, points, true, rotation, turned = (
        values[kept] for values in (faces, points, true, rotation, turned))
    offset = model.offsets[faces]
    # Least squares for t in n.(x - t) = offset; the faces' centres fix undetermined components.
    centre = model.centres[faces] @ rotation.swapaxes(1, 2)
    weak = 1e-3
    extra = weak * np.tile(np.eye(3), (count, 1))
    right = np.concatenate([np.einsum("bti,bti->bt", turned, points) - offset,
                            weak * (points - centre).reshape(len(kept), 3 * count)], axis=1)
    position = np.array([np.linalg.lstsq(np.concatenate([matrix, extra]), values, rcond=None)[0]
                         for matrix, values in zip(turned, right, strict=True)]).reshape(-1, 3)
    local = (points - position[:, None]) @ rotation
    # Where faces leave one component open, the centres alone may put touches outside.
    _, sizes, axes = np.linalg.svd(true)
    along = np.where(sizes[:, 2:] < UNDETERMINED, axes[:, 2], 0.0) if count > 2 else axes[:, 2]
    # By a little less than is allowed below, for rounding.
    slid = _slide_inside(model, faces, local, along, 1.99 * distance_m)[:, None] * along
    local += slid[:, None]
    position -= np.einsum("bij,bj->bi", rotation, slid)
    away = np.einsum("bti,bti->bt", local, true) - offset
    inside = np.abs(away) <= 2 * distance_m
    for face, (corners, inward) in enumerate(zip(model.faces, model.inward, strict=True)):
        at = faces == face
        edges = ((local[at][:, None] - corners) * inward).sum(-1)
        inside[at] &= (edges >= -2 * distance_m).all(1)
    quaternion = quaternion_of_matrix(rotation)
    for k in np.flatnonzero(inside.all(1)):
        row = int(kept[k])
        distance = np.zeros(assignment.shape[1])
        distance[on[row]] = away[k]
        yield row, Interpretation(model.name, tuple(assignment[row].tolist()), quaternion[k],
                                  position[k], distance)


def _slide_inside(
    model: FaceModel, faces: Int[np.ndarray, "branch touch"],
    local: Float[np.ndarray, "branch touch 3"], along: Float[np.ndarray, "branch 3"],
    slack_m: float,
) -> Float[np.ndarray, " branch"]:
    """The shortest way [m] along `along` that brings the touches `local` of each branch inside the
    edges of their faces, with some slack; 0 where none does."""
    low, high = np.full(len(local), -np.inf), np.full(len(local), np.inf)
    for face, (corners, inward) in enumerate(zip(model.faces, model.inward, strict=True)):
        branch, touch = np.nonzero(faces == face)
        room = ((local[branch, touch][:, None] - corners) * inward).sum(-1) + slack_m
        slope = along[branch] @ inward.T
        way = -room / np.where(np.abs(slope) < UNDETERMINED, np.inf, slope)
        np.maximum.at(low, branch, np.where(slope >= UNDETERMINED, way, -np.inf).max(axis=1))
        np.minimum.at(high, branch, np.where(slope <= -UNDETERMINED, way, np.inf).min(axis=1))
    return np.where(low <= high, np.clip(0.0, low, high), 0.0)


def model_of_planes(
    name: str, normals: Float[np.ndarray, "plane 3"], offset_m: Float[np.ndarray, " plane"]
) -> FaceModel:
    """The body n.x <= offset [m]; planes that bound none of it are left out. Without faces where
    they leave no body.

    Raises ValueError as `polyhedron_faces` does.
    """
    faces = polyhedron_faces(normals, offset_m)
    return FaceModel(name, tuple(corners for corners in faces if len(corners)))
