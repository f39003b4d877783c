"""Where an object may be by a Gaussian process over the distance to its surface.

The process says in each cell how likely a ball of a link's radius touches the body, and how much a
touch there would tell. Where it knows nothing, another grid counts: the prior, what was barred.
"""

import numpy as np
from scipy.special import ndtr

from fit.implicit.known import KnownProcess, known_deviations, known_slopes
from fit.implicit.record import ImplicitFit
from strategies.foresight.occupancy import CELLS, Occupancy

EVERY = 2
"""The process is asked in the middle of so many cells along each axis; between, its slope tells."""
TOUCH_M = 0.002
"""Standard deviation of a touch, as in what it tells [est]."""
_DIGITS = 9
"""Products round by where arrays lie in memory: in metres."""


def process_occupancy(
    grid: Occupancy, fits: list[ImplicitFit], worlds: np.ndarray, process: KnownProcess
) -> tuple[Occupancy, np.ndarray]:
    """The grids of all worlds with those of `worlds` as `fits`, one a world, have them, and what a
    touch in each cell is worth there, from 0 to 1, (world, cells); 1 elsewhere.

    A touch is worth what it would tell of the distance there, the logarithm of the variance before
    it over that after it, as a share of what the first one told.
    """
    hit, cap = grid.hit.copy(), grid.cap.copy()
    worth = np.ones_like(grid.hit)
    before = np.log1p((process.amplitude_m / TOUCH_M) ** 2)
    for fit, world in zip(fits, worlds, strict=True):
        distance, deviation = _asked(grid, int(world), fit, process)
        unknown = np.minimum((deviation / fit.amplitude_m[0]) ** 2, 1.0)
        likely = ndtr((grid.radius_m - distance) / np.hypot(deviation, TOUCH_M))
        believed = np.minimum(grid.hit[world], grid.cap[world])
        hit[world] = (1.0 - unknown) * likely + unknown * believed
        cap[world] = 1.0
        worth[world] = np.minimum(np.log1p((deviation / TOUCH_M) ** 2) / before, 1.0)
    seen = Occupancy(grid.corner_m, grid.cell_m, hit, grid.radius_m)
    seen.cap = cap
    return seen, worth


def _asked(grid: Occupancy, world: int, fit: ImplicitFit, process: KnownProcess
           ) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and its standard deviation in each cell of a world, (cells,)."""
    counts = np.array(CELLS) // EVERY
    size, corner = grid.cell_m[world], grid.corner_m[world]
    node = np.stack(np.meshgrid(*(np.arange(count) + 0.5 for count in counts), indexing="ij"), -1)
    node = corner + node.reshape(-1, 3) * size * EVERY
    value, slope = known_slopes(fit, 0, process, node)
    value, slope = np.round(value, _DIGITS), np.round(slope, _DIGITS)
    deviation = np.round(known_deviations(fit, 0, process, node), _DIGITS)
    cell = np.stack(np.meshgrid(*(np.arange(count) + 0.5 for count in CELLS), indexing="ij"), -1)
    mine = tuple(np.moveaxis((cell / EVERY).astype(int), -1, 0))
    of = np.ravel_multi_index(mine, tuple(counts))
    arm = corner + cell * size - node[of]
    distance = value[of] + arm[..., 0] * slope[of][..., 0]
    for axis in (1, 2):  # written out: one order of rounding
        distance = distance + arm[..., axis] * slope[of][..., axis]
    return distance.ravel(), deviation[of].ravel()
