"""Scores of recovered bodies against true ones, for a whole batch.

Both surfaces are sampled: the true one by points (`geometry.body_sampling`), the recovered one by
surface elements, discs with the area of an element (`surface_elements`). Distances from the true
surface go to the nearest place of the recovered one, found from its nearest element. Distances from
the recovered surface go to the true body (`distance_to_surface`). Everything is computed in the
true body's frame, so that its points are the same in every world.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import warp as wp

from fit.arrays import joined, rows_of, with_rows
from fit.revolution.geometry import (
    RevolutionBody,
    closed_contours,
    revolution_inside,
    revolution_surface,
    revolution_volume,
)
from fit.rotation import matrix_of_quaternion, quaternion_of_matrix
from fit.superquadric.geometry import Superquadric, SuperquadricLike, superquadric_volume
from strategies.recovery.body_distances import bodies_on
from strategies.recovery.choose_model import Recovered, Shape, same_bodies
from sweeps.episode.scores_kernel import (
    _ball_kernel,
    _contour_distance_kernel,
    _element_distance_kernel,
    _signed_distance_kernel,
)
from sweeps.episode.scores_lanes import PATCH
from sweeps.episode.surface_elements import Elements, surface_elements
from warpgrasp.core.dtypes import float32, float32_vec3, real, vec2, vec3
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.core.lanes import LANES, has_lanes
from warpgrasp.geometry.body import (
    Body,
    distance_to_bodies,
    scene_of,
    signed_distance_to_bodies,
)
from warpgrasp.geometry.body_sampling import GROUP, BodySample, sample_body

SURFACE_POINTS, ELEMENTS, INSIDE_POINTS = 2048, 1536, 3072
AROUND = 16
COVERAGE_M = 0.005
ON_M = 2e-5
"""What is farther from such a surface, by the body's own distance, is not on it."""
WORLDS_AT_ONCE = 64
"""More at once leave the caches: 512 took a twentieth more time each, 16,384 a third and 2 GiB. Of
dense samples as many fewer."""


class Samples(NamedTuple):
    """How many samples scores are made from."""

    surface: int | None = SURFACE_POINTS
    """Points of the true surface, even over it; None: every crossing with lines, weighed."""
    elements: int = ELEMENTS
    """Elements of the recovered one."""
    inside: int = INSIDE_POINTS
    """Points in and about the true body."""


FINE = Samples()
DENSE = Samples(None, 16 * ELEMENTS, 16 * INSIDE_POINTS)
"""Every crossing, and sixteen times as many of the others, for quantiles within 1 %."""
ROUGH = Samples(512, 384, 768)
"""A quarter, for bodies on the way: chamfer distances within 3 % of the fine ones nearly always,
IoU within 0.015."""
SAMPLES = {"standard": FINE, "dense": DENSE}
"""By their names in specs."""


@dataclass(frozen=True)
class Scores:
    """Scores, shape (world,) each."""

    chamfer_m: np.ndarray
    """Mean of the two mean distances, surface to surface."""
    square_m2: np.ndarray
    """Sum of the two mean squares of these distances: the chamfer distance of learned methods."""
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
    """Volume that both share [m^3], (world,)."""
    away: np.ndarray
    """Distances of the points of the true surface to it [m], (world, point)."""


def score_superquadrics(
    fits: SuperquadricLike, body: Body, body_pose: np.ndarray, *, device: str = "cpu"
) -> Scores:
    """Score one superquadric a world against `body`, which stands at `body_pose` (world, 7)."""
    sample = sample_body(body, surface=SURFACE_POINTS, inside=INSIDE_POINTS)
    return _in_turn(lambda rows: _score(
        _superquadrics(rows_of(fits, rows), sample, body_pose[rows], ELEMENTS, device),
        body, sample, device), len(body_pose), FINE)


def score_recovered(
    recovered: Recovered, body: Body, body_pose: np.ndarray, *, samples: Samples = FINE,
    device: str = "cpu"
) -> Scores:
    """Score what each world ended with, superquadric or contour, against `body`."""
    sample = sample_body(body, surface=samples.surface, inside=samples.inside)
    return _in_turn(lambda rows: _score(
        _recovered(rows_of(recovered, rows), sample, body_pose[rows], samples.elements, device),
        body, sample, device), len(body_pose), samples)


