"""Which contacts the recovered body explains, and why others are rejected.

A contact is placed by the torques of a finger and by the body that all contacts make. Where the two
contradict one another, or torques leave open which link touched, it may be anywhere on the finger.
So it may where torques leave open where along the link it is, and where that depends on the model:
where a smooth surface through the contacts would have it elsewhere (`docs/model.md`).
Everything here is known to the robot.
"""

import numpy as np

from fit.arrays import row_sums, rows_of
from fit.implicit.record import TriangleMesh
from strategies.contacts.finger_touch import TouchedLinks
from strategies.recovery.body_distances import contour_distances, surface_distances
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.evidence import CONTRADICTED_FROM, Evidence
from strategies.recovery.misfit import FARTHEST_M
from strategies.recovery.second_surface import moved_on_second_surface
from strategies.recovery.upright import stand_upright

NEAR_M = 0.006
"""An accepted contact of a finger lies at most this far from the body [est]."""
UNSURE_M = 0.010 / 2.576
"""Standard deviation along the link from which a contact of a finger is more than 10 mm off with a
probability of 1 % or more, as its torques tell."""
LONGER = 1.01
"""Ratio of variances from which torques tell one direction less than another."""
MOVED_M = 0.003
"""A contact that lies farther than this from its place on a second surface depends on the model
[est]."""
UNEXPLAINED_M = 0.002
"""Mean distance of contacts from a body that does not explain them [m] [est]."""
DOUBTED_M = 0.0016
"""The same of a round body beside which a free form is tried [m] [est]."""
ROUND_FROM = 0.5
"""Exponent of the level section from which a superquadric is round, as `decide` takes it."""
REFUTED_SHARE, SPARED_SHARE = 0.5, 0.1
"""A body is refuted where torques contradict it at this share of its contacts, and no more than the
second share of them is accepted [est]."""
MOST_CONTRADICTED = 9.0
"""What a contact that contradicts a body more, or of a link in doubt, counts as."""
ACCEPTED, UNSURE_LINK, UNSURE_PLACE, UNSURE_BODY, CONTRADICTED, FAR, TABLE = (
    "accepted", "unsure_link", "unsure_place", "unsure_body", "contradicted", "far", "table")
"""Verdicts: too far from the body to be its contact is `far`, as near to the table as to be told
from it is `table`; `unsure_body` is a place that only the model tells."""


