"""Episodes that known models are learned from: objects with their names, and unlisted ones.

Unlisted objects are drawn by number: blocks, cylinders, superquadrics, and two parts on top of one
another, of the sizes that a hand explores.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from strategies.recognition.lessons import UNLISTED, Lesson, lesson_of
from strategies.strategy import Strategy
from sweeps.episode.episodes import cell_body, run_parts
from sweeps.spec.cell import Cell

TEACHERS = ("ring6", "random18", "ring18", "rim12-ring12", "planar", "contour", "coarse-to-fine")
"""Strategies that teach, unless others are named: grasps, few and many, faces and contours."""
HALF_WIDTH_MM, HALF_HEIGHT_MM = (18.0, 50.0), (25.0, 120.0)
"""Of unlisted objects: the least and the greatest."""


def unlisted_table(seed: int, number: int) -> dict[str, Any]:
    """The table of one unlisted object, as a spec would have it; every fourth is of one kind."""
    rng = np.random.default_rng([seed, number])
    a, b, h = (float(low * (high / low) ** rng.uniform())  # uniform in the logarithm
               for low, high in (HALF_WIDTH_MM, HALF_WIDTH_MM, HALF_HEIGHT_MM))
    e1, e2 = rng.uniform(0.15, 1.6, 2).tolist()
    share, other = rng.uniform(0.3, 0.9), rng.uniform(0.6, 1.8, 2)
    name = f"unlisted-{seed}-{number}"
    if number % 4 == 0:
        return {"name": name, "superquadric": {"size_mm": [a, b, h], "exponents": [e1, e2]}}
    if number % 4 == 1:
        parts = [{"shape": "block", "size_mm": [2 * a, 2 * b, 2 * h]}]
    elif number % 4 == 2:
        parts = [{"shape": "cylinder", "radius_mm": a, "height_mm": 2 * h}]
    else:
        upper = ({"shape": "cylinder", "radius_mm": a * share, "height_mm": h} if number % 8 == 3
                 else {"shape": "block", "size_mm": [*(a * other).tolist(), h]})
        parts = [{"shape": "cylinder", "radius_mm": a, "height_mm": h},
                 {**upper, "at_mm": [0.0, 0.0, h]}]
    return {"name": name, "compound": parts}


def teach(
    objects: Mapping[str, Mapping[str, Any]], strategies: Sequence[Strategy], episodes: int,
    seed: int, device: str, *, listed: bool = True,
) -> Iterator[tuple[Strategy, Lesson]]:
    """A lesson a strategy: so many episodes with each of `objects`, name to table.

    Objects that are not `listed` are learned without their names.
    """
    for strategy in strategies:
        cells = [Cell(strategy, table, name, seed=seed) for name, table in objects.items()]
        bodies = [cell_body(cell) for cell in cells]
        block = run_parts([(cell, np.arange(episodes)) for cell in cells], bodies, device)
        names = np.repeat(np.array([cell.object_name if listed else UNLISTED for cell in cells],
                                   object), episodes)
        numbers = np.repeat(np.arange(len(cells)), episodes)
        yield strategy, lesson_of(block.exploration.belief, block.recovered, names, numbers)


def contents_of(objects: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """The hash of each object's geometry."""
    return {name: cell_body(Cell(Strategy(""), table, name)).content
            for name, table in objects.items()}
