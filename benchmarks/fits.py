"""Superquadric fits a second, all starts included, beside scipy's from the same starts.

    python benchmarks/fits.py [--fits 512] [--parameters 11 13 15]

Prints a JSON line for each number of parameters. Points: 60 touches, 1 mm, none on the lowest
tenth, random bodies on a table, as in the quality table. scipy descends the very same residuals,
compiled, from the same six starts, with its own differences for the Jacobian.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from pathlib import Path

import jax
import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "fit"))
from quality_bodies import standing_bodies, touches

from fit.prepare import prepare
from fit.superquadric.descent import begin_starts
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.parameter_vector import Form
from fit.superquadric.record import SuperquadricOptions
from fit.superquadric.residuals import residual_vector

FORMS = {11: {}, 13: {"taper": True}, 15: {"taper": True, "bend": True}}


def points_of(n: int) -> np.ndarray:
    """Touches on `n` bodies [m], shape [n, 60, 3]."""
    rng = np.random.default_rng(1)
    return touches(standing_bodies(n, rng), 60, 1e-3, rng)


def fit_rate(parameters: int, n: int) -> dict[str, float]:
    """Fits a second of this process after its first call, which is timed apart [s]."""
    points, options = points_of(n), SuperquadricOptions(**FORMS[parameters])
    start = time.perf_counter()
    fit_superquadric(points[:64], table_z=0.0, options=options)
    first = time.perf_counter() - start
    times, core = [], []
    for _ in range(3):
        start, used = time.perf_counter(), time.process_time()
        fit_superquadric(points, table_z=0.0, options=options)
        times.append(time.perf_counter() - start)
        core.append(time.process_time() - used)
    return {"first_call_s": first, "fits_per_s": n / float(np.median(times)),
            "fits_per_core_s": n / float(np.median(core))}


def scipy_rate(parameters: int, n: int = 4) -> float:
    """Fits a second of processor time by scipy's least_squares, all six starts of each to the
    end."""
    options = SuperquadricOptions(**FORMS[parameters])
    _, sets = next(iter(prepare(points_of(n), None, table_z=0.0).buckets()))
    form = Form(options.taper, options.bend, "volume_distance" if options.taper else "solina",
                "none")
    lanes, theta = begin_starts(sets, form, options)
    starts = theta.shape[1]
    with jax.enable_x64(True):
        value = jax.jit(lambda t, lane: residual_vector(t, lane, form))
        at = lambda t, row: np.asarray(value(t, jax.tree.map(lambda x: x[row], lanes)))  # noqa: E731
        at(theta[0, 0], 0)
        begin = time.process_time()
        for row in range(n * starts):
            least_squares(at, theta.reshape(n * starts, -1)[row], args=(row,), max_nfev=80)
    return n / (time.process_time() - begin)


def _own_core(counter) -> None:
    """Pin this process to a core of its own, where the system lets it."""
    with counter.get_lock():
        index = counter.value
        counter.value += 1
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[index % len(cores)]})


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=512)
    parser.add_argument("--parameters", type=int, nargs="+", choices=FORMS, default=list(FORMS))
    arguments = parser.parse_args()
    n = arguments.fits
    context = multiprocessing.get_context("spawn")
    for parameters in arguments.parameters:
        alone = fit_rate(parameters, n)
        with context.Pool(2, _own_core, (context.Value("i", 0),)) as pool:
            both = pool.starmap(fit_rate, [(parameters, n)] * 2)
        row = {
            "parameters": parameters,
            "first_call_s": round(alone["first_call_s"], 2),
            "fits_per_s_one_process": round(alone["fits_per_s"]),
            "fits_per_s_two_processes": round(sum(r["fits_per_s"] for r in both)),
            # Of processor time: what a machine that others use too says least wrongly.
            "fits_per_core_s": round(float(np.mean([r["fits_per_core_s"] for r in both]))),
            "scipy_fits_per_core_s": round(scipy_rate(parameters), 2),
            "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        }
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
