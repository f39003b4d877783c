"""What waypoints, closing paths and evidence know of a hand: sizes in the hand's own frame.

z is the approach, x the way from the fingers to the thumb, and the origin the middle of the palm.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import (
    ChainHand,
    capsule_ends,
    chain_of_table,
    closing_way,
    link_frames_of,
    tip_places,
)
from warpgrasp.hands.hand_model import BASE_FIRST
from warpgrasp.parameters import HandTable

_WAY_STEPS = 61


@dataclass(frozen=True, eq=False)
class HandOutline:
    """Sizes of a hand, SI."""

    fingers: int
    drives: int
    """Joint angles of a finger, as arrays have them."""
    links: int
    skin_m: float
    """Radius of its thinnest link."""
    open_m: np.ndarray
    """Places of the open fingers, (place, 3), and the radii about them, (place,): no part of the
    open fingers lies beyond these balls as seen along the approach."""
    open_radius_m: np.ndarray
    centre_m: tuple[float, float]
    """Where fingers that close meet, x and y of the hand's frame."""
    reach_m: float
    """From the palm to the tips of straight fingers, along the approach."""
    half_gap_m: float
    """From there to the fingers' bases, along x."""
    half_side_m: float
    """From there to the side of the outermost finger, along y."""
    open_half_m: float
    """From there to the skin of the nearest open fingertip, along the way that it closes."""
    scale: float
    """Distances of waypoint families are as many times as long: they are given for the default
    hand, and others keep theirs in proportion to their reach."""
    wide: float
    """As many times as wide is what fits between the open fingers, by how far these are apart; no
    less than `scale`: a hand that opens less than its reach says touches wide things from before
    them, and from farther off it would not reach."""


def outline_of(hand: HandTable) -> HandOutline:
    """The outline of a table's hand. Raises HandError for a hand that cannot be used."""
    chain = chain_of_table(hand)
    return _utah_mit(hand) if chain is None else _chains(chain)


@lru_cache(maxsize=16)
def _utah_mit(hand: HandTable) -> HandOutline:
    spread = -hand.flexion_low_rad[0]
    length = sum(hand.link_length_m)
    x = hand.palm_gap_m / 2 + length * np.sin(spread)
    z = hand.abduction_offset_m + length * np.cos(spread)
    tips = np.array([(sx * x, y * hand.finger_spacing_m, z) for sx in (-1, 1) for y in (-1, 1)])
    return HandOutline(
        4, 4, 3, hand.link_radius_m, tips, np.full(len(tips), hand.link_radius_m), (0.0, 0.0),
        hand.abduction_offset_m + length, hand.palm_gap_m / 2,
        1.5 * hand.finger_spacing_m + hand.link_radius_m, x - hand.link_radius_m, 1.0, 1.0)


@lru_cache(maxsize=16)
def _chains(hand: ChainHand) -> HandOutline:
    way = closing_way(hand, hand.model.closings[0], _WAY_STEPS)
    ends = [capsule_ends(hand, f, way[f, 0]) for f in range(hand.fingers)]
    radii = [np.array([c.radius for c in own]) for own in hand.capsules]
    places = np.concatenate([e.reshape(-1, 3) for e in ends])
    radius = np.concatenate([np.repeat(r, 2) for r in radii])
    tips = tip_places(hand, np.moveaxis(way, 0, 1))
    # Straight fingers reach farthest: each at its highest while its base closes alone.
    straight = tip_places(hand, np.moveaxis(chain_commands(hand, BASE_FIRST), 0, 1))
    reach = float(straight[..., 2].max(0).min())
    met, (x, y) = _meeting(hand, tips)
    opened = _open_half(hand, tips[0, :, :2], tips[met, :, :2], np.array([x, y]))
    usual = _utah_mit(HandTable())
    scale = reach / usual.reach_m
    bases = np.array([link_frames_of(hand, f, way[f, 0])[0, :3, 3] for f in range(hand.fingers)])
    return HandOutline(
        hand.fingers, hand.width, hand.links, min(float(r.min()) for r in radii), places, radius,
        (x, y), reach, float(np.abs(bases[:, 0] - x).max()),
        float((np.abs(places[:, 1] - y) + radius).max()), opened, scale,
        max(opened / usual.open_half_m, scale))


def _open_half(
    hand: ChainHand, open_m: np.ndarray, met_m: np.ndarray, centre_m: np.ndarray
) -> float:
    """`open_half_m` by x and y of the tips, open and where they meet, (finger, 2)."""
    way = met_m - open_m
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    skin = [own[-1].radius for own in hand.capsules]
    return float((((centre_m - open_m) * way).sum(1) - skin).min())


def _meeting(hand: ChainHand, tips_m: np.ndarray) -> tuple[int, tuple[float, float]]:
    """The step at which the tips (step, finger, 3) come nearest, the thumb to the middle of the
    others, or, without a thumb, all to their middle; and where: x and y [m]."""
    names = [finger.name for finger in hand.model.fingers]
    if hand.model.thumb in names and len(names) > 1:
        thumb = names.index(hand.model.thumb)
        sides = np.stack([np.delete(tips_m, thumb, axis=1).mean(1), tips_m[:, thumb]], 1)
    else:
        sides = tips_m
    middle = sides.mean(1)
    # Fingers side by side do not meet along y.
    apart = np.linalg.norm((sides - middle[:, None])[..., [0, 2]], axis=-1).sum(1)
    met = int(apart.argmin())
    x, y, _ = middle[met]
    return met, (float(x), float(y))
