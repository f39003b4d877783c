"""How a hand of chains touches with one finger, and with two: as its file says, or computed.

An extended finger points, straight, as nearly along the approach as its joints let it, and the
others stand behind its tip, compact, in one of their postures. The hand leans so far towards where
the finger points that the tip leads the rest by most, the pad still bent that far.
"""

from collections.abc import Iterator
from functools import lru_cache
from math import radians

import numpy as np

from warpgrasp.chain.chain_hand import (
    ChainHand,
    capsule_ends,
    closing_way,
    drive_angles,
    link_frames_of,
)
from warpgrasp.chain.chain_pads import own_pads, pad_places
from warpgrasp.hands.hand_frames import posture_angles
from warpgrasp.hands.hand_model import Posture
from warpgrasp.mechanism.touch_postures import ExtendedFinger
from warpgrasp.parameters import PadTable

_EDGE_RAD = radians(20)
"""The pad bends so much farther over the tip than the hand leans."""
_LEANS = 46
_FOLDED = 0.98
"""Share of the way to a joint's limit: off its stop."""
_ROOM_M = 0.02
"""By so much a tip leads enough."""
_TURNS_RAD = radians(2)
"""Of a base joint, from one angle tried to the next."""


@lru_cache(maxsize=16)
def chain_extended(hand: ChainHand, pads: PadTable) -> ExtendedFinger | None:
    """The hand with one finger extended; None without a pad on the end of a finger. `pads` are a
    spec's. Raises HandError for pads that do not fit."""
    pads = own_pads(hand, pads)
    said = hand.model.extended
    if said is not None:
        names = [finger.name for finger in hand.model.fingers]
        return _extended(hand, names.index(said.finger), posture_drives(hand, said.posture), pads,
                         said.lean_rad)[1]
    able = [f for f in range(hand.fingers) if tip_pads(hand, f)
            and hand.model.fingers[f].name != hand.model.thumb]
    tried = [_extended(hand, f, q, pads, None)
             for f in able for q in straight_fingers(hand, f, pads)]
    return max(tried, key=_merit)[1] if tried else None


def _merit(tried: tuple[float, ExtendedFinger]) -> float:
    """Enough room before all else; then the flange behind the finger, that the arm reaches."""
    leads, one = tried
    return min(leads, _ROOM_M) / _ROOM_M + float(one.axes[2, 2])


def tip_pads(hand: ChainHand, finger: int) -> bool:
    """Whether the last link of a finger bears a pad."""
    return hand.model.fingers[finger].joints[-1].name in hand.model.fingers[finger].pads


def posture_drives(hand: ChainHand, name: str) -> np.ndarray:
    """Drives of all fingers in a posture of the hand's, (finger, width)."""
    return drive_angles(hand, posture_angles(hand.model, hand.model.posture(name)))


def pad_axes(hand: ChainHand, finger: int, q_rad: np.ndarray, pads: PadTable
             ) -> tuple[np.ndarray, np.ndarray, float]:
    """What the pad at a finger's tip bends about, (..., 3) [m], its columns (side it lies on, the
    third, along the finger), (..., 3, 3), hand frame, and the radius of its face [m]; of drives
    (..., width). `pads` are the hand's own."""
    place = pad_places(hand, finger, pads)[-1]
    frame = link_frames_of(hand, finger, q_rad)[..., -1, :, :]
    turn = frame[..., :3, :3]
    along = np.subtract(place.end, place.start)
    along = along / np.linalg.norm(along)
    out = np.array(place.out)
    axes = turn @ np.stack([out, np.cross(along, out), along], 1)
    return turn @ np.array(place.end) + frame[..., :3, 3], axes, place.radius + pads.thickness_m


