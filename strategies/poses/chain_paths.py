"""Closing paths of hands that are chains, from the closing paths of their models.

A finger's first joint that moves is its base, and those beyond it curl. The words of
`closing_paths` are for all of a hand's fingers at once: `together` goes the model's first closing
path evenly; `curl40` turns the outer joints by 40 degrees first, and closes the base; in
`base_then_curl` the base closes first. A closing path of the model, by its name, is gone evenly.
"""

from itertools import pairwise
from math import ceil, radians

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, closing_way
from warpgrasp.hands.hand_model import BASE_FIRST, CURLS_DEG

STEP_RAD = radians(0.5)
CURLS_RAD = {f"curl{v}": radians(v) for v in CURLS_DEG}
_BASE_SHARE, _OFF_STOPS_RAD = 0.7, radians(5)
"""Of `base_then_curl`: how far the base closes first, and by how much the others are off their
stops, where a touch turns no joint."""
EVENLY = "together"


def chain_path_names(hand: ChainHand) -> tuple[str, ...]:
    """Names of the hand's closing paths."""
    own = [closing.name for closing in hand.model.closings]
    return (EVENLY, *CURLS_RAD, BASE_FIRST, *(name for name in own if name != EVENLY))


def chain_commands(hand: ChainHand, name: str) -> np.ndarray:
    """Every command of a closing path, drives [rad], (finger, step, width).

    No drive moves more than half a degree between two commands; row 0 is the open hand. Raises
    KeyError for a name that is none of `chain_path_names`, and names those.
    """
    named = {closing.name: closing for closing in hand.model.closings}
    words = (EVENLY, *CURLS_RAD, BASE_FIRST)
    if name not in named and name not in words:
        raise KeyError(f"closing path {name!r}; should be one of "
                       f"{', '.join(chain_path_names(hand))}")
    start, end = np.moveaxis(closing_way(
        hand, named[name] if name in named else hand.model.closings[0], 2), 1, 0)
    way = end - start
    base = np.zeros(way.shape, bool)
    moved = np.abs(way) > 0.0
    first = moved.argmax(-1)
    base[np.arange(len(way)), first] = moved.any(-1)
    knots = [np.zeros_like(way)]
    if name in CURLS_RAD:
        knots.append(np.where(base, 0.0, _at_most(way, CURLS_RAD[name])))
        knots.append(np.where(base, way, knots[-1]))
    elif name == BASE_FIRST:
        off = _at_most(way, _OFF_STOPS_RAD)
        knots += [np.where(base, 0.0, off), np.where(base, _BASE_SHARE * way, off), way]
    else:
        knots.append(way)
    rows = [knots[0][:, None]]
    for one, two in pairwise(knots):
        count = max(1, ceil(np.abs(two - one).max() / STEP_RAD - 1e-9))
        share = (np.arange(1, count + 1) / count)[:, None]
        rows.append(one[:, None] + share * (two - one)[:, None])
    return start[:, None] + np.concatenate(rows, axis=1)


def _at_most(way: np.ndarray, turn_rad: float) -> np.ndarray:
    """Ways no longer than a turn."""
    return np.clip(way, -turn_rad, turn_rad)