def _in_turn(score: Callable[[slice], Scores], worlds: int, samples: Samples) -> Scores:
    """The scores of all worlds, so many of them after the other."""
    count = max(WORLDS_AT_ONCE * FINE.elements // max(samples.elements, FINE.elements), 1)
    return joined([score(slice(first, first + count)) for first in range(0, max(worlds, 1), count)])


def _recovered(
    recovered: Recovered, sample: BodySample, body_pose: np.ndarray, elements: int, device: str
) -> _Surface:
    round_ = (recovered.shape == Shape.REVOLUTION) & (recovered.revolution is not None)
    turned, others = np.flatnonzero(round_), np.flatnonzero(~round_)
    parts: list[_Surface] = []
    if len(others) or not len(turned):
        parts.append(_superquadrics(rows_of(recovered.superquadric, others), sample,
                                    body_pose[others], elements, device))
    if len(turned) and recovered.revolution is not None:
        parts.append(_revolutions(recovered.revolution[turned], sample, body_pose[turned],
                                  elements, device))
    if len(parts) == 1:
        return parts[0]
    order = np.argsort(np.concatenate([others, turned]), kind="stable")
    return rows_of(joined(parts), order)


def scores_again(
    recovered: Recovered, before: Recovered, scores: Scores, body: Body, body_pose: np.ndarray, *,
    samples: Samples = FINE, device: str = "cpu"
) -> Scores:
    """`score_recovered`, given the `scores` of the bodies `before`: only what changed is scored."""
    rows = np.flatnonzero(~same_bodies(recovered, before))
    if len(rows) == 0:
        return scores
    part = score_recovered(rows_of(recovered, rows), body, body_pose[rows], samples=samples,
                           device=device)
    return with_rows(scores, rows, part)


def _superquadrics(
    fits: SuperquadricLike, sample: BodySample, body_pose: np.ndarray, count: int, device: str
) -> _Surface:
    turn = matrix_of_quaternion(body_pose[:, 3:])
    seen = Superquadric(
        fits.size_m, fits.exponents,
        ((fits.position_m - body_pose[:, :3])[:, None] @ turn)[:, 0],
        quaternion_of_matrix(turn.transpose(0, 2, 1) @ matrix_of_quaternion(fits.quaternion_xyzw)),
        fits.taper, fits.bend)
    elements = surface_elements(seen, count, device=device, graded=True)
    volume = superquadric_volume(fits)
    return _Surface(*elements, volume,
                    sample.common_volume(_signed_distance(seen, sample, device),
                                         volume / elements[2].sum(1)),
                    _distance_to_superquadrics(sample, elements, seen, device))


def _revolutions(
    bodies: RevolutionBody, sample: BodySample, body_pose: np.ndarray, count: int, device: str
) -> _Surface:
    turn, place = matrix_of_quaternion(body_pose[:, 3:]), body_pose[:, None, :3]
    element, normal, area = revolution_surface(bodies, around=AROUND, rings=count // AROUND)
    inside = revolution_inside(bodies, sample.about_m @ turn.transpose(0, 2, 1) + place)
    seen = replace(bodies, foot_m=((bodies.foot_m[:, None] - place) @ turn)[:, 0],
                   axis=(bodies.axis[:, None] @ turn)[:, 0])
    deep = _distance_to_contours(seen, sample.about_m, device)
    volume = revolution_volume(bodies)
    return _Surface((element - place) @ turn, normal @ turn, area, volume,
                    sample.common_volume(np.where(inside, -deep, deep), volume / area.sum(1)),
                    _distance_to_contours(seen, sample.surface_m, device))


def _score(found: _Surface, body: Body, sample: BodySample, device: str) -> Scores:
    to_body = distance_to_surface(body, found.element, device=device)
    share, true_share = found.area / found.area.sum(1, keepdims=True), sample.surface_share
    away = found.away
    # Of sampled points, so that it may be a little more than either volume.
    common = np.minimum(found.common, np.minimum(found.volume, sample.volume_m3))
    return Scores(
        chamfer_m=0.5 * (np.einsum("wp,p->w", away, true_share)
                         + np.einsum("wp,wp->w", to_body, share)),
        square_m2=(np.einsum("wp,wp,p->w", away, away, true_share)
                   + np.einsum("wp,wp,wp->w", to_body, to_body, share)),
        hausdorff95_m=np.maximum(weighted_quantile(away, true_share, 0.95),
                                 weighted_quantile(to_body, share, 0.95)),
        iou=common / (found.volume + sample.volume_m3 - common),
        volume_ratio=found.volume / sample.volume_m3,
        coverage=np.einsum("wp,p->w", away <= COVERAGE_M, true_share),
    )


def weighted_quantile(values: np.ndarray, share: np.ndarray, q: float) -> np.ndarray:
    """Quantile of each row of `values` (row, value), weighed by `share` (row, value) or (value,):
    straight between values, each at the middle of its share."""
    last = values.shape[1] - 1
    if share.ndim == 1 and (share == share[0]).all():  # no need to sort
        place = q * values.shape[1] - 0.5
        above = int(np.clip(np.ceil(place), 1, last))
        rising = np.partition(values, above, axis=1)
        low, high = rising[:, :above].max(1), rising[:, above]
        return low + np.clip(place - (above - 1), 0.0, 1.0) * (high - low)
    share = np.broadcast_to(share, values.shape)
    # Where the greatest hold enough, they alone are sorted: all take three times as long.
    found, enough = _quantile_of_greatest(values, share, q, int((4.0 * q - 3.0) * last))
    if not enough.all():
        found[~enough] = _quantile_of_greatest(values[~enough], share[~enough], q, 0)[0]
    return found


def _quantile_of_greatest(
    values: np.ndarray, share: np.ndarray, q: float, first: int
) -> tuple[np.ndarray, np.ndarray]:
    """`weighted_quantile` from all but the least `first` values of each row, and whether they hold
    twice what lies above it."""
    kept = np.argpartition(values, max(first, 0), axis=1)[:, max(first, 0):]
    rising = np.take_along_axis(values, kept, 1)
    order = np.argsort(rising, axis=1)
    rising = np.take_along_axis(rising, order, 1)
    part = np.take_along_axis(share, np.take_along_axis(kept, order, 1), 1)
    above_them = np.cumsum(part[:, ::-1], axis=1)[:, ::-1]
    middle = 1.0 - above_them + 0.5 * part
    row = np.arange(len(values))
    above = np.clip((middle < q).sum(1), 1, rising.shape[1] - 1)
    low, high = middle[row, above - 1], middle[row, above]
    t = np.clip((q - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
    least, most = rising[row, above - 1], rising[row, above]
    return least + t * (most - least), above_them[:, 0] > 2.0 * (1.0 - q)


def _distance_to_superquadrics(
    sample: BodySample, found: Elements, fits: SuperquadricLike, device: str
) -> np.ndarray:
    """From points of the true surface to each world's body, whose elements are `found`,
    (world, point)."""
    points, (begin, end) = sample.surface_m, sample.groups
    worlds, elements = found.area.shape
    patches = -(-elements // (PATCH * GROUP)) * GROUP
    surface = {"element": array_of(found.point, vec3, device)}
    shapes = {"element": "world element", "rough": "world element", "ball": "world 4 patch"}
    rough = wp.empty((worlds, elements), dtype=float32_vec3, device=device)
    ball = wp.empty((worlds, 4, patches), dtype=float32, device=device)
    launch(_ball_kernel, {"world": worlds, "patch": patches}, shapes,
           {**surface, "rough": rough, "ball": ball}, device=device)
    shape, pose = bodies_on(fits, device)
    out = wp.empty((worlds, len(points)), dtype=real, device=device)
    launch(_element_distance_kernel, {"world": worlds, "group": len(begin)}, {
        **shapes, "shape": "world", "pose": "world", "normal": "world element", "point": "point",
        "begin": "group", "end": "group", "distance": "world point"}, {
        **surface, "lanes": has_lanes(device), "rough": rough, "ball": ball,
        "shape": shape, "pose": pose,
        "normal": array_of(found.normal, vec3, device),
        "point": array_of(points, vec3, device),
        "begin": array_of(begin, int, device),
        "end": array_of(end, int, device), "distance": out}, device=device)
    return out.numpy()


def _distance_to_contours(bodies: RevolutionBody, points: np.ndarray, device: str) -> np.ndarray:
    """From each point (point, 3) to each world's body of revolution, (world, point)."""
    node = closed_contours(bodies)
    out = wp.empty((len(bodies), len(points)), dtype=real, device=device)
    launch(_contour_distance_kernel, {"world": len(bodies), "point": len(points)}, {
        "foot": "world", "axis": "world", "node": "world node", "point": "point",
        "distance": "world point"}, {
        "foot": array_of(bodies.foot_m, vec3, device),
        "axis": array_of(bodies.axis, vec3, device),
        "node": array_of(node, vec2, device),
        "point": array_of(points, vec3, device), "distance": out}, device=device)
    return out.numpy()


def _signed_distance(fits: SuperquadricLike, sample: BodySample, device: str) -> np.ndarray:
    """From the points inside to each world's body, to first order, (world, point); beyond the
    sample's ramp only the sign counts."""
    shape, pose = bodies_on(fits, device)
    points = sample.about_m
    out = wp.empty((len(fits.size_m), len(points)), dtype=real, device=device)
    launch(_signed_distance_kernel,
           {"world": len(fits.size_m), "block": -(-len(points) // LANES)}, {
        "shape": "world", "pose": "world", "distance": "world point",
        **dict.fromkeys(("point", "order"), "point")}, {
        "lanes": has_lanes(device), "shape": shape, "pose": pose,
        "enough": sample.ramp_m,
        "order": array_of(sample.about_order, int, device),
        "point": array_of(points, vec3, device), "distance": out}, device=device)
    return out.numpy()


@dataclass(frozen=True)
class Scorer:
    """True bodies and where they stand."""

    bodies: Sequence[Body]
    which: np.ndarray
    """Body of each world, rising, (world,)."""
    body_pose: np.ndarray
    """(world, 7)."""
    device: str = "cpu"
    samples: Samples = FINE

    def worlds(self) -> Iterator[tuple[Body, slice]]:
        """Each body that has worlds, with them."""
        ends = np.searchsorted(self.which, np.arange(len(self.bodies)), side="right")
        begins = [0, *ends[:-1]]
        for body, begin, end in zip(self.bodies, begins, ends, strict=True):
            if end > begin:
                yield body, slice(int(begin), int(end))

    def of(self, rows: np.ndarray) -> "Scorer":
        """That of some of the worlds, `rows` (row,) rising; a world may come more than once."""
        return replace(self, which=self.which[rows], body_pose=self.body_pose[rows])

    def score(self, recovered: Recovered) -> Scores:
        """Scores of every world, see `sweeps.episode.scores.score_recovered`."""
        return joined([
            score_recovered(rows_of(recovered, rows), body, self.body_pose[rows],
                            samples=self.samples, device=self.device)
            for body, rows in self.worlds()])

    def score_again(self, recovered: Recovered, before: Recovered, scores: Scores) -> Scores:
        """Scores of every world, given those of the bodies `before`."""
        return joined([
            scores_again(rows_of(recovered, rows), rows_of(before, rows), rows_of(scores, rows),
                         body, self.body_pose[rows], samples=self.samples, device=self.device)
            for body, rows in self.worlds()])


def distance_to_surface(body: Body, points_m: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Unsigned distances [m] of points to the body's surface, shape (world, point).

    `points_m` has shape (world, point, 3), in the body's frame. A point that is not finite has a
    distance that is not finite. The signed distance of a single primitive is exact; that of a
    compound, a grid or a superquadric is a bound. There the nearest of the sample's points
    is taken, and the foot of the perpendicular on its disc is moved onto the surface along
    the gradient: the nearer of the two counts.
    """
    if body.has_exact_distance:
        return np.abs(signed_distance_to_bodies(scene_of([body], device), np.zeros(1, int),
                                                points_m, device=device))
    sample = sample_body(body, surface=None)
    known = np.isfinite(points_m).all(-1, keepdims=True)
    away, nearest = sample.tree.query(np.where(known, points_m, 0.0))
    v = points_m - sample.surface_m[nearest]
    normal = sample.surface_normal[nearest]
    across = v - (v * normal).sum(-1, keepdims=True) * normal
    wide = np.linalg.norm(across, axis=-1)
    foot = sample.surface_m[nearest] + across * np.minimum(
        sample.reach_m[nearest] / np.maximum(wide, 1e-12), 1.0)[..., None]
    scene = scene_of([body], device)
    signed, slope = distance_to_bodies(scene, np.zeros(1, int), foot, device=device)
    on = foot - slope * (signed / np.maximum((slope**2).sum(-1), 1e-12))[..., None]
    left = np.abs(distance_to_bodies(scene, np.zeros(1, int), on, device=device)[0])
    best = np.where(left < ON_M, np.minimum(away, np.linalg.norm(points_m - on, axis=-1)), away)
    return np.where(np.asarray(known)[..., 0], best, np.nan)
