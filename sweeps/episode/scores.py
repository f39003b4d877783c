"""Scores of recovered bodies against true ones, for a whole batch.

Both surfaces are sampled: the true one by points (`geometry.body_sampling`), the recovered one by
surface elements, discs with the area of an element (`surface_elements`). Distances from the true
surface go to the nearest element. Distances from the recovered surface go to the true body
(`distance_to_surface`). Everything is computed in the true body's frame, so that its points are
the same in every world.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from fit.arrays import joined, rows_of, with_rows
from fit.revolution.geometry import (
    RevolutionBody,
    revolution_inside,
    revolution_surface,
    revolution_volume,
)
from fit.rotation import matrix_of_quaternion, quaternion_of_matrix
from fit.superquadric.geometry import Superquadric, SuperquadricLike, superquadric_volume
from strategies.recovery.body_distances import bodies_on
from strategies.recovery.choose_model import Recovered, Shape, same_bodies
from sweeps.episode.scores_kernel import (
    PATCH,
    _ball_kernel,
    _element_distance_kernel,
    _inside_kernel,
)
from sweeps.episode.surface_elements import surface_elements
from warpgrasp.core.dtypes import real, vec3, vec4
from warpgrasp.core.kernel_launch import launch
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import BodySample, sample_body

SURFACE_POINTS = 512
ELEMENTS = 864
INSIDE_POINTS = 2048
COVERAGE_M = 0.005
DISCS = 8192
"""Discs that stand for the surface of a body without an exact distance."""
WORLDS_AT_ONCE = 512
"""More at once leave the caches: 16,384 took 2 GiB and a third more time each."""


@dataclass(frozen=True)
class Scores:
    """Scores, shape (world,) each."""

    chamfer_m: np.ndarray
    """Mean of the two mean distances, surface to surface."""
    hausdorff95_m: np.ndarray
    """Larger of the two 95 % quantiles of distance, surface to surface."""
    iou: np.ndarray
    """Volume of the intersection over that of the union."""
    volume_ratio: np.ndarray
    """Recovered volume over true volume."""
    coverage: np.ndarray
    """Share of the true surface within 5 mm of the recovered one."""


@dataclass(frozen=True)
class _Surface:
    """Recovered surfaces in the true body's frame, their volumes, and what they share with it."""

    element: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    volume: np.ndarray
    common: np.ndarray
    """Share of the true body's inside points that lie inside, (world,)."""


def score_superquadrics(
    fits: SuperquadricLike, body: Body, body_pose: np.ndarray, *, device: str = "cpu"
) -> Scores:
    """Score one superquadric a world against `body`, which stands at `body_pose` (world, 7)."""
    sample = sample_body(body, surface=SURFACE_POINTS, inside=INSIDE_POINTS)
    return _in_turn(lambda rows: _score(
        _superquadrics(rows_of(fits, rows), sample, body_pose[rows], device),
        body, sample, device), len(body_pose))


def score_recovered(
    recovered: Recovered, body: Body, body_pose: np.ndarray, *, device: str = "cpu"
) -> Scores:
    """Score what each world ended with, superquadric or contour, against `body`."""
    sample = sample_body(body, surface=SURFACE_POINTS, inside=INSIDE_POINTS)
    return _in_turn(lambda rows: _score(
        _recovered(rows_of(recovered, rows), sample, body_pose[rows], device),
        body, sample, device), len(body_pose))


def _in_turn(score: Callable[[slice], Scores], worlds: int) -> Scores:
    """The scores of all worlds, so many of them after the other."""
    return joined([score(slice(first, first + WORLDS_AT_ONCE))
                   for first in range(0, max(worlds, 1), WORLDS_AT_ONCE)])


