"""Where the second and third procedures start, from the body believed so far."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fit.arrays import rows_of
from fit.fit_status import FitStatus, is_fitted
from strategies.planners.probes import CrossFaces, FollowContour
from strategies.procedures.contour_record import Axis, ContourOptions
from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.procedures.planar_record import PlanarOptions
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Shape
from strategies.recovery.complete_contour import revolution_misfit, revolution_of_all
from strategies.recovery.misfit import touch_misfit
from strategies.recovery.upright import faces_of, stand_upright
from warpgrasp.core.random import Purpose, counter_key, counter_uniform

if TYPE_CHECKING:
    from strategies.procedures.stereo_axis import StereoAxis

_DOWN = -0.5  # the face a body stands on, and what leans over it, is out of reach
_TOP = np.cos(np.radians(45))
_LEAN_MOST = np.cos(np.radians(35))


def faces_to_cross(belief: Belief, table: PlanarTable, wanted: np.ndarray) -> CrossFaces:
    """The faces of the bodies believed: the top, then the sides, those nearest to the arm first.

    Of a body that leans the top is the face that points up the most.
    """
    points, normals = faces_of(belief.body)
    up = normals[..., 2]
    # The arm stands at the origin: a side whose normal points at it is the easiest to reach.
    towards = -(normals[..., :2] * points[..., :2]).sum(-1) / np.maximum(
        np.linalg.norm(points[..., :2], axis=-1), 1e-9)
    rank = np.where(up > -_DOWN, 10.0 * up, 0.0) + towards
    rank = np.where(up < _DOWN, -np.inf, rank)
    order = np.argsort(-rank, axis=1, kind="stable")[:, :table.faces]
    pick = order[..., None]
    chosen = np.isfinite(np.take_along_axis(rank, order, 1))
    return CrossFaces(
        np.take_along_axis(points, pick, 1), np.take_along_axis(normals, pick, 1),
        chosen & wanted[:, None],
        PlanarOptions(interval_m=table.interval_m, stand_off_m=table.stand_off_m,
                      step_m=table.step_m, edge_drop_m=table.edge_drop_m,
                      most_steps=table.most_steps))


def top_to_cross(belief: Belief, table: PlanarTable, wanted: np.ndarray) -> CrossFaces:
    """Only the top of each body."""
    faces = faces_to_cross(belief, table, wanted)
    top = slice(0, 1)
    assert faces.wanted is not None
    flat = faces.normal[:, top, 2] > _LEAN_MOST
    return CrossFaces(faces.point_m[:, top], faces.normal[:, top], faces.wanted[:, top] & flat,
                      faces.options)


def contour_to_follow(
    belief: Belief, table: ContourTable, wanted: np.ndarray, seen: "StereoAxis | None" = None
) -> FollowContour:
    """The contour about each body's upright line, its own axis, or the axis `seen` by cameras."""
    stands = stand_upright(belief.body)
    zero = np.zeros(belief.worlds)
    upright = np.stack([zero, zero, zero + 1.0], 1)
    way = {"vertical": upright, "fit": stands.axis}.get(table.axis, upright)
    if table.axis == "stereo" and seen is not None:
        way = seen.direction
    centre = stands.centre_m
    # The line's foot: where it meets the table.
    foot = centre - way * (centre[:, 2] / np.maximum(way[:, 2], 0.5))[:, None]
    # A fit to few contacts may flare out: no wider than the prior and its error.
    radius = np.minimum(stands.radius_m, belief.prior.radius_m + belief.prior.margin_m / 2)
    axis = Axis(foot, way, stands.top_m / np.maximum(way[:, 2], 0.5), radius)
    if table.axis_error_rad > 0:
        draw = counter_uniform(counter_key(belief.seed, int(Purpose.STRATEGY), 1))
        axis = axis.turned(zero + table.axis_error_rad, 2 * np.pi * draw)
    return FollowContour(axis, wanted, ContourOptions(
        step_m=table.step_m, finest_step_m=table.finest_step_m), table.refine)


class Next(NamedTuple):
    """Which worlds cross faces, and which follow a contour, bool (world,) each."""

    faces: np.ndarray
    contour: np.ndarray


def decide(belief: Belief, table: DecideTable, last: Next | None = None) -> Next:
    """Which worlds go on with faces and which with a contour; `last` is what they just did.

    A body whose level section is a rectangle has faces; one whose section is an ellipse has a
    contour (a z-axis cylinder has eps1 ~ 0.1, eps2 ~ 1), and so has one that a surface of
    revolution describes as well. Where no body is believed yet faces of the prior are crossed, for
    a finger that comes down on an object meets it where two that close about an axis may not.
    Where one of them was done already it is left at that, if it bore out the choice (sides that
    are flat, a contour that explains the touches); if not, the other is next.
    """
    stands = stand_upright(belief.body)
    round_ = belief.fitted & (stands.section_exponent >= table.round_from)
    crossed, flat = sides_crossed(belief)
    followed = (np.zeros(belief.worlds, bool) if belief.profile is None
                else np.isfinite(belief.profile.volume_m3))
    has_faces = (crossed > 0) & (flat >= table.flat_share * crossed)
    has_contour = followed & (belief.shape == Shape.REVOLUTION)
    done = has_faces | has_contour
    asked = ~done & ~followed & (crossed == 0) & ~round_
    if last is not None:
        asked &= ~last.faces & ~last.contour
    rows = np.flatnonzero(asked)
    round_[rows] = turned(belief, table, rows)
    if last is not None:  # what has just found nothing would find nothing again
        round_ = last.faces | (round_ & ~last.contour)
    contour = ~done & ~followed & np.where(crossed > 0, True, round_)
    faces = ~done & ~contour & (crossed == 0)
    return Next(faces, contour)


def turned(belief: Belief, table: DecideTable, rows: np.ndarray) -> np.ndarray:
    """Whether a surface of revolution explains the touches about as well as the superquadric.

    The exponent alone may be wrong with few touches, or for a body that no superquadric is; on a
    block or a wedge no surface of revolution comes near all touches. Asked of the worlds `rows`
    (row,) alone, for it takes a fit; bool (row,).
    """
    if table.turned_within == 0.0 or len(rows) == 0:
        return np.zeros(len(rows), bool)
    evidence, prior = rows_of(belief.evidence, rows), rows_of(belief.prior, rows)
    turned_off = revolution_misfit(revolution_of_all(evidence, prior), evidence)
    near = turned_off <= table.turned_within * touch_misfit(belief.fits[rows], evidence)
    return near & (turned_off <= table.turned_within_m)


def sides_crossed(belief: Belief) -> tuple[np.ndarray, np.ndarray]:
    """How many sides (not tops) were crossed in each world, and how many proved flat, (world,).
    Where touches contradict their plane, it is a side only if it is one by what they felt, too."""
    crossed, flat = np.zeros(belief.worlds, int), np.zeros(belief.worlds, int)
    for face in belief.faces:
        side = is_fitted(face.fit.status) & (np.abs(face.normal[:, 2]) < _TOP)
        side &= (face.fit.status == FitStatus.converged) | (np.abs(face.felt_normal[:, 2]) < _TOP)
        crossed += side
        flat += side & face.flat
    return crossed, flat


def flat_topped(belief: Belief, table: DecideTable) -> np.ndarray:
    """Whether the end of each body is flat, bool (world,)."""
    return stand_upright(belief.body).profile_exponent < table.flat_below
