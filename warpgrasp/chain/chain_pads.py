"""Tactile pads on a hand of chains: how large they are, and where they lie.

A pad lies on the capsules of its link, in their middle, on the side that the link closes towards;
where there are several side by side it bridges the grooves between them. A hand's file may place
it otherwise.
"""

from dataclasses import replace
from functools import lru_cache
from math import cos, pi, sin

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, chain_of, palmar_sides
from warpgrasp.hands.hand_model import (
    Capsule,
    HandError,
    HandModel,
    PadPlace,
    PadSize,
    vector_of,
)
from warpgrasp.parameters import PadTable
from warpgrasp.spec_words import reckoned
from warpgrasp.table_misfit import pad_width_misfit

_PARALLEL = 0.95
"""Cosine between a link's longest capsule and others that bear its pad with it."""
_ACROSS = 9
"""Places across a pad at which it is to stand off the skin."""
_FINER_M = 1e-4
_WIDEST = 0.95
"""Of half the way around the thinnest link: the most that a pad's width is guessed to be."""
_STRAIGHT = 0.2, 0.9
"""Of a link's length, what a pad goes along at least and at most beyond what is bent over the
fingertip, where its size is a guess."""
_BALL_M = 2e-6
"""A link's capsule that is no longer is a ball."""


def own_pads(hand: ChainHand, table: PadTable) -> PadTable:
    """A spec's pads, of the hand's own size where its file says one."""
    size = hand.model.pad_size
    if size is None:
        return table
    return reckoned(table, width_m=size.width_m, length_m=size.length_m, wrap_rad=size.wrap_rad,
                    thickness_m=size.thickness_m)


def pad_misfit(hand: ChainHand, table: PadTable) -> str:
    """Why a spec's pads do not fit the hand; empty where they do."""
    try:
        for finger in range(hand.fingers):
            pad_places(hand, finger, own_pads(hand, table))
    except HandError as error:
        return str(error)
    return ""


@lru_cache(maxsize=64)
def pad_places(hand: ChainHand, finger: int, pads: PadTable) -> tuple[PadPlace, ...]:
    """Where a finger's pads lie, outwards. Raises HandError for one that does not fit its link;
    `pads` are the hand's own."""
    model = hand.model.fingers[finger]
    names = [joint.name for joint in model.joints]
    said = {place.joint: place for place in model.pad_places}
    found = []
    for name in sorted(model.pads, key=names.index):
        place = said.get(name) or _on_capsules(hand, finger, names.index(name), pads)
        bent, length = _room(place, name == names[-1], pads)
        if not 0.0 <= pads.length_m - bent <= length:
            what = f"of {length * 1e3:.3g} mm" if length > _BALL_M else "that is a ball"
            fits = f"{bent * 1e3:.3g} to {(bent + length) * 1e3:.3g}"
            if length <= _BALL_M:  # what is bent over it is all of the pad
                fits = f"{(bent + length / 2) * 1e3:.7g}, or the finger without this pad"
            raise HandError(
                f"{hand.model.name}: finger {model.name}: pad of {pads.length_m * 1e3:g} mm does "
                f"not fit link {name} {what}; [pads] length_mm of "
                f"{'a spec' if hand.model.pad_size is None else 'the file of the hand'} should be "
                f"{fits}")
        if wrong := pad_width_misfit(pads.width_m, place.radius + pads.thickness_m):
            raise HandError(f"{hand.model.name}: finger {model.name}, link {name}: {wrong}")
        found.append(place)
    return tuple(found)