def _recovered(
    recovered: Recovered, sample: BodySample, body_pose: np.ndarray, device: str
) -> _Surface:
    round_ = (recovered.shape == Shape.REVOLUTION) & (recovered.revolution is not None)
    turned, others = np.flatnonzero(round_), np.flatnonzero(~round_)
    parts: list[_Surface] = []
    if len(others) or not len(turned):
        parts.append(_superquadrics(rows_of(recovered.superquadric, others), sample,
                                    body_pose[others], device))
    if len(turned) and recovered.revolution is not None:
        parts.append(_revolutions(recovered.revolution[turned], sample, body_pose[turned]))
    order = np.argsort(np.concatenate([others, turned]), kind="stable")
    return rows_of(joined(parts), order)


def scores_again(
    recovered: Recovered, before: Recovered, scores: Scores, body: Body, body_pose: np.ndarray, *,
    device: str = "cpu"
) -> Scores:
    """`score_recovered`, given the `scores` of the bodies `before`: only what changed is scored."""
    rows = np.flatnonzero(~same_bodies(recovered, before))
    if len(rows) == 0:
        return scores
    part = score_recovered(rows_of(recovered, rows), body, body_pose[rows], device=device)
    return with_rows(scores, rows, part)


def _superquadrics(
    fits: SuperquadricLike, sample: BodySample, body_pose: np.ndarray, device: str
) -> _Surface:
    turn = matrix_of_quaternion(body_pose[:, 3:])
    seen = Superquadric(
        fits.size_m, fits.exponents,
        ((fits.position_m - body_pose[:, :3])[:, None] @ turn)[:, 0],
        quaternion_of_matrix(turn.transpose(0, 2, 1) @ matrix_of_quaternion(fits.quaternion_xyzw)),
        fits.taper, fits.bend)
    return _Surface(*surface_elements(seen, ELEMENTS, device=device), superquadric_volume(fits),
                    _share_inside(seen, sample.inside_m, device))


def _revolutions(
    bodies: RevolutionBody, sample: BodySample, body_pose: np.ndarray
) -> _Surface:
    turn, place = matrix_of_quaternion(body_pose[:, 3:]), body_pose[:, None, :3]
    element, normal, area = revolution_surface(bodies)
    inside = revolution_inside(bodies, sample.inside_m @ turn.transpose(0, 2, 1) + place)
    return _Surface((element - place) @ turn, normal @ turn, area, revolution_volume(bodies),
                    inside.mean(1))


def _score(found: _Surface, body: Body, sample: BodySample, device: str) -> Scores:
    to_fit = _distance_to_elements(sample.surface_m, found, device)
    to_body = distance_to_surface(body, found.element, device=device)
    share = found.area / found.area.sum(1, keepdims=True)
    mean_to_body = (to_body * share).sum(1)
    chamfer = 0.5 * (to_fit.mean(1) + mean_to_body)
    hausdorff = np.maximum(np.quantile(to_fit, 0.95, axis=1), _quantile(to_body, share, 0.95))
    common = sample.volume_m3 * found.common
    return Scores(
        chamfer_m=chamfer,
        hausdorff95_m=hausdorff,
        iou=common / (found.volume + sample.volume_m3 - common),
        volume_ratio=found.volume / sample.volume_m3,
        coverage=(to_fit <= COVERAGE_M).mean(1),
    )


def _quantile(values: np.ndarray, share: np.ndarray, q: float) -> np.ndarray:
    """Weighted quantile of each row."""
    order = np.argsort(values, axis=1, kind="stable")
    cumulative = np.cumsum(np.take_along_axis(share, order, 1), axis=1)
    at = np.minimum((cumulative < q).sum(1), values.shape[1] - 1)
    return np.take_along_axis(values, order, 1)[np.arange(len(values)), at]


