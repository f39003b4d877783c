"""How far to trust what one episode recovered, in a sentence: from what the robot knows alone."""

import numpy as np

from fit.arrays import rows_of
from fit.implicit.record import TriangleMesh
from fit.revolution.geometry import revolution_surface
from fit.superquadric.geometry import superquadric_areas
from strategies.contacts.body_uncertainty import INADEQUATE_FROM
from strategies.contacts.volume_spread import interval_trusted
from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import (
    ACCEPTED,
    DOUBTED_M,
    UNEXPLAINED_M,
    accepted_rms,
    doubted,
    mean_gap,
    unexplained,
)
from strategies.recovery.plausibility import FEWEST_CONTACTS
from sweeps.episode.episodes import EpisodeBlock
from sweeps.figures.meshes import mesh_of_world

NEAR_M = 0.02
"""A place of the surface farther than this from every contact is a guess of the model."""
SURFACE_POINTS = 864

_NOTHING = {
    "too_few_contacts": "too few contacts for any body",
    "fit_failed": "no body could be fitted to the contacts",
    "fit_implausible": "contacts, free space, table or prior contradict what was fitted",
    "reconstruct_failed": "the function that recovers bodies failed",
    "strategy_failed": "the strategy failed before enough was felt",
    "not_possible": "the strategy asks for what the hand cannot do",
}


def trust_sentence(block: EpisodeBlock, world: int = 0) -> str:
    """What speaks for the recovered body of one world, and how much of it was never felt."""
    recovered = rows_of(block.recovered, np.array([world]))
    evidence = rows_of(block.exploration.placed, np.array([world]))
    felt = int(evidence.mask.sum())
    mesh = mesh_of_world(block, world)
    if mesh is not None:
        return free_form_sentence(mesh, evidence.points_m[0][evidence.mask[0]])
    if recovered.shape[0] == Shape.PRIOR:
        why = _NOTHING.get(str(block.status[world]), str(block.status[world]))
        return (f"nothing was recovered: {why} ({felt} contacts); the body written is the prior "
                "that the strategy was given")
    near = np.asarray(block.exploration.verdicts[world] == ACCEPTED)
    share = surface_near(recovered, evidence.points_m[0][near])
    far = felt - int(near.sum())
    text = _share_text(share, felt - far, "is the model's guess")
    if far:
        text += f"; {far} more contacts contradict it, or may be elsewhere"
    belief = block.exploration.belief
    low, high = 1e6 * belief.uncertainty.volume_interval_m3()[world]
    text += f"; its volume is {low:.0f} to {high:.0f} cm3 (90 %)"
    off = accepted_rms(block.recovered, belief.evidence)
    if not interval_trusted(belief.uncertainty.signs, off)[world]:
        text += ", but intervals of such bodies held less often"
    if belief.felt.contradicted_share()[world] >= INADEQUATE_FROM:
        text += "; many contacts contradict the model"
    return text


def choice_sentence(block: EpisodeBlock, world: int = 0) -> str:
    """Which body `reconstruct = "chosen"` has chosen for one world, and why."""
    mine = np.array([world])
    recovered, evidence = rows_of(block.recovered, mine), rows_of(block.evidence, mine)
    model = {Shape.PRIOR: "given prior", Shape.SUPERQUADRIC: "superquadric",
             Shape.REVOLUTION: "contour"}[Shape(int(recovered.shape[0]))]
    why = (f"contacts lie {1e3 * mean_gap(recovered, evidence)[0]:.1f} mm from the {model} in the "
           "mean")
    if recovered.shape[0] == Shape.PRIOR:
        why = "no model was recovered"
    rebuilt = block.rebuilt
    if rebuilt is not None and world in rebuilt.polyhedra:
        planes = rebuilt.polyhedra[world]
        table = " and the table" * (len(planes.normals) > planes.felt)
        return (f"chosen: a polyhedron of {planes.felt} faces felt{table}, to which touches of "
                f"pads are nearer than to the {model}")
    if mesh_of_world(block, world) is not None:
        return f"chosen: a free form{_about(block, world)}, since {why}"
    bent = block.exploration.belief.fit.bend
    if (not bent and recovered.shape[0] == Shape.SUPERQUADRIC
            and recovered.superquadric.bend[0, 0] != 0.0):
        return f"chosen: a {model} that bends: {why}, clearly less than from a straight one"
    if not (unexplained(recovered, evidence) | doubted(recovered, evidence))[0]:
        return (f"chosen: the {model}, since {why}; a free form is tried from "
                f"{1e3 * UNEXPLAINED_M:.0f} mm on, beside a round body {1e3 * DOUBTED_M:.1f} mm")
    if evidence.mask.sum() < FEWEST_CONTACTS:
        return f"chosen: the {model}, since {FEWEST_CONTACTS} contacts are needed for a free form"
    if not unexplained(recovered, evidence)[0]:
        return f"chosen: the {model}; {why}, but torques do not clearly agree with a free form"
    return (f"chosen: the {model}; {why}, but table, prior or contacts contradict the free form")


def _about(block: EpisodeBlock, world: int) -> str:
    """What the free form of a world stands about, if anything."""
    forms = {} if block.rebuilt is None else block.rebuilt.forms
    shape = forms[world].about.shape if world in forms else ""
    if shape == "revolution":
        return " about the contour that was followed"
    return f" about the {shape.replace('_', ' ')} that its contacts make" if shape else ""


def free_form_sentence(mesh: TriangleMesh, contacts_m: np.ndarray) -> str:
    """How much of the surface of a free form was felt, contacts (point, 3)."""
    from fit.implicit.volume import surface_samples  # with it JAX's solvers, for a free form alone

    points = surface_samples(mesh, SURFACE_POINTS)
    points = points[points[:, 2] > TABLE_MARGIN_M]
    away = np.linalg.norm(points[:, None] - contacts_m, axis=-1).min(1, initial=np.inf)
    share = float((away <= NEAR_M).mean()) if len(points) else np.nan
    return _share_text(share, len(contacts_m), "was not felt")


def _share_text(share: float, contacts: int, rest: str) -> str:
    if np.isnan(share):
        return (f"the recovered body is lower than {1e3 * TABLE_MARGIN_M:.0f} mm, so low that a "
                f"touch of it is hardly told from the table's ({contacts} contacts)")
    return (f"{100 * share:.0f} % of the recovered surface is within {1e3 * NEAR_M:.0f} mm of one "
            f"of {contacts} contacts, the rest {rest}")


def surface_near(recovered: Recovered, contacts_m: np.ndarray) -> float:
    """Share of one body's surface above the table within `NEAR_M` of a contact, (point, 3); NaN
    where nothing of it is."""
    if recovered.shape[0] == Shape.REVOLUTION and recovered.revolution is not None:
        points, _, area = revolution_surface(recovered.revolution)
    else:
        points, area = superquadric_areas(recovered.superquadric, SURFACE_POINTS)
    area = np.where(points[0, :, 2] > TABLE_MARGIN_M, area[0], 0.0)
    away = np.linalg.norm(points[0][:, None] - contacts_m, axis=-1).min(1, initial=np.inf)
    return float(area[away <= NEAR_M].sum() / area.sum()) if area.any() else np.nan