def fitted_pads(model: HandModel) -> tuple[HandModel, tuple[str, ...]]:
    """A hand whose file says no size of its pads, with one that fits most of its fingers and is
    nearest to a spec's defaults, and what was changed, a sentence each. Fingers that it does not
    fit bear no pad."""
    hand, usual = chain_of(model), PadTable()
    least = min((c.radius for own in hand.capsules for c in own), default=np.inf)
    width = min(usual.width_m, _WIDEST * pi * (least + usual.thickness_m))
    table = replace(usual, width_m=width)
    fits: dict[int, list[tuple[float, float]]] = {}
    for n, finger in enumerate(model.fingers):
        names = [joint.name for joint in finger.joints]
        try:
            rooms = [_room(_on_capsules(hand, n, names.index(name), table), name == names[-1],
                           table) for name in finger.pads]
        except HandError:
            continue
        fits[n] = [(bent, bent + length) for bent, length in rooms]
    tried = [usual.length_m, *(
        float(np.clip(usual.length_m, low + _STRAIGHT[0] * (high - low),
                      low + _STRAIGHT[1] * (high - low)))
        for own in fits.values() for low, high in own)]
    length = max(tried, key=lambda tried_m: (
        sum(_holds(own, tried_m) for own in fits.values()), -abs(tried_m - usual.length_m)))
    bare = [n for n, finger in enumerate(model.fingers)
            if finger.pads and not _holds(fits.get(n, [(np.inf, 0.0)]), length)]
    notes = [f"finger {model.fingers[n].name} bears no pad, as its links have no room for one of "
             f"{length * 1e3:.1f} mm" for n in bare]
    fingers = tuple(replace(finger, pads=()) if n in bare else finger
                    for n, finger in enumerate(model.fingers))
    if length == usual.length_m and width == usual.width_m:
        return replace(model, fingers=fingers), tuple(notes)
    notes.append(f"pads are {width * 1e3:.1f} x {length * 1e3:.1f} mm, for which links have room")
    size = PadSize(width, length, usual.wrap_rad, usual.thickness_m)
    return replace(model, fingers=fingers, pad_size=size), tuple(notes)


def _holds(rooms: list[tuple[float, float]], length_m: float) -> bool:
    return all(low <= length_m <= high for low, high in rooms)


def _room(place: PadPlace, outermost: bool, pads: PadTable) -> tuple[float, float]:
    """How much of a pad is bent over the fingertip, and how much more may lie along its link [m].
    """
    bent = pads.wrap_rad * (place.radius + pads.thickness_m) if outermost else 0.0
    return bent, float(np.linalg.norm(np.subtract(place.end, place.start)))


def _on_capsules(hand: ChainHand, finger: int, joint: int, pads: PadTable) -> PadPlace:
    name = hand.model.fingers[finger].joints[joint].name
    mine = [n for n, j in enumerate(hand.capsule_joint[finger]) if j == joint]
    if not mine:
        raise HandError(f"{hand.model.name}: a pad on {name}, a link without shapes; should have "
                        "one")
    capsules = [hand.capsules[finger][n] for n in mine]
    ways = np.array([np.subtract(c.end, c.start) for c in capsules])
    size = np.linalg.norm(ways, axis=1)
    longest = int(size.argmax())
    along = ways[longest] / size[longest]
    beside = [n for n, way in enumerate(ways) if way @ along >= _PARALLEL * size[longest]]
    start = np.mean([capsules[n].start for n in beside], axis=0)
    end = np.mean([capsules[n].end for n in beside], axis=0)
    along = (end - start) / np.linalg.norm(end - start)
    out = palmar_sides(hand)[finger][mine[longest]]
    out = out - (out @ along) * along
    out = out / np.linalg.norm(out)
    radius = _radius(capsules, (start + end) / 2, out, np.cross(out, along), pads)
    return PadPlace(name, vector_of(start), vector_of(end), radius, vector_of(out))


def _radius(
    capsules: list[Capsule], middle: np.ndarray, out: np.ndarray, side: np.ndarray, pads: PadTable
) -> float:
    """The least radius of a pad's back at which its face stands off the skin by its thickness."""
    axes = [(c.radius, *(np.mean([c.start, c.end], axis=0) - middle) @ np.stack([side, out], 1))
            for c in capsules]
    radius = max(c.radius for c in capsules)
    while True:
        face = radius + pads.thickness_m
        turns = np.linspace(-0.5, 0.5, _ACROSS) * pads.width_m / face
        clear = min(np.hypot(face * sin(a) - x, face * cos(a) - z) - r
                    for a in turns for r, x, z in axes)
        if clear >= pads.thickness_m - 1e-9:
            return radius
        radius += _FINER_M
