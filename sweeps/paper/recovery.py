"""The paper's first experiment: six objects from grasps by containment; convergence of the fits."""

import time
from dataclasses import dataclass

import numpy as np

from fit.optimize.batch import take
from fit.optimize.multistart import Problem, advance
from fit.prepare import prepare
from fit.superquadric.descent import begin_starts
from fit.superquadric.parameter_vector import Form
from fit.superquadric.record import SuperquadricOptions
from fit.superquadric.residuals import normal_equations
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.spec.cell import Cell
from warpgrasp.parameters import FitTable, SensorTable

OBJECTS = ("large_cylinder", "block", "wedge", "lightbulb", "funnel", "small_cylinder")
STRATEGY = "rim6-ring12"
SEED = 1990
AS_PAPER = FitTable(table_plane=False, free_space=False, weights=False, loss="none", rounds=0,
                    residual="solina", upright_rad=None)
"""Solina's residual on fingertips alone: no table, no free space, no weights."""
SETTLED = 1.01
"""Iterations count until the cost is below this multiple of its last value."""
_ITERATIONS = 60
_SCREENED = 5  # iterations of every start, of which the best continues


@dataclass(frozen=True)
class Recovered:
    """One object recovered in many episodes, with one estimator and objective."""

    name: str
    way: str
    block: EpisodeBlock
    iterations: np.ndarray
    """To convergence, (episode,); NaN where there were too few contacts."""
    seconds_a_fit: float
    """Time of 20 iterations of one fit; printed, and in no file."""


def recover_objects(episodes: int) -> list[Recovered]:
    """Every object, as in the paper and with our evidence."""
    found = []
    fingertip = SensorTable(contact_estimator="fingertip")
    for way, sensors, fit in (("as the paper", fingertip, AS_PAPER),
                              ("ours", SensorTable(), FitTable())):
        for name in OBJECTS:
            cell = Cell(STRATEGIES[STRATEGY], {"name": name}, name, sensors=sensors, fit=fit,
                        seed=SEED)
            block = run_block(cell, np.arange(episodes), "cpu")
            iterations, seconds = _convergence(block)
            found.append(Recovered(name, way, block, iterations, seconds))
    return found


def _convergence(block: EpisodeBlock) -> tuple[np.ndarray, float]:
    """Iterations of the best start of a plain fit to the contacts, and the time of 20 [s]."""
    evidence = block.exploration.belief.evidence
    iterations = np.full(len(evidence.mask), np.nan)
    enough = np.flatnonzero(evidence.mask.sum(1) >= 14)
    if len(enough) == 0:
        return iterations, float("nan")
    options = SuperquadricOptions(taper=True, residual="solina")
    form = Form(True, False, "solina", "none")
    problem = Problem(lambda t, lane: normal_equations(t, lane, form), f"{form}")
    seconds = float("nan")
    for rows, sets in prepare(evidence.points_m[enough], evidence.mask[enough]).buckets():
        lanes, theta = begin_starts(sets, form, options)
        fits, starts = theta.shape[:2]
        moved = advance(problem, theta.reshape(fits * starts, -1), lanes, _SCREENED)
        damping = np.asarray(moved.damping)
        best = np.asarray(moved.cost).reshape(fits, starts).argmin(1)
        pick = np.arange(fits) * starts + best
        lanes = take(lanes, pick)
        theta, damping = np.asarray(moved.theta)[pick], damping[pick]
        costs = [np.asarray(moved.cost)[pick]]
        begin = time.process_time()
        for _ in range(_ITERATIONS - _SCREENED):
            moved = advance(problem, theta, lanes, 1, damping)
            theta, damping = np.asarray(moved.theta), np.asarray(moved.damping)
            costs.append(np.asarray(moved.cost))
        seconds = (time.process_time() - begin) / fits / (_ITERATIONS - _SCREENED)
        cost = np.stack(costs, 1)
        iterations[enough[rows]] = _SCREENED + (cost > SETTLED * cost[:, -1:]).sum(1)
    return iterations, 20 * seconds


RECOVERY_HEADER = ("object", "way", "episodes", "recovered", "contacts_median", "contacts_low",
                   "contacts_high", "iou_median", "iou_p10", "chamfer_mm_median",
                   "volume_ratio_median", "iterations_median", "iterations_p90")


def recovery_rows(found: list[Recovered]) -> list[tuple[str, ...]]:
    """The table, a row for each object and way; low and high are the 10 % and 90 % quantiles."""
    rows = []
    for r in found:
        contacts = r.block.exploration.belief.evidence.mask.sum(1)
        scores, seen = r.block.scores, r.iterations[np.isfinite(r.iterations)]
        low, high = np.quantile(contacts, [0.1, 0.9])
        rows.append((
            r.name, r.way, str(len(contacts)), f"{(r.block.status == 'ok').mean():.2f}",
            f"{np.median(contacts):.0f}", f"{low:.0f}", f"{high:.0f}",
            f"{np.median(scores.iou):.3f}", f"{np.quantile(scores.iou, 0.1):.3f}",
            f"{1e3 * np.median(scores.chamfer_m):.2f}", f"{np.median(scores.volume_ratio):.2f}",
            f"{np.median(seen):.0f}" if len(seen) else "NA",
            f"{np.quantile(seen, 0.9):.0f}" if len(seen) else "NA"))
    return rows


def median_world(r: Recovered) -> int:
    """The episode of median IoU, for the figure."""
    return int(np.argsort(r.block.scores.iou, kind="stable")[len(r.block.scores.iou) // 2])
