"""The paper's first experiment: six objects from grasps by containment.

The same grasps are recovered from in many ways: contacts taken to be here or there
(`sweeps.paper.contacts`), and fitted to with more or less evidence. What a way switches on is read
off its table. Way by way the episodes are the same, so that differences are paired.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from fit.fit_status import is_fitted
from fit.superquadric.geometry import Superquadric
from fit.superquadric.record import SuperquadricFit
from strategies.contacts.finger_touch import TouchedLinks, touched_links
from strategies.ready_made import STRATEGIES
from strategies.recovery.choose_model import or_prior
from strategies.recovery.evidence import Evidence, evidence_from_grasps
from strategies.recovery.fit_contacts import recover_bodies
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.episode.scores import Scores, score_superquadrics
from sweeps.paper.contacts import FINGERTIP, Contacts, contacts_of
from sweeps.paper.convergence import iterations_of
from sweeps.spec.cell import Cell
from warpgrasp.parameters import FitTable, SensorTable

OBJECTS = ("large_cylinder", "block", "wedge", "lightbulb", "funnel", "small_cylinder")
STRATEGY = "rim6-ring12"
SEED = 1990
TORQUES = "joint torques"
"""Contacts placed on the links by joint torques, and on the body last fitted."""
AS_PAPER = FitTable(table_plane=False, free_space=False, weights=False, loss="none", rounds=0,
                    residual="solina", rivals=False, upright_rad=None, flat_ends=False,
                    shape_prior=False)
"""Solina's residual alone, of a tapered superquadric."""
OURS = FitTable()
FITS = {"Solina": AS_PAPER, "Solina, rivals": replace(AS_PAPER, rivals=True),
        "all evidence, no rivals": replace(OURS, rivals=False), "all evidence": OURS}
"""What bodies are fitted by, by name."""
PLAIN, RIVALS, NO_RIVALS, ALL = FITS


@dataclass(frozen=True)
class Recovered:
    """One object recovered in many episodes, in one way. Shapes start with (episode,)."""

    name: str
    contacts: str
    """Where contacts are taken to be: one of the five of `contacts`, or by joint torques."""
    fit: str
    """Which of `FITS`."""
    evidence: Evidence
    """Contacts as placed for the last fit."""
    bodies: Superquadric
    """What is scored: the fits, and where nothing could be fitted the prior."""
    body_pose: np.ndarray
    """Where the objects truly stand, (episode, 7)."""
    fitted: np.ndarray
    """Bool (episode,)."""
    replaced: np.ndarray
    """Where a rival's body took the place of the first residual's, bool (episode,)."""
    scores: Scores
    iterations: np.ndarray
    """Of a plain fit to convergence, (episode,); NaN where there were too few contacts."""
    seconds_a_fit: float
    """Time of 20 iterations of one fit; printed, and in no file."""


@dataclass(frozen=True)
class Grasped:
    """What is recovered of one object, and where its contacts were."""

    ways: tuple[Recovered, ...]
    contacts: Contacts


def recover_objects(episodes: int) -> list[Grasped]:
    """Every object in every way."""
    return [_recover(name, np.arange(episodes)) for name in OBJECTS]


def _recover(name: str, episodes: np.ndarray) -> Grasped:
    ways, contacts = by_fingertip(name, episodes)
    return Grasped((*ways, *by_torques(name, episodes)), contacts)


def by_fingertip(name: str, episodes: np.ndarray) -> tuple[list[Recovered], Contacts]:
    """As the paper has it, and with contacts put right in part; Solina's residual, and rivals."""
    cell = _cell(name, AS_PAPER, "fingertip")
    block = run_block(cell, episodes, "cpu")
    contacts = contacts_of(block, cell.hand)
    return [way for placed, evidence in contacts.placed.items()
            for way in _pair(name, placed, (PLAIN, RIVALS), evidence, None, block)], contacts


def by_torques(name: str, episodes: np.ndarray) -> list[Recovered]:
    """From all evidence, without and with rivals."""
    cell = _cell(name, OURS, "intrinsic")
    block = run_block(cell, episodes, "cpu")
    grasps, = block.grasps
    return _pair(name, TORQUES, (NO_RIVALS, ALL),
                 evidence_from_grasps(grasps, cell.hand.link_radius_m),
                 touched_links(grasps, cell.hand, cell.contact), block)


