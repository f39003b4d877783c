"""Errors at the robot time at which one strategy's episode ended: who was ahead by then.

Each episode is paired with the same one (object, pose, noise) of the strategy compared with, and
looked at when that one ended. An episode that had no fit yet by then counts as the worst that any
strategy had on the object at that moment.
"""

import numpy as np

from sweeps.bootstrap import Estimate, estimate, widened
from sweeps.curves import Curves, Steps, on_grid
from sweeps.entries import LeaderboardError
from sweeps.problems import choose
from sweeps.table import TextTable, number_text

HEADER = ("strategy", "other", "chamfer_mm_then", "chamfer_mm_difference", "ci_low", "ci_high",
          "wins")


def same_time_table(curves: Curves, against: str | None) -> TextTable:
    """Every strategy minus `against`, at the time its episodes ended. Raises LeaderboardError."""
    if against is None or against not in curves.labels:
        raise LeaderboardError(f"same-time: --against {against or ''}: a strategy of the study is "
                               f"wanted; {choose(against, curves.labels)}")
    other = curves.labels.index(against)
    then, difference, objects = errors_then(curves, other)
    rows = []
    for entry, label in enumerate(curves.labels):
        if entry != other:
            wins = f"{int((objects[:, entry] < objects[:, other]).sum())}/{len(objects)}"
            rows.append((label, curves.labels[other], number_text(then[entry], 3),
                         *(number_text(float(v[entry]), 3)
                           for v in (difference.value, difference.low, difference.high)), wins))
    return TextTable(HEADER, tuple(rows), curves.notes)


def errors_then(curves: Curves, other: int) -> tuple[np.ndarray, Estimate, np.ndarray]:
    """Mean errors (entry,), differences to `other` with intervals, and the objects' mean errors
    (object, entry), at the time `other` ended [mm]."""
    means = []
    total, weight = np.zeros(()), np.zeros(())
    for number, found in enumerate(curves.steps["time_s"]):
        error = np.array([[_error_at(mine, end[0][-1]) for mine, end in
                           zip(of_entry, found[other], strict=True)] for of_entry in found])
        error = np.where(np.isfinite(error), error, np.nanmax(error))
        drawn = curves.weights[number].astype(float)
        mean = np.einsum("re,ke->rk", drawn, error) / np.maximum(
            drawn.sum(1, keepdims=True), 1e-12)
        total = total + curves.drawn[:, [number]] * mean
        weight = weight + curves.drawn[:, [number]]
        means.append(error.mean(1))
    every = widened(total / weight, len(curves.objects))
    return every[0], estimate(every - every[:, [other]]), np.array(means)


def _error_at(steps: Steps, time_s: float) -> float:
    return float(on_grid(steps, np.array([time_s]))[0])
