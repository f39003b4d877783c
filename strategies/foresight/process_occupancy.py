"""Where an object may be by a Gaussian process over the distance to its surface.

The process says in each cell how likely a ball of a link's radius touches the body, and how much a
touch there would tell. Where it knows nothing, another grid counts: the prior, what was swept, what
was barred.
"""

import numpy as np
from scipy.ndimage import zoom
from scipy.special import ndtr

from fit.implicit.known import KnownProcess, known_deviations, known_slopes
from fit.implicit.record import ImplicitFit
from strategies.foresight.occupancy import CELLS, Occupancy

EVERY = 2
"""The process is asked in the middle of blocks of so many cells along each axis; its slope tells of
the cells."""
TOUCH_M = 0.002
"""Standard deviation of a touch, as in what it tells [est]."""
HARDLY = 0.02
"""Where opinions are pooled, blocks whose cells are all believed less are not asked about, which
halves the time: there the given grid decides alone [est]."""
LEAST = 1e-12
_NODES = tuple(count // EVERY for count in CELLS)
_BLOCKS = tuple(number for count in _NODES for number in (count, EVERY))
_DIGITS = 9
"""Products round by where arrays lie in memory: in metres."""


def occupancy_by_process(
    grid: Occupancy, fits: ImplicitFit, worlds: np.ndarray, process: KnownProcess, *,
    pooled: bool = False
) -> tuple[Occupancy, np.ndarray]:
    """The grids of all worlds with those of `worlds` as `fits`, one a world, have them, and what a
    touch in each cell is worth there, from 0 to 1, (world, cells); 1 elsewhere.

    If `pooled`, process and given grid are two experts, one as good as the other: their opinions
    are pooled by their logarithms (Genest and Zidek 1986, Combining probability distributions).

    A touch is worth what it would tell of the distance there, the logarithm of the variance before
    it over that after it, as a share of what it would tell where nothing is known.
    """
    hit, cap = grid.hit.copy(), grid.cap.copy()
    worth = np.ones_like(grid.hit)
    for row, world in enumerate(worlds):
        given = grid.believed[world]
        asked = np.ones(_NODES, bool)
        if pooled:
            asked = given.reshape(_BLOCKS).max((1, 3, 5)) > HARDLY
        distance, deviation = _asked(grid, int(world), fits, row, process, asked)
        amplitude = float(fits.amplitude_m[row])
        unknown = np.minimum((deviation / amplitude) ** 2, 1.0)
        likely = ndtr((grid.radius_m - distance) / np.hypot(deviation, TOUCH_M))
        likely = (1.0 - unknown) * likely + unknown * given
        if pooled:
            yes, no = np.sqrt(likely * given), np.sqrt((1.0 - likely) * (1.0 - given))
            likely = np.where(_in_cells(asked), yes / np.maximum(yes + no, LEAST), given)
        hit[world], cap[world] = likely.ravel(), 1.0
        told, most = (np.log1p((m / TOUCH_M) ** 2) for m in (deviation, amplitude))
        worth[world] = np.minimum(told / most, 1.0).ravel()
    seen = Occupancy(grid.corner_m, grid.cell_m, hit, grid.radius_m)
    seen.cap = cap
    return seen, worth


def _asked(grid: Occupancy, world: int, fits: ImplicitFit, row: int, process: KnownProcess,
           asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and its standard deviation in each cell of a world, (x, y, z), as a fit of
    `process` has it at the nodes `asked`; elsewhere what it has where nothing was felt."""
    size, corner = grid.cell_m[world], grid.corner_m[world]
    node = corner + _middles(_NODES) * (size * EVERY)
    value, slope = np.full(_NODES, process.mean_m), np.zeros((*_NODES, 3))
    deviation = np.full(_NODES, fits.amplitude_m[row])
    found = known_slopes(fits, row, process, node[asked])
    value[asked], slope[asked] = (np.round(values, _DIGITS) for values in found)
    deviation[asked] = np.round(known_deviations(fits, row, process, node[asked]), _DIGITS)
    arm = corner + _middles(CELLS) * size - _in_cells(node)
    distance = _in_cells(value)
    for axis in range(3):  # written out: one order of rounding
        distance = distance + arm[..., axis] * _in_cells(slope[..., axis])
    between = zoom(deviation, EVERY, order=1, mode="nearest", grid_mode=True)
    return distance, np.asarray(between)


def _middles(counts: tuple[int, ...]) -> np.ndarray:
    """Middles of cells 1 wide, (x, y, z, 3)."""
    return np.stack(np.meshgrid(*(np.arange(count) + 0.5 for count in counts), indexing="ij"), -1)


def _in_cells(of_nodes: np.ndarray) -> np.ndarray:
    """What nodes have in each of their cells."""
    for axis in range(3):
        of_nodes = np.repeat(of_nodes, EVERY, axis)
    return of_nodes
