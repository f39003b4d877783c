"""Error against touches, of the first episodes of each object: means over objects, then episodes.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sweeps.analysis.curves import KNOWN, Steps, on_grid

POINTS = 64
"""Of a curve: at each step of its episodes where there are no more."""
ByObject = Mapping[str, Sequence[Steps]]
"""Each episode's steps, by object."""


def mean_errors(entries: Sequence[ByObject]) -> list[list[tuple[float, float]]]:
    """Points (touches, error [mm]) of each entry.

    An episode whose error is no number counts as the worst that any of these entries has on its
    object. Empty where episodes were fitted once only, at their end.
    """
    worst: dict[str, float] = {}
    for entry in entries:
        for name, steps in entry.items():
            errors = np.concatenate([error for _, error in steps])
            known = errors[np.isfinite(errors)]
            if len(known):
                worst[name] = max(worst.get(name, 0.0), float(known.max()))
    return [_mean_error(entry, worst) for entry in entries]


def _mean_error(objects: ByObject, worst: Mapping[str, float]) -> list[tuple[float, float]]:
    every = [steps for of_object in objects.values() for steps in of_object]
    if not any(len(at) > 1 for at, _ in every):
        return []
    grid = np.unique(np.concatenate([at[np.isfinite(at)] for at, _ in every]))
    if len(grid) > POINTS:
        grid = grid[np.round(np.linspace(0, len(grid) - 1, POINTS)).astype(int)]
    means, known = [], []
    for name, of_object in objects.items():
        values = np.array([
            on_grid((at, np.where(np.isfinite(error), error, worst.get(name, np.nan))), grid)
            for at, error in of_object])
        good = np.isfinite(values)
        count = good.sum(axis=0)
        means.append(np.divide(np.where(good, values, 0.0).sum(axis=0), count, where=count > 0,
                               out=np.full(len(grid), np.nan)))
        known.append(good.mean(axis=0))
    mean = np.where(np.min(known, axis=0) >= KNOWN, np.mean(means, axis=0), np.nan)
    return [(float(at), round(float(value), 4)) for at, value in zip(grid, mean, strict=True)
            if np.isfinite(value)]
