"""Superquadric fits against scipy's least squares, on the same residuals from the same starts."""

from math import nan
from typing import Any

import jax
import numpy as np
from scipy.optimize import least_squares

from fit.fit_status import FitStatus
from fit.optimize.batch import map_lanes
from fit.optimize.multistart import Problem, finish
from fit.prepare import prepare
from fit.superquadric.descent import begin_starts
from fit.superquadric.parameter_vector import Form, unpack
from fit.superquadric.record import SuperquadricOptions
from fit.superquadric.residuals import normal_equations, residual_vector
from sweeps.validate.comparison import Comparison
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name

OBJECTS = ("block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel")
NEAR = 1e-6
ONE_VALLEY_M = 1e-5
"""Bodies whose half axes and places agree to this are the same optimum."""
POINTS, SIGMA_M = 60, 0.001


def compare_fits(sets_each: int = 1) -> list[Comparison]:
    """Costs and bodies at the optimum, from every start of fits to touches of six objects."""
    return [row for parameters, taper in ((11, False), (13, True))
            for row in _compare(parameters, taper, sets_each)]


def touches(sets_each: int) -> np.ndarray:
    """Points on the upper nine tenths of each object with 1 mm noise, (set, point, 3) [m]."""
    rng = np.random.default_rng(2)
    found = []
    for name in OBJECTS:
        surface = sample_body(body_from_name(name)).surface_m
        upper = surface[surface[:, 2] > 0.1 * surface[:, 2].max()]
        for _ in range(sets_each):
            chosen = upper[rng.choice(len(upper), POINTS, replace=False)]
            found.append(chosen + rng.normal(0.0, SIGMA_M, chosen.shape))
    return np.asarray(found)


def _compare(parameters: int, taper: bool, sets_each: int) -> list[Comparison]:
    options = SuperquadricOptions(taper=taper, residual="solina")
    form = Form(taper, False, "solina", "none")  # as published
    _, sets = next(iter(prepare(touches(sets_each), None, table_z=0.0).buckets()))
    lanes, theta = begin_starts(sets, form, options)
    starts = theta.reshape(-1, theta.shape[-1])
    problem = Problem(lambda t, lane: normal_equations(t, lane, form), f"{form}")
    ours = finish(problem, starts, lanes, at_a_time=50, at_most=1000)
    with jax.enable_x64(True):
        value = jax.jit(lambda t, lane: residual_vector(t, lane, form))
        theirs = [_descend(value, starts[k], jax.tree.map(lambda x, k=k: x[k], lanes))
                  for k in range(len(starts))]
        polished = [_descend(value, ours.theta[k],
                             jax.tree.map(lambda x, k=k: x[k], lanes))
                    for k in range(len(starts))]
    cost = np.array([t.cost for t in theirs])
    away = _apart(form, lanes, ours.theta, np.array([t.x for t in theirs]), sets.scale)
    done = ours.status == FitStatus.converged
    same = done & (away < ONE_VALLEY_M)
    above = ((ours.cost - cost) / cost)[same]
    left = ((ours.cost - np.array([t.cost for t in polished])) / ours.cost)[done]
    best_ours = ours.cost.reshape(theta.shape[:2]).min(1)
    best_theirs = cost.reshape(theta.shape[:2]).min(1)
    what = f"{parameters} parameters, {len(starts)} starts"
    return [
        Comparison("fits", f"{what}: how far ours is above theirs at one optimum", "relative",
                   float(ours.cost[same].mean()), float(cost[same].mean()),
                   float(max(above.max(), 0.0)), NEAR,
                   f"{same.sum()} ended at one body, {(done & ~same).sum()} at two, "
                   f"{(~done).sum()} of ours not converged; theirs above ours by up to "
                   f"{max(-above.min(), 0.0):.2g}"),
        Comparison("fits", f"{what}: how far scipy falls from our optimum, median", "relative", nan,
                   nan, float(np.median(left)), NEAR,
                   f"{(left > NEAR).sum()} of {done.sum()} fall more; largest {left.max():.2g}"),
        Comparison("fits", f"{what}: size and place at the same optimum, p95", "mm", nan, nan,
                   1e3 * float(np.quantile(away[same], 0.95)), nan,
                   "flat directions of the cost move the body, not the cost"),
        Comparison("fits", f"{what}: best of a set's starts, mean cost", "relative",
                   float(best_ours.mean()), float(best_theirs.mean()),
                   float(np.maximum(best_ours / best_theirs - 1.0, 0.0).max()), nan,
                   f"ours lower in {(best_ours < best_theirs * (1 - NEAR)).sum()}, theirs in "
                   f"{(best_theirs < best_ours * (1 - NEAR)).sum()} of {len(best_ours)} sets"),
    ]


def _descend(value: Any, start: np.ndarray, lane: Any) -> Any:
    return least_squares(lambda t: np.asarray(value(t, lane)), start,
                         jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=1000)


def _apart(form: Form, lanes: Any, one: np.ndarray, other: np.ndarray,
           scale: np.ndarray) -> np.ndarray:
    """Largest difference of half axes and place [m] of two bodies, (lane,)."""
    program = jax.vmap(lambda theta, rotation: unpack(theta, rotation, form))
    a, b = (map_lanes(program, theta, lanes.rotation) for theta in (one, other))
    metres = np.repeat(scale, len(one) // len(scale))
    return metres * np.maximum(np.abs(np.asarray(a.size) - b.size).max(1),
                               np.abs(np.asarray(a.position) - b.position).max(1))
