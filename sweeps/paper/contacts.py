"""Where contacts of the paper's grasps are taken to be: its fingertip estimate, and what if.

The paper takes the palmar point of the fingertip as the contact. Where it is wrong another link
touched, or the round tip touched elsewhere than at its palmar point. Each part is put right alone:

- `fingertip`: the palmar point of the tip, whatever touched.
- `true link`: where the middle or the proximal link touched, the palmar point half way along it.
- `true point on the tip`: where the distal link touched, the true point.
- `true link and tip point`: both.
- `true points`: every true point; contacts that no link made on the object are left out.

Truth stands here because the experiments compare with it; no strategy and no fit sees it.
"""

from dataclasses import dataclass, replace

import numpy as np

from strategies.recovery.evidence import Evidence, evidence_from_grasps
from sweeps.episode.episodes import EpisodeBlock
from warpgrasp.parameters import HandTable

FINGERTIP, TRUE_LINK, TRUE_TIP, TRUE_BOTH, TRUE_POINTS = (
    "fingertip", "true link", "true point on the tip", "true link and tip point", "true points")
DISTAL = 2


@dataclass(frozen=True)
class Contacts:
    """Contacts of one object's episodes, by where they are taken to be."""

    placed: dict[str, Evidence]
    """Evidence for each of the five; all but the points and the mask is the same."""
    on_distal: np.ndarray
    """Contacts made by the distal link on the object, bool (episode, slot)."""
    on_other: np.ndarray
    """Contacts made by another link on the object."""
    off_m: np.ndarray
    """Distance of the fingertip estimate from the true point, NaN elsewhere."""


def contacts_of(block: EpisodeBlock, hand: HandTable) -> Contacts:
    """The contacts of a block whose episodes are one round of grasps, felt as fingertips."""
    (grasps,), (truth,) = block.grasps, block.truth.closings
    told = evidence_from_grasps(grasps, hand.link_radius_m)
    shape = told.mask.shape
    link, point = truth.link.reshape(shape), truth.point_m.reshape(*shape, 3)
    on_body = (told.mask & np.isfinite(point).all(-1) & (link >= 0)
               & ~truth.on_table.reshape(shape) & ~truth.self_contact.reshape(shape))
    distal, other = on_body & (link == DISTAL), on_body & (link != DISTAL)
    middles = palmar_middles(grasps.estimate.link_points_m, grasps.estimate.point_m,
                             hand.link_radius_m).reshape(*shape, 3, 3)
    of_link = np.take_along_axis(middles, np.maximum(link, 0)[..., None, None], 2)[..., 0, :]
    by_link = _put(told.points_m, other, of_link)
    return Contacts({
        FINGERTIP: told,
        TRUE_LINK: replace(told, points_m=by_link),
        TRUE_TIP: replace(told, points_m=_put(told.points_m, distal, point)),
        TRUE_BOTH: replace(told, points_m=_put(by_link, distal, point)),
        TRUE_POINTS: replace(told, points_m=_put(told.points_m, on_body, point), mask=on_body)},
        distal, other,
        np.where(on_body, np.linalg.norm(told.points_m - np.nan_to_num(point), axis=-1), np.nan))


def palmar_middles(
    joints_m: np.ndarray, fingertip_m: np.ndarray, radius_m: float
) -> np.ndarray:
    """Palmar points half way along each link, (..., link 3, 3) [m].

    `joints_m` (..., 4, 3) are a finger's joints and the centre of its tip, `fingertip_m` (..., 3)
    the palmar point of the tip. The flexions turn about one direction, which the distal link and
    its palmar side show. NaN where there is no contact.
    """
    along = np.diff(joints_m, axis=-2)
    along = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    palmar = (fingertip_m - joints_m[..., 3, :]) / radius_m
    hinge = np.cross(palmar, along[..., 2, :])[..., None, :]
    side = np.cross(along, np.broadcast_to(hinge, along.shape))
    return 0.5 * (joints_m[..., :-1, :] + joints_m[..., 1:, :]) + radius_m * side


def _put(points: np.ndarray, where: np.ndarray, instead: np.ndarray) -> np.ndarray:
    return np.where(where[..., None], instead, points)
