"""Two fingers of a hand of chains whose tips close towards each other: as its file says, or found.

Where a file says none, each finger goes the hand's first closing path alone, the others folded, and
the thumb's partner is the finger whose pad comes to face the thumb's from nearest by.
"""

from functools import lru_cache
from math import ceil

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, closing_way, link_frames_of
from warpgrasp.chain.chain_pads import own_pads
from warpgrasp.chain.chain_postures import (
    folded_drives,
    hand_places,
    pad_axes,
    posture_drives,
    tip_pads,
)
from warpgrasp.mechanism.touch_postures import OpposedPair
from warpgrasp.parameters import PadTable

_STEP_M = 1e-3
"""A tip goes from one command to the next."""
_FACING = 0.3
"""Cosine between a pad's side and the way to the other tip, least."""
_ROOM_M = 0.008
"""Between the open fingertips and the widest chord that they stand astride."""
_THIN_M = 0.025
"""Half the chord at which the tips are to be as deep as the place aimed at."""
_SAMPLES = 61


@lru_cache(maxsize=16)
def chain_opposed(hand: ChainHand, pads: PadTable) -> OpposedPair | None:
    """The pair; None where no two fingers with pads on their tips face each other. `pads` are a
    spec's. Raises HandError for pads that do not fit."""
    pads = own_pads(hand, pads)
    names = [finger.name for finger in hand.model.fingers]
    said = hand.model.opposed
    if said is not None:
        one, other = (names.index(name) for name in said.fingers)
        return _pair(hand, (one, other), posture_drives(hand, said.start),
                     posture_drives(hand, said.end), pads)
    if hand.model.thumb not in names or not tip_pads(hand, names.index(hand.model.thumb)):
        return None
    thumb = names.index(hand.model.thumb)
    start, end = np.moveaxis(closing_way(hand, hand.model.closings[0], 2), 1, 0)
    able = [f for f in range(hand.fingers) if f != thumb and tip_pads(hand, f)]
    found = [(_apart(hand, (f, thumb), start, end, pads), f) for f in able]
    for _, f in sorted(found):
        kept = folded_drives(hand)
        kept[[f, thumb]] = start[[f, thumb]]
        pair = _pair(hand, (f, thumb), kept, end, pads)
        if pair is not None:
            return pair
    return None


def _path(hand: ChainHand, finger: int, start: np.ndarray, end: np.ndarray, count: int
          ) -> np.ndarray:
    """A finger's drives from one posture to another, evenly, (count, width)."""
    return start[finger] + np.linspace(0.0, 1.0, count)[:, None] * (end[finger] - start[finger])


def _apart(hand: ChainHand, fingers: tuple[int, int], start: np.ndarray, end: np.ndarray,
           pads: PadTable) -> float:
    """The least distance of two tips, each anywhere on its way [m]."""
    one, other = (pad_axes(hand, f, _path(hand, f, start, end, _SAMPLES), pads)[0]
                  for f in fingers)
    return float(np.linalg.norm(one[:, None] - other, axis=-1).min())


def _pair(hand: ChainHand, fingers: tuple[int, int], start: np.ndarray, end: np.ndarray,
          pads: PadTable) -> OpposedPair | None:
    """The pair with its frame; None where its pads do not face each other."""
    fingers = _lowest_last(hand, fingers, start, pads)
    tips, sides, balls = zip(*(_way(hand, f, start, end, pads) for f in fingers), strict=True)
    across = tips[1][0] - tips[0][0]
    across[2] = 0.0
    across /= np.linalg.norm(across)
    if sides[0] @ across < _FACING or sides[1] @ across > -_FACING:
        return None
    approach = np.array([0.0, 0.0, 1.0])
    axes = np.stack([across, np.cross(approach, across), approach], 1)
    one, other = (tip @ axes for tip in tips)
    # Both are to come past the middle, as far as they close.
    x = float(np.clip((one[0, 0] + other[0, 0]) / 2, other[:, 0].min() - balls[1],
                      one[:, 0].max() + balls[0]))
    half = min(x - one[0, 0] - balls[0], other[0, 0] - x - balls[1]) - _ROOM_M
    halves = np.linspace(0.0, max(half, _THIN_M), _SAMPLES)
    at = np.mean([way[np.abs(np.abs(way[:, 0] - x) - halves[:, None] - ball).argmin(1)]
                  for way, ball in zip((one, other), balls, strict=True)], axis=0)
    thin = int(np.abs(halves - _THIN_M).argmin())
    middle = axes @ [x, at[thin, 1], at[thin, 2]]
    commands = []
    for f, tip in zip(fingers, tips, strict=True):
        steps = 1 + ceil(np.linalg.norm(np.diff(tip, axis=0), axis=1).sum() / _STEP_M)
        rows = np.repeat(start[:, None], steps, axis=1)
        rows[f] = _path(hand, f, start, end, steps)
        commands.append(rows)
    places, radii = zip(*hand_places(hand, start), strict=True)
    return OpposedPair(fingers, (commands[0], commands[1]), axes, middle, (balls[0], balls[1]),
                       float(half), halves, at[:, 2] - at[thin, 2], np.concatenate(places),
                       np.concatenate(radii))


def _way(hand: ChainHand, finger: int, start: np.ndarray, end: np.ndarray, pads: PadTable
         ) -> tuple[np.ndarray, np.ndarray, float]:
    """A tip's places as it closes, (sample, 3) [m], the side its open pad lies on, its radius."""
    tip, axes, ball = pad_axes(hand, finger, _path(hand, finger, start, end, _SAMPLES), pads)
    return tip, axes[0, :, 0], ball


def _lowest_last(hand: ChainHand, fingers: tuple[int, int], start: np.ndarray, pads: PadTable
                 ) -> tuple[int, int]:
    """The pair in the order in which the rest of the hand is above it, where the hand stands with
    the way from the first to the second level and its approach towards an upright axis."""
    rest = [f for f in range(hand.fingers) if f not in fingers]
    if not rest:
        return fingers
    one, other = (pad_axes(hand, f, start[f], pads)[0] for f in fingers)
    up = np.cross([0.0, 0.0, 1.0], other - one)
    bases = np.mean([link_frames_of(hand, f, start[f])[0, :3, 3] for f in rest], axis=0)
    return fingers if (bases - (one + other) / 2) @ up >= 0.0 else (fingers[1], fingers[0])
