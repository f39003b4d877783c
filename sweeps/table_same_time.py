"""Errors at the robot time at which one strategy's episode ended: who was ahead by then.

Each episode is paired with the same one (object, pose, noise) of the strategy compared with, and
looked at when that one ended. An episode that had no fit yet by then counts as the worst that any
strategy had on the object at that moment.
"""

import numpy as np

from sweeps.bootstrap import Estimate, MeanOverObjects, estimate
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
    if not curves.objects:
        raise LeaderboardError("same-time: no block of episodes is finished for every strategy "
                               "yet; `warpgrasp status` says how far it is")
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
    mean = MeanOverObjects(len(curves.labels), None, curves.seed)
    for found, blocks in zip(curves.steps["time_s"], curves.blocks, strict=True):
        error = np.array([[_error_at(mine, end[0][-1]) for mine, end in
                           zip(of_entry, found[other], strict=True)] for of_entry in found])
        start = 0
        for place, count in blocks:
            mean.add(error[:, start:start + count].T, place)
            start += count
        mean.finish_object()
    every = mean.means()
    objects = np.array(mean.objects).reshape(-1, len(curves.labels))
    return every[0], estimate(every - every[:, [other]]), objects


def _error_at(steps: Steps, time_s: float) -> float:
    return float(on_grid(steps, np.array([time_s]))[0])
