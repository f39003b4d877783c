"""Bodies as distances at the nodes of a grid, kept in the cache (`geometry.sdf_grid`)."""

import io
from collections.abc import Callable

import numpy as np

from warpgrasp.core.cache_file import cache_root, read_cached, write_cached
from warpgrasp.geometry.body import Body, Part, distances_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.geometry.sdf_grid import GRID_MARGIN_M

Distance = Callable[[np.ndarray], np.ndarray]
"""Signed distances [m], (n,), of points (n, 3) [m]."""
NODES = 96
"""Along the longest side."""
_VERSION = 6
_VOLUME_POINTS = 32_768
_VOLUME_SHARE = 0.1
"""Of its volume that a body may lose or gain."""
_TRIED = 4000
"""Places at which the error is measured."""


def baked_body(
    low_m: np.ndarray, high_m: np.ndarray, distance: Distance, nodes_along: int = NODES
) -> Body:
    """A body without a name, in a box with these corners, of a grid of distances."""
    low, high = np.asarray(low_m, float), np.asarray(high_m, float)
    cell = (float((high - low).max()) + 2 * GRID_MARGIN_M) / (nodes_along - 1)
    nodes = np.ceil((high - low + 2 * GRID_MARGIN_M) / cell - 1e-9).astype(int) + 1
    grid = distance(_places(low - GRID_MARGIN_M, cell, nodes)).reshape(nodes)
    body = _body(grid, low - GRID_MARGIN_M, cell, low, high, 0.0)
    # The error is measured where contacts happen: within two cells of the surface.
    near = _nodes_near(body)
    near = near[:: max(1, len(near) // _TRIED)] + 0.5 * cell * np.array([1.0, 0.7, 0.4])
    error = float(np.quantile(np.abs(distances_of(body)(near)[0] - distance(near)), 0.99))
    return _body(grid, low - GRID_MARGIN_M, cell, low, high, error)


def volumes_m3(body: Body, distance: Distance) -> tuple[float, float]:
    """What a baked body holds, and what it was made of: thin walls are lost between the nodes.

    Both are sampled about the nodes near the surface; others are well inside or outside.
    """
    cell, grid, band = body.parts[0].grid_cell_m, body.parts[0].grid_m, _nodes_near(body)
    deep = int((grid <= -2 * cell).sum())
    sample = band[:: max(1, len(band) // _VOLUME_POINTS)]
    sample = sample + np.random.default_rng(0).uniform(-cell / 2, cell / 2, sample.shape)
    held, wanted = (cell**3 * (deep + len(band) * float((d < 0.0).mean()))
                    for d in (distances_of(body)(sample)[0], distance(sample)))
    return held, wanted


def lost(held_m3: float, wanted_m3: float) -> bool:
    """Whether a baked body has lost or gained too much of its volume."""
    return wanted_m3 == 0.0 or abs(held_m3 - wanted_m3) > _VOLUME_SHARE * wanted_m3


def _nodes_near(body: Body) -> np.ndarray:
    """The nodes of a baked body within two cells of its surface, (n, 3) [m]."""
    part, = body.parts
    places = _places(np.array(part.grid_origin_m), part.grid_cell_m, np.array(part.grid_m.shape))
    return places[np.abs(part.grid_m.ravel()) < 2 * part.grid_cell_m]


def cached_grid(key: str, make: Callable[[], Body]) -> Body:
    """The baked body that is kept under a key, a hash of all that it is made of, else a new one."""
    file = cache_root() / "grids" / f"{key[:32]}-{_VERSION}.grid"
    content = read_cached(file)
    if content is not None:
        with np.load(io.BytesIO(content), allow_pickle=False) as kept:
            return _body(*(kept[name] for name in ("grid", "origin", "cell", "low", "high",
                                                   "error")))
    body = make()
    part, = body.parts
    text = io.BytesIO()
    np.savez_compressed(
        text, allow_pickle=False, grid=part.grid_m, origin=part.grid_origin_m,
        cell=part.grid_cell_m, low=body.low_m, high=body.high_m, error=body.grid_error_m)
    write_cached(file, text.getvalue())
    return body


def _body(grid: np.ndarray, origin: np.ndarray, cell: float, low: np.ndarray, high: np.ndarray,
          error: float) -> Body:
    part = Part(Shape.GRID, grid_m=np.asarray(grid, np.float32), grid_origin_m=triple(origin),
                grid_cell_m=float(cell))
    return Body("", (part,), triple(low), triple(high), grid_error_m=float(error))


def _places(origin: np.ndarray, cell: float, nodes: np.ndarray) -> np.ndarray:
    """Places of all nodes, (n, 3) [m], x slowest and z fastest."""
    axes = [origin[k] + cell * np.arange(nodes[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def triple(values: np.ndarray) -> tuple[float, float, float]:
    """A point as a record of a body holds it."""
    return float(values[0]), float(values[1]), float(values[2])