def surface_gaps(recovered: Recovered, points_m: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """How far points (world, point, 3) are from the body that stands [m], (world, point)."""
    gap = np.abs(surface_distances(recovered.superquadric, points_m, mask)[0])
    if recovered.revolution is None:
        return gap
    turned = (recovered.shape == Shape.REVOLUTION)[:, None]
    return np.where(turned, contour_distances(recovered.revolution, points_m, mask), gap)


def known_gaps(recovered: Recovered, points_m: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The same, infinite in worlds where only the prior stands for the body."""
    known = (recovered.shape != Shape.PRIOR)[:, None]
    return np.where(known, surface_gaps(recovered, points_m, mask), np.inf)


def mean_gap(recovered: Recovered, evidence: Evidence) -> np.ndarray:
    """How far contacts are from the body that stands, in the mean [m], (world,). Distances beyond
    `FARTHEST_M` count as that. A contour is judged by what pads felt alone: pads made it, and a
    finger's contact may lie millimetres off."""
    pads = evidence.mask & evidence.by_pad
    alone = (recovered.shape == Shape.REVOLUTION) & pads.any(1)
    counted = np.where(alone[:, None], pads, evidence.mask)
    away = np.minimum(surface_gaps(recovered, evidence.points_m, counted), FARTHEST_M)
    return row_sums(np.where(counted, away, 0.0)) / np.maximum(counted.sum(1), 1)


def gaps_to_mesh(mesh: TriangleMesh, points_m: np.ndarray) -> np.ndarray:
    """How far points (point, 3) are from a surface [m], (point,)."""
    from warpgrasp.objects.mesh_orientation import mesh_gap, mesh_of  # of few bodies asked

    return mesh_gap(mesh_of(mesh.vertices_m, mesh.faces, winding=False), points_m)


def mean_gap_to_mesh(mesh: TriangleMesh, points_m: np.ndarray) -> float:
    """How far contacts (contact, 3) are from a surface, in the mean [m], as `mean_gap` counts."""
    return float(np.minimum(gaps_to_mesh(mesh, points_m), FARTHEST_M).mean())


def unexplained(recovered: Recovered, evidence: Evidence) -> np.ndarray:
    """Worlds whose recovered body lies off its contacts, or that have none, bool (world,).

    A free form passes near every contact: contacts cannot choose between it and a model, they can
    only contradict the model. Where they do not, the model stands, for it knows more of what was
    not felt.
    """
    return ((recovered.shape == Shape.PRIOR)
            | (mean_gap(recovered, evidence) > UNEXPLAINED_M))


def doubted(recovered: Recovered, evidence: Evidence) -> np.ndarray:
    """Worlds whose round superquadric explains its contacts only just, and may have bent them
    towards itself, as it does where a bottle has a neck, bool (world,). A body with faces is not
    doubted so soon: a free form would round its edges by more than that."""
    section = stand_upright(recovered.superquadric).section_exponent
    return ((recovered.shape == Shape.SUPERQUADRIC) & (section >= ROUND_FROM)
            & (mean_gap(recovered, evidence) > DOUBTED_M))


def mean_contradiction(evidence: Evidence) -> np.ndarray:
    """How far torques are, in the mean, from what they should be where contacts were placed,
    (world,). Contacts placed on two bodies tell which one torques agree with, if one clearly."""
    each = np.minimum(np.nan_to_num(evidence.contradiction, posinf=MOST_CONTRADICTED),
                      MOST_CONTRADICTED)
    return (row_sums(np.where(evidence.mask, each, 0.0))
            / np.maximum(evidence.mask.sum(1), 1))


def contact_verdicts(
    recovered: Recovered, evidence: Evidence, links: TouchedLinks | None = None
) -> np.ndarray:
    """The verdict of each contact of the evidence, (world, point), as `verdicts_by_gap` has them
    of the model that stands."""
    return verdicts_by_gap(known_gaps(recovered, evidence.points_m, evidence.mask), evidence,
                           links)


def verdicts_by_gap(gap_m: np.ndarray, evidence: Evidence, links: TouchedLinks | None = None,
                    of_model: np.ndarray | None = None) -> np.ndarray:
    """The verdict of each contact of the evidence, (world, point); empty text where there is none.

    `gap_m` (world, point) is how far contacts are from their body, infinite where there is none.
    With `links` no contact is accepted whose place depends on the model; that takes some hundredths
    of a second a world. Of worlds that are not `of_model`, bool (world,), no place does.
    """
    near = evidence.mask & (gap_m <= np.where(evidence.by_pad, FARTHEST_M, NEAR_M))
    verdict = np.full(near.shape, ACCEPTED, object)
    along_link = _along_link(evidence)
    verdict[along_link > UNSURE_M] = UNSURE_PLACE
    verdict[evidence.contradiction > CONTRADICTED_FROM] = CONTRADICTED
    verdict[np.isinf(evidence.contradiction)] = UNSURE_LINK
    verdict[~near] = FAR
    verdict[~evidence.mask] = ""
    if links is not None:
        asked = np.asarray(verdict == ACCEPTED) & (along_link > 0.0)
        asked &= True if of_model is None else of_model[:, None]
        verdict[moved_on_second_surface(evidence, links, asked) > MOVED_M] = UNSURE_BODY
    return verdict


def refuted(recovered: Recovered, evidence: Evidence) -> np.ndarray:
    """Worlds whose contacts speak against the body fitted to them, bool (world,): fingers that
    stopped elsewhere, at the hand itself or at nothing.

    That hardly any contact is accepted does not suffice: the place of each may be vague, and the
    body true all the same.
    """
    contacts = evidence.mask.sum(1)
    against = (evidence.mask & (evidence.contradiction > CONTRADICTED_FROM)).sum(1)
    found = np.asarray((contacts > 0) & (against >= REFUTED_SHARE * contacts))
    rows = np.flatnonzero(found)
    accepted = accepted_contacts(rows_of(recovered, rows), rows_of(evidence, rows)).sum(1)
    found[rows] = accepted <= SPARED_SHARE * contacts[rows]
    return found


def _along_link(evidence: Evidence) -> np.ndarray:
    """The largest standard deviation [m] of each contact whose place torques tell, (world, point);
    0 of others: those of pads, and fingertips that are taken for contacts, which are as unsure in
    all directions."""
    asked = evidence.mask & ~evidence.by_pad
    covariance = np.where(asked[..., None, None], evidence.covariance_m2, 0.0)
    variances = np.linalg.eigvalsh(covariance)
    longer = variances[..., -1] > LONGER * variances[..., 0]
    return np.sqrt(np.where(longer, variances[..., -1], 0.0))


def accepted_contacts(recovered: Recovered, evidence: Evidence) -> np.ndarray:
    """Which contacts count as the body's, bool (world, point), as `contact_verdicts` has them."""
    return np.asarray(contact_verdicts(recovered, evidence) == ACCEPTED)


def accepted_rms(recovered: Recovered, evidence: Evidence) -> np.ndarray:
    """Root mean square distance of the contacts that the body explains from it [m], (world,); NaN
    where there is none. Those whose place depends on the model are among them: along the body."""
    accepted = accepted_contacts(recovered, evidence)
    gap = surface_gaps(recovered, evidence.points_m, evidence.mask)
    count = accepted.sum(1)
    square = row_sums(np.where(accepted, gap, 0.0) ** 2)
    return np.where(count > 0, np.sqrt(square / np.maximum(count, 1)), np.nan)