def _cell(name: str, fit: FitTable, estimator: str) -> Cell:
    return Cell(STRATEGIES[STRATEGY], {"name": name}, name, seed=SEED, fit=fit,
                sensors=SensorTable(contact_estimator=estimator))


def _pair(
    name: str, contacts: str, fits: tuple[str, str], evidence: Evidence,
    links: TouchedLinks | None, block: EpisodeBlock,
) -> list[Recovered]:
    """Without rivals, and with them."""
    found: list[tuple[SuperquadricFit, Evidence]] = [
        recover_bodies(evidence, links, FITS[fit]) for fit in fits]
    (alone, _), (rivalled, _) = found
    differ = np.any([(getattr(alone, f.name) != getattr(rivalled, f.name)).reshape(
        len(alone), -1).any(1) for f in fields(alone)], axis=0)
    ways = []
    for fit, replaced, (bodies, placed) in zip(fits, (np.zeros_like(differ), differ), found,
                                               strict=True):
        iterations, seconds = np.full(len(alone), np.nan), np.nan
        if (contacts, fit) in ((FINGERTIP, PLAIN), (TORQUES, ALL)):
            iterations, seconds = iterations_of(placed.points_m, placed.mask)
        fitted = is_fitted(bodies.status)
        scored = or_prior(bodies, block.prior, fitted)
        scores = score_superquadrics(scored, block.body, block.truth.body_pose)
        ways.append(Recovered(name, contacts, fit, placed, scored, block.truth.body_pose, fitted,
                              replaced, scores, iterations, seconds))
    return ways


def switched_on(table: FitTable) -> str:
    """What a table's fits go by, word by word: its residual, and all that is not switched off."""
    off = {"loss": "none", "rounds": 0}
    words = [f"residual {table.residual}"]
    for f in fields(table):
        value = getattr(table, f.name)
        if f.name == "upright_rad" and value is not None and table.table_plane:
            words.append("upright")
        elif value is True:
            words.append(f.name)
        elif f.name in off and value != off[f.name]:
            words.append(f"{f.name} {value}")
    return ", ".join(words)


RECOVERY_HEADER = (
    "object", "contacts", "fit", "switched_on", "episodes", "fitted", "replaced_by_rival",
    "contacts_median", "contacts_p10", "contacts_p90", "iou_median", "iou_p10", "iou_p90",
    "chamfer_mm_median", "volume_ratio_median", "iterations_median", "iterations_p90")


def recovery_rows(found: list[Grasped]) -> list[tuple[str, ...]]:
    """The table, a row for each way and object; p10 and p90 are quantiles over episodes."""
    rows = []
    for r in sorted((r for g in found for r in g.ways), key=lambda r: _order(r, found)):
        count, seen = r.evidence.mask.sum(1), r.iterations[np.isfinite(r.iterations)]
        (low, high), iou = np.quantile(count, [0.1, 0.9]), r.scores.iou
        rows.append((
            r.name, r.contacts, r.fit, switched_on(FITS[r.fit]), str(len(iou)),
            str(r.fitted.sum()), str(r.replaced.sum()), f"{np.median(count):.0f}", f"{low:.0f}",
            f"{high:.0f}", f"{np.median(iou):.3f}", f"{np.quantile(iou, 0.1):.3f}",
            f"{np.quantile(iou, 0.9):.3f}", f"{1e3 * np.median(r.scores.chamfer_m):.2f}",
            f"{np.median(r.scores.volume_ratio):.2f}",
            f"{np.median(seen):.0f}" if len(seen) else "NA",
            f"{np.quantile(seen, 0.9):.0f}" if len(seen) else "NA"))
    return rows


def _order(r: Recovered, found: list[Grasped]) -> int:
    ways = [(w.contacts, w.fit) for w in found[0].ways]
    return ways.index((r.contacts, r.fit))


def of_way(found: list[Grasped], contacts: str, fit: str) -> list[Recovered]:
    """Every object recovered in one way."""
    return [r for g in found for r in g.ways if (r.contacts, r.fit) == (contacts, fit)]


def median_world(r: Recovered) -> int:
    """The episode of median IoU, for the figure."""
    return int(np.argsort(r.scores.iou, kind="stable")[len(r.scores.iou) // 2])
