"""Planes of faces, and the errors of calibration that all touches of an episode share, together.

Thirty touches of a pad leave a plane's noise at a tenth of a millimetre, but a wrong mount or joint
moves all of them by one or two. Pads and links at other postures are moved otherwise, by known
amounts for each error (`strategies.contacts.shared_errors`). So planes and errors are fitted at
once, the errors with their deviations as prior: least squares with an errors' covariance, solved
again with weights that bear outliers.
"""

from dataclasses import dataclass

import numpy as np

from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.shared_errors import shared_shifts
from strategies.procedures.lean import face_axes
from strategies.recovery.evidence import CONTRADICTED_FROM, Evidence
from strategies.recovery.free_contacts import LATER_SIGMA_M, PAD_SIGMA_M
from strategies.recovery.misfit import FARTHEST_M
from warpgrasp.parameters import ArmTable, ErrorTable

ROUNDS = 6
"""Solutions, each with new weights and other nearest faces."""
OUTLYING = 2.0
"""Deviations from which on a touch counts less: Cauchy's."""
ASIDE_M = 0.001
"""A touch whose place on the nearest plane is so far beyond another one is of an edge."""
PLANE_SIGMA = 0.05
"""Prior deviation of a plane's offset [m] and tilt [rad] from what was felt: as good as none."""
EXACT = 10
"""Digits kept of a correction: library products round by where arrays lie in memory."""


@dataclass(frozen=True)
class Planes:
    """Of the faces of one body n.x <= offset, the table's last if it is known."""

    normals: np.ndarray
    """Outward, unit, (face, 3)."""
    offset_m: np.ndarray
    """(face,)."""
    felt: int
    """How many of them, the first ones, were felt."""


def calibrated_planes(planes: Planes, evidence: Evidence, links: TouchedLinks, errors: ErrorTable,
                      arm: ArmTable) -> Planes:
    """The planes of one world with the errors of calibration taken out, as far as touches tell.

    `evidence` (1, point) has contacts as placed on the body recovered, `links` how fingers stood.
    Those that contradict their body take no part. The table's plane is exact.
    """
    use = evidence.mask[0] & (evidence.contradiction[0] <= CONTRADICTED_FROM)
    points = evidence.points_m[0][use]
    sigma = np.where(evidence.by_pad[0][use], PAD_SIGMA_M, LATER_SIGMA_M)
    error = np.zeros(0)
    normals, offset = planes.normals.copy(), planes.offset_m.copy()
    for _ in range(ROUNDS):
        face, kept = _nearest(normals, offset, planes.felt, points)
        if not kept.any():
            break
        outward = np.zeros((1, len(use), 3))
        outward[0, use] = normals[face]
        shift = shared_shifts(links, evidence.points_m, outward, errors, arm)[0][use][kept]
        arm_m, axes = _arms(normals, points[kept], face[kept], planes.felt)
        gap = ((points * normals[face]).sum(1) - offset[face])[kept]
        gap_left = gap - (shift @ error if len(error) else 0.0)
        weight = 1.0 / sigma[kept]**2 / (1.0 + (gap_left / (OUTLYING * sigma[kept]))**2)
        turn, move, error = _solved(gap, shift, face[kept], arm_m, weight, planes.felt)
        for k in range(planes.felt):
            middle = _middle(points[kept], face[kept] == k)
            level = normals[k] @ middle - offset[k]  # of the middle above its plane
            turned = normals[k] + turn[k] @ axes[k]
            normals[k] = turned / np.linalg.norm(turned)
            offset[k] = normals[k] @ middle - level + move[k]
    return Planes(normals, offset, planes.felt)


def _nearest(normals: np.ndarray, offset: np.ndarray, felt: int, points: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray]:
    """The face each point is nearest to, (point,), and which points lie on one that was felt and
    within it, bool (point,)."""
    beyond = (points[:, None] * normals).sum(-1) - offset
    face = beyond.argmax(1)
    off = beyond.max(1)
    foot = points - off[:, None] * normals[face]
    aside = ((foot[:, None] * normals).sum(-1) - offset).max(1)
    return face, (face < felt) & (np.abs(off) < FARTHEST_M) & (aside <= ASIDE_M)


def _middle(points: np.ndarray, mine: np.ndarray) -> np.ndarray:
    return points[mine].mean(0) if mine.any() else points.mean(0)


def _arms(normals: np.ndarray, points: np.ndarray, face: np.ndarray, felt: int
          ) -> tuple[np.ndarray, np.ndarray]:
    """Where points lie on their faces from the middle of its points [m], (point, 2), and the
    faces' axes, (face, 2, 3)."""
    axes = face_axes(normals[:felt])[:, :2]
    middle = np.array([_middle(points, face == k) for k in range(felt)])
    return ((points - middle[face])[:, None] * axes[face]).sum(-1), axes


def _solved(gap: np.ndarray, shift: np.ndarray, face: np.ndarray, arm: np.ndarray,
            weight: np.ndarray, felt: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tilts (face, 2) and moves (face,) [m] of the planes, and errors in their deviations.

    A point's gap is what its plane is wrong by there, what errors shift it by, and noise.
    """
    rows = np.arange(len(gap))
    design = np.zeros((len(gap), 3 * felt + shift.shape[1]))
    design[rows, 3 * face] = 1.0
    design[rows, 3 * face + 1], design[rows, 3 * face + 2] = -arm.T
    design[:, 3 * felt:] = shift
    prior = np.ones(design.shape[1])
    prior[:3 * felt] = PLANE_SIGMA**-2
    found = np.linalg.solve(design.T @ (weight[:, None] * design) + np.diag(prior),
                            design.T @ (weight * gap)).round(EXACT)
    of_planes = found[:3 * felt].reshape(felt, 3)
    return of_planes[:, 1:], of_planes[:, 0], found[3 * felt:]