def _extended(
    hand: ChainHand, finger: int, q: np.ndarray, pads: PadTable, lean: float | None
) -> tuple[float, ExtendedFinger]:
    """By how much the tip leads all else [m], and how it touches."""
    tip, axes, ball = pad_axes(hand, finger, q[finger], pads)
    leans = np.linspace(0.0, max(pads.wrap_rad - _EDGE_RAD, 0.0), _LEANS)
    leans = leans if lean is None else np.array([lean])
    ways = np.cos(leans)[:, None] * axes[:, 0] + np.sin(leans)[:, None] * axes[:, 2]
    leads = ways @ tip + ball - np.max([_farthest(*part, ways)
                                        for part in hand_places(hand, q, finger)], axis=0)
    best = int(leads.argmax())
    return float(leads[best]), ExtendedFinger(finger, q[:, None], axes, tip, ball,
                                              float(leans[best]))


def hand_places(hand: ChainHand, q: np.ndarray, finger: int = -1
                ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Ends (place, 3) [m] and radii (place,) of all capsules at drives (finger, width), hand frame,
    finger by finger, then the palm's; without those of the last link of `finger`."""
    for f in range(hand.fingers):
        keep = [n for n, joint in enumerate(hand.capsule_joint[f])
                if f != finger or joint < len(hand.model.fingers[f].joints) - 1]
        if keep:
            ends = capsule_ends(hand, f, q[f])[keep].reshape(-1, 3)
            yield ends, np.repeat([hand.capsules[f][n].radius for n in keep], 2)
    if hand.palm:
        yield (np.array([(c.start, c.end) for c in hand.palm]).reshape(-1, 3),
               np.repeat([c.radius for c in hand.palm], 2))


def _farthest(places: np.ndarray, radii: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """How far balls reach along each way [m]."""
    return (ways @ places.T + radii).max(1)


def straight_fingers(hand: ChainHand, finger: int, pads: PadTable) -> Iterator[np.ndarray]:
    """Drives of hands (finger, width) with a straight finger that points along the approach."""
    others = known_postures(hand)
    zero = others[0]
    joints = hand.model.fingers[finger].joints
    for drive, joint in enumerate(hand.drives[finger][:2]):
        low, high = joints[joint].low_rad, joints[joint].high_rad
        turns = np.linspace(low, high, 2 + int((high - low) / _TURNS_RAD))
        q = np.tile(zero[finger], (len(turns), 1))
        q[:, drive] = turns
        _, axes, _ = pad_axes(hand, finger, q, pads)
        best = q[axes[:, 2, 2].argmax()]
        found = _behind(hand, finger, best, others, pads)
        found[finger] = best
        yield found


def known_postures(hand: ChainHand) -> list[np.ndarray]:
    """Drives of all fingers (finger, width): straight, in each posture of the file, folded."""
    zero = drive_angles(hand, posture_angles(hand.model, Posture("", ())))
    return [zero, *(posture_drives(hand, p.name) for p in hand.model.postures), _folded(hand)]


def _folded(hand: ChainHand) -> np.ndarray:
    """Drives of all fingers as far closed as their joints let them, (finger, width)."""
    way = closing_way(hand, hand.model.closings[0], 2)
    found = way[:, 0].copy()
    for f, finger in enumerate(hand.model.fingers):
        for d, joint in enumerate(hand.drives[f]):
            turn = way[f, 1, d] - way[f, 0, d]
            if turn:
                found[f, d] = _FOLDED * (finger.joints[joint].high_rad if turn > 0.0
                                         else finger.joints[joint].low_rad)
    return found


def _behind(
    hand: ChainHand, finger: int, q: np.ndarray, others: list[np.ndarray], pads: PadTable
) -> np.ndarray:
    """Each of the other fingers in the posture, of those well behind the tip, that reaches least to
    where the pad does not lie: there the table is where a finger points down at a face."""
    tip, axes, ball = pad_axes(hand, finger, q, pads)
    ways = np.stack([(axes[:, 0] + axes[:, 2]) / np.sqrt(2.0), -axes[:, 0]])
    found = others[0].copy()
    for f in range(hand.fingers):
        radii = np.repeat([c.radius for c in hand.capsules[f]], 2)
        ahead, back = np.array([_farthest(capsule_ends(hand, f, one[f]).reshape(-1, 3), radii, ways)
                                for one in others]).T
        short = np.maximum(ahead - (tip @ ways[0] + ball - _ROOM_M), 0.0)
        found[f] = others[int(np.lexsort((back, short))[0])][f]
    return found
