"""Error against touches, of the first episodes of each object: means over objects, then episodes.
"""

from collections.abc import Sequence

import numpy as np

from sweeps.analysis.curves import Steps, on_grid
from sweeps.analysis.paired import filled

POINTS = 40
KNOWN = 0.95
"""Where fewer episodes have a fit there is no mean: of the quick ones alone it would flatter."""


def mean_error(objects: Sequence[Sequence[Steps]]) -> list[tuple[float, float]]:
    """Points (touches, error [mm]) of an entry from its episodes' steps on each object.

    An episode whose error is no number counts as the worst on its object. Empty where episodes
    were fitted once only, at their end.
    """
    if not objects or not any(len(at) > 1 for of_object in objects for at, _ in of_object):
        return []
    longest = max(float(at[-1]) for of_object in objects for at, _ in of_object)
    grid = np.unique(np.round(np.linspace(0.0, longest, POINTS)))
    means, known = [], []
    for of_object in objects:
        errors = filled(np.concatenate([error for _, error in of_object]), None)
        ends = np.cumsum([len(at) for at, _ in of_object])
        parts = zip(of_object, np.split(errors, ends[:-1]), strict=True)
        values = np.array([on_grid((at, error), grid) for (at, _), error in parts])
        good = np.isfinite(values)
        count = good.sum(axis=0)
        means.append(np.divide(np.where(good, values, 0.0).sum(axis=0), count, where=count > 0,
                               out=np.full(len(grid), np.nan)))
        known.append(good.mean(axis=0))
    mean = np.where(np.min(known, axis=0) >= KNOWN, np.mean(means, axis=0), np.nan)
    return [(float(at), round(float(value), 4)) for at, value in zip(grid, mean, strict=True)
            if np.isfinite(value)]
