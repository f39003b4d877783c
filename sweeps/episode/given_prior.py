"""The prior that a strategy is given, a bounding cylinder, a box, or what two cameras see, and its
scores."""

from dataclasses import fields, replace

import numpy as np

from fit.arrays import rows_of
from strategies.poses.waypoints import PRIOR_MARGIN_M, BoundingBox, BoundingCylinder
from strategies.procedures.depth_prior import or_drawn, see_box
from strategies.procedures.stereo_prior import see_cylinder
from strategies.recovery.choose_model import Recovered, Shape, prior_superquadric
from sweeps.episode.scores import Scorer, Scores
from warpgrasp.core.random import Purpose, counter_key, counter_normal
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.outline import outline_of, radius_around
from warpgrasp.parameters import ObjectTable, StereoTable
from warpgrasp.robot import Robot

LEAST_RADIUS_M, LEAST_HEIGHT_M = 0.010, 0.020
LEAST_SQUARE_M2 = 1e-18
REMEMBERED = 100_000
"""Priors whose scores a process keeps, some 40 MiB; then it begins again."""
_known: dict[bytes, np.ndarray] = {}



def draw_prior(
    body: Body, body_pose: np.ndarray, table: ObjectTable, key: np.ndarray
) -> BoundingCylinder:
    """The bounding cylinder or box of each world, with a normal error in each number.

    `body_pose` (world, 7) and `key` (world,) uint64. A box is turned wrongly by as much as moves
    the middle of its shorter sides by `prior_sigma_m`.
    """
    stream = counter_key(key, int(Purpose.PRIOR))
    error = table.prior_sigma_m * counter_normal(counter_key(stream[:, None], np.arange(6)))
    height = np.maximum(body.high_m[2] + error[:, 3], LEAST_HEIGHT_M)
    margin = max(PRIOR_MARGIN_M, 3.0 * table.prior_sigma_m)
    if table.prior not in ("box", "depth"):
        radius = np.maximum(radius_around(body) + error[:, 2], LEAST_RADIUS_M)
        return BoundingCylinder(body_pose[:, 0] + error[:, 0], body_pose[:, 1] + error[:, 1],
                                radius, height, margin_m=margin)
    middle, half, turned = rectangle_around(body)
    yaw = 2.0 * np.arctan2(body_pose[:, 5], body_pose[:, 6])
    cos, sin = np.cos(yaw), np.sin(yaw)
    half = np.maximum(half + error[:, [2, 4]], LEAST_RADIUS_M)
    return BoundingBox(
        body_pose[:, 0] + cos * middle[0] - sin * middle[1] + error[:, 0],
        body_pose[:, 1] + sin * middle[0] + cos * middle[1] + error[:, 1],
        np.hypot(*half.T), height, half, yaw + turned + error[:, 5] / half.max(1), margin_m=margin)


def rectangle_around(body: Body) -> tuple[np.ndarray, np.ndarray, float]:
    """The smallest rectangle around a body seen from above, in its frame.

    Its middle [m], half its length and width [m], and the azimuth of its length [rad].
    """
    import trimesh

    to_rectangle, sides = trimesh.bounds.oriented_bounds_2D(outline_of(body))
    turned = float(np.arctan2(to_rectangle[0, 1], to_rectangle[0, 0]))
    middle = -to_rectangle[:2, :2].T @ to_rectangle[:2, 2]
    half = np.asarray(sides) / 2
    return (middle, half, turned) if half[0] >= half[1] else (
        middle, half[::-1].copy(), turned + np.pi / 2)


def prior_recovered(prior: BoundingCylinder) -> Recovered:
    """What an episode recovers that touches nothing: the prior of each world."""
    return Recovered(np.full(len(prior.x_m), Shape.PRIOR), prior_superquadric(prior))


def worse_than_prior(scores: Scores, prior: Scores) -> np.ndarray:
    """In which scores each world's body is worse than the prior that was given, as text (world,):
    "chamfer_mm", "iou", both with a space between, or nothing."""
    farther = np.where(scores.chamfer_m > prior.chamfer_m, "chamfer_mm", "")
    smaller = np.where(scores.iou < prior.iou, "iou", "")
    return np.char.strip(np.char.add(np.char.add(farther, " "), smaller))


def normalized_chamfer(scores: Scores, prior: Scores) -> np.ndarray:
    """What is left of the error of the prior that was given, (world,): 1 where nothing was gained.

    As Smith, Meger, Pineda and others (2021, Active 3D shape reconstruction from vision and touch)
    report it: the sum of the mean squared distances both ways, after exploring over before.
    """
    return scores.square_m2 / np.maximum(prior.square_m2, LEAST_SQUARE_M2)


def score_priors(scorer: Scorer, given: Recovered) -> Scores:
    """`scorer.score(given)`; a prior that was scored before is not scored again.

    A score depends on the true body, its pose, the samples and the prior alone, not on the worlds
    beside it.
    """
    prior = given.superquadric
    numbers = np.column_stack([scorer.body_pose, prior.size_m, prior.exponents, prior.position_m,
                               prior.quaternion_xyzw])
    names = [f"{scorer.samples} {scorer.bodies[body].content}".encode() + row.tobytes()
             for body, row in zip(scorer.which, numbers, strict=True)]
    if len(_known) + len(names) > REMEMBERED:
        _known.clear()
    asked = {name: world for world, name in enumerate(names) if name not in _known}
    if asked:
        rows = np.sort(list(asked.values()))
        part = replace(scorer, which=scorer.which[rows], body_pose=scorer.body_pose[rows]).score(
            rows_of(given, rows))
        table = np.column_stack([getattr(part, field.name) for field in fields(Scores)])
        _known.update(zip((names[row] for row in rows), table, strict=True))
    return Scores(*np.array([_known[name] for name in names]).T)


SEEN = ("silhouettes", "depth")
"""Words of `[object] prior` that cameras give."""


def seen_prior(
    robot: Robot, drawn: BoundingCylinder, table: StereoTable, kind: str
) -> tuple[BoundingCylinder, np.ndarray]:
    """What two cameras see, turned to the place that was drawn: cylinders by their silhouettes, or
    boxes with the depths; `kind` is one of `SEEN`.

    In worlds whose object is not seen or touches the edge of an image the drawn one stands; the
    text (world,) says so there and is empty elsewhere.
    """
    target = np.stack([drawn.x_m, drawn.y_m, drawn.height_m / 2], 1)
    if kind == "depth":
        box, whole = see_box(robot, target, table)
        assert isinstance(drawn, BoundingBox)
        return or_drawn(box, whole, drawn), np.where(
            whole, "", "object.prior depth: the object is not seen whole in the image; a larger "
            "stereo.field_of_view_deg or distance_mm shows a large one, smaller ones or more "
            "stereo.pixels a small one").astype(object)
    seen, whole = see_cylinder(robot, target, table)
    cylinder = BoundingCylinder(*(
        np.where(whole, new, old) for new, old in (
            (seen.x_m, drawn.x_m), (seen.y_m, drawn.y_m),
            (np.maximum(seen.radius_m, LEAST_RADIUS_M), drawn.radius_m),
            (np.maximum(seen.height_m, LEAST_HEIGHT_M), drawn.height_m))), margin_m=drawn.margin_m)
    why = np.where(whole, "", "object.prior silhouettes: the object is not seen whole in both "
                   "images; a larger stereo.field_of_view_deg or distance_mm shows a large one, "
                   "smaller ones or more stereo.pixels a small one, and fewer stereo.clutter leave "
                   "it by itself")
    return cylinder, why.astype(object)