def _distance_to_elements(points: np.ndarray, found: _Surface, device: str) -> np.ndarray:
    """From each point (point, 3) to each world's surface, (world, point)."""
    worlds, elements = found.area.shape
    patches = -(-elements // PATCH)
    surface = {
        "element": wp.array(found.element, dtype=vec3, device=device),
        "radius": wp.array(np.sqrt(found.area / np.pi), dtype=real, device=device)}
    shapes = {"element": "world element", "radius": "world element", "ball": "world patch"}
    ball = wp.empty((worlds, patches), dtype=vec4, device=device)
    launch(_ball_kernel, {"world": worlds, "patch": patches}, shapes,
           {**surface, "ball": ball}, device=device)
    out = wp.empty((worlds, len(points)), dtype=real, device=device)
    launch(_element_distance_kernel, {"world": worlds, "point": len(points)}, {
        **shapes, "normal": "world element", "point": "point", "distance": "world point"}, {
        **surface, "ball": ball, "normal": wp.array(found.normal, dtype=vec3, device=device),
        "point": wp.array(points, dtype=vec3, device=device), "distance": out}, device=device)
    return out.numpy().copy()


def _share_inside(fits: SuperquadricLike, points: np.ndarray, device: str) -> np.ndarray:
    """Share of points (point, 3) that lie in each world's body, (world,)."""
    shape, pose = bodies_on(fits, device)
    out = wp.empty((len(fits.size_m), len(points)), dtype=int, device=device)
    launch(_inside_kernel, {"world": len(fits.size_m), "point": len(points)}, {
        "shape": "world", "pose": "world", "point": "point", "inside": "world point"}, {
        "shape": shape, "pose": pose,
        "point": wp.array(points, dtype=vec3, device=device), "inside": out}, device=device)
    return out.numpy().mean(1)


@dataclass(frozen=True)
class Scorer:
    """True bodies and where they stand."""

    bodies: Sequence[Body]
    which: np.ndarray
    """Body of each world, rising, (world,)."""
    body_pose: np.ndarray
    """(world, 7)."""
    device: str = "cpu"

    def worlds(self) -> Iterator[tuple[Body, slice]]:
        """Each body with its worlds."""
        ends = np.searchsorted(self.which, np.arange(len(self.bodies)), side="right")
        begins = [0, *ends[:-1]]
        for body, begin, end in zip(self.bodies, begins, ends, strict=True):
            yield body, slice(int(begin), int(end))

    def score(self, recovered: Recovered) -> Scores:
        """Scores of every world, see `sweeps.episode.scores.score_recovered`."""
        return joined([
            score_recovered(rows_of(recovered, rows), body, self.body_pose[rows],
                            device=self.device) for body, rows in self.worlds()])

    def score_again(self, recovered: Recovered, before: Recovered, scores: Scores) -> Scores:
        """Scores of every world, given those of the bodies `before`."""
        return joined([
            scores_again(rows_of(recovered, rows), rows_of(before, rows), rows_of(scores, rows),
                         body, self.body_pose[rows], device=self.device)
            for body, rows in self.worlds()])


def distance_to_surface(body: Body, points_m: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Unsigned distances [m] of points to the body's surface, shape (world, point).

    `points_m` has shape (world, point, 3), in the body's frame. A point that is not finite has a
    distance that is not finite. The signed distance of a single primitive is exact; that of a
    compound, a grid or a superquadric is a bound. There the distance to the nearest of `DISCS`
    discs is used: with v from the disc's centre to the point, n its normal and r its radius, the
    length of (v . n, max(|v - (v . n) n| - r, 0)).
    """
    if body.has_exact_distance:
        signed, _ = distance_to_bodies(scene_of([body], device), np.zeros(1, int), points_m,
                                       device=device)
        return np.abs(signed)
    sample = sample_body(body, surface=DISCS)
    known = np.isfinite(points_m).all(-1, keepdims=True)
    away, nearest = sample.tree.query(np.where(known, points_m, 0.0))
    v = points_m - sample.surface_m[nearest]
    height = (v * sample.surface_normal[nearest]).sum(-1)
    aside = np.sqrt(np.maximum(away**2 - height**2, 0.0)) - sample.reach_m[nearest]
    return np.hypot(height, np.maximum(aside, 0.0))
