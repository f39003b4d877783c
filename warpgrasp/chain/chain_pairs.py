"""Two fingers of a hand of chains whose tips close towards each other: as its file says, or found.

Where a file says none, both fingers point along the approach and turn towards each other from their
bases, the others lie as flat as they can, and the thumb's partner is the finger that faces it best.
"""

from functools import lru_cache
from math import ceil, radians

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, capsule_ends, link_frames_of
from warpgrasp.chain.chain_pads import own_pads
from warpgrasp.chain.chain_postures import (
    hand_places,
    known_postures,
    pad_axes,
    posture_drives,
    straight_fingers,
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
_NARROW_M = 0.015
"""A pair that opens no wider is none."""
_SAMPLES = 61
_OPEN_RAD, _CLOSED_RAD, _BENT_RAD = radians(35), radians(60), radians(10)
"""From where a finger points along the approach: how far it opens, closes, and is bent beyond its
base."""
_FLEXES, _LITTLE_RAD = 0.8, 1e-4
"""Cosine between a tip's motion and the pad's side from which on a drive flexes."""


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
    thumb = names.index(hand.model.thumb) if hand.model.thumb in names else -1
    able = [f for f in range(hand.fingers) if tip_pads(hand, f)]
    tried = [(f, g) for f in able for g in able if (g == thumb if thumb >= 0 else f < g) and f != g]
    ways = {f: _straight_way(hand, f, pads) for f in {f for pair in tried for f in pair}}
    found = []
    for f, g in tried:
        start, end = _flattest(hand), _flattest(hand)
        for finger in (f, g):
            start[finger], end[finger] = ways[finger]
        pair = _pair(hand, (f, g), start, end, pads)
        if pair is not None and pair.widest_half_m > _NARROW_M:
            off = [pad_axes(hand, n, start[n], pads)[0] @ pair.axes[:, 1] for n in (f, g)]
            found.append((abs(off[0] - off[1]), len(found), pair))
    return min(found)[2] if found else None


def _straight_way(hand: ChainHand, finger: int, pads: PadTable) -> tuple[np.ndarray, np.ndarray]:
    """Drives (width,) of a finger, open and closed, that points along the approach, a little bent,
    and turns in one joint towards the side that its pad lies on."""
    q = max((way[finger] for way in straight_fingers(hand, finger, pads)),
            key=lambda q: float(pad_axes(hand, finger, q, pads)[1][2, 2])).copy()
    width = len(hand.drives[finger])
    tip, axes, _ = pad_axes(hand, finger, q, pads)
    moved = pad_axes(hand, finger, q + _LITTLE_RAD * np.eye(hand.width)[:width], pads)[0] - tip
    along = moved @ axes[:, 0] / np.maximum(np.linalg.norm(moved, axis=1), 1e-12)
    flexing = np.flatnonzero(np.abs(along) > _FLEXES)
    joints = [hand.model.fingers[finger].joints[j] for j in hand.drives[finger]]
    low, high = np.array([(j.low_rad, j.high_rad) for j in joints]).T
    start = q.copy()
    for drive in flexing[1:]:
        start[drive] += np.sign(along[drive]) * _BENT_RAD
    end = start.copy()
    for drive in flexing[:1]:
        start[drive] -= np.sign(along[drive]) * _OPEN_RAD
        end[drive] += np.sign(along[drive]) * _CLOSED_RAD
    for drives in (start, end):
        drives[:width] = np.clip(drives[:width], low, high)
    return start, end


def _flattest(hand: ChainHand) -> np.ndarray:
    """Drives of all fingers, each in that of the hand's postures in which it reaches least along
    the approach, (finger, width)."""
    postures = known_postures(hand)
    found = postures[0].copy()
    for f in range(hand.fingers):
        radii = np.repeat([c.radius for c in hand.capsules[f]], 2)
        reach = [float((capsule_ends(hand, f, q[f]).reshape(-1, 3)[:, 2] + radii).max())
                 for q in postures]
        found[f] = postures[int(np.argmin(reach))][f]
    return found


def _path(finger: int, start: np.ndarray, end: np.ndarray, count: int) -> np.ndarray:
    """A finger's drives from one posture to another, evenly, (count, width)."""
    return start[finger] + np.linspace(0.0, 1.0, count)[:, None] * (end[finger] - start[finger])


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
        rows[f] = _path(f, start, end, steps)
        commands.append(rows)
    places, radii = zip(*hand_places(hand, start), strict=True)
    return OpposedPair(fingers, (commands[0], commands[1]), axes, middle, (balls[0], balls[1]),
                       float(half), halves, at[:, 2] - at[thin, 2], np.concatenate(places),
                       np.concatenate(radii))


def _way(hand: ChainHand, finger: int, start: np.ndarray, end: np.ndarray, pads: PadTable
         ) -> tuple[np.ndarray, np.ndarray, float]:
    """A tip's places as it closes, (sample, 3) [m], the side its open pad lies on, its radius."""
    tip, axes, ball = pad_axes(hand, finger, _path(finger, start, end, _SAMPLES), pads)
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
