"""Tables of error against touches and robot time, and of what a good shape costs."""

from dataclasses import dataclass

import numpy as np

from sweeps.bootstrap import INTERVAL, REPLICATES
from sweeps.curves import AXES, Curves, grid_of, mean_curve
from sweeps.table import TextTable, number_text

BOUNDS_MM = (5.0, 3.0)
FEW = 6  # episodes: the order statistics of fewer do not hold their median with 95 %
_CHUNK = 100  # replicates sorted out at a time


@dataclass(frozen=True)
class Reach:
    """How soon an entry's error is first within a bound."""

    share: float
    """Of the episodes that ever get there."""
    median: float
    """Half of all episodes are there by then; infinite where fewer than half ever are."""
    low: float
    high: float


def reach(curves: Curves, axis: str, entry: int, bound_mm: float) -> Reach:
    """The median over episodes, every object weighing the same, with its interval.

    There is no interval of one object's few episodes.
    """
    at = [np.array([_first(steps, bound_mm) for steps in found[entry]])
          for found in curves.steps[axis]]
    if not at:
        return Reach(np.nan, np.nan, np.nan, np.nan)
    pooled = np.concatenate(at)
    order = np.argsort(pooled, kind="stable")
    medians = np.empty(1 + REPLICATES)
    for start in range(0, 1 + REPLICATES, _CHUNK):
        rows = slice(start, start + _CHUNK)
        weights = np.concatenate(
            [_shares(own[rows].astype(float)) * curves.drawn[rows, n][:, None]
             for n, own in enumerate(curves.weights)], axis=1)
        gone = np.cumsum(weights[:, order], axis=1)
        half = (gone >= gone[:, -1:] * (0.5 - 1e-12)).argmax(axis=1)
        medians[rows] = np.where(gone[:, -1] > 0, pooled[order][half], np.nan)
    drawn = medians[1:][~np.isnan(medians[1:])]
    low, high = np.full(2, np.nan)
    if len(curves.objects) > 1 or curves.draws >= FEW:
        low, high = np.quantile(drawn, INTERVAL, method="inverted_cdf")
    return Reach(float(np.mean([np.isfinite(part).mean() for part in at])),
                 float(medians[0]), float(low), float(high))


def _shares(weights: np.ndarray) -> np.ndarray:
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, where=total > 0, out=np.zeros_like(weights))


def _first(steps: tuple[np.ndarray, np.ndarray], bound_mm: float) -> float:
    at, error = steps
    there = error <= bound_mm
    return float(at[there.argmax()]) if there.any() else np.inf


def curves_table(curves: Curves) -> TextTable:
    """The table of `warpgrasp table DIR curves`: a line a point of the grid."""
    rows = []
    for axis in AXES:
        grid = grid_of(curves, axis)
        for n, label in enumerate(curves.labels):
            found = mean_curve(curves, axis, n, grid)
            rows += [(label, axis, f"{at:.6g}", *(number_text(v, 3) for v in values))
                     for at, *values in zip(grid, found.value, found.low, found.high, strict=True)]
    return TextTable(("strategy", "against", "at", "chamfer_mm", "ci_low", "ci_high"),
                     tuple(rows), curves.notes)


def reach_table(curves: Curves) -> TextTable:
    """The table of `warpgrasp table DIR reach`: touches and seconds to 5 mm and 3 mm."""
    rows = []
    for bound in BOUNDS_MM:
        for n, label in enumerate(curves.labels):
            touches, time = (reach(curves, axis, n, bound) for axis in AXES)
            rows.append((label, f"{bound:g}", number_text(touches.share, 4),
                         *(number_text(v, 0) for v in (touches.median, touches.low, touches.high)),
                         *(number_text(v, 1) for v in (time.median, time.low, time.high))))
    return TextTable(("strategy", "within_mm", "share", "touches", "touches_ci_low",
                      "touches_ci_high", "robot_time_s", "robot_time_s_ci_low",
                      "robot_time_s_ci_high"), tuple(rows), curves.notes)
