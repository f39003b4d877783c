"""Where the fingers of a hand that closes on nothing meet one another and the palm.

The thumb of the Utah-MIT hand stands opposite the middle finger: on most closing paths they meet
half way, and the outer fingers end at the palm. What lies beyond, a finger reaches only if the
other one was stopped by the object before.
"""

import numpy as np

from warpgrasp.parameters import HandTable

PLACES = 9
"""Along a link, its ends among them."""
NONE = -1


def hand_meetings(hand: HandTable, joints_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The place at which each finger first touches another or the palm, as many as there are where
    it never does, and the finger it touches there, `NONE` for the palm: int (finger 4,) each.

    `joints_m` (finger 4, place, 4, 3): flexion joints and tips of fingers that close side by side,
    hand frame. A finger that meets another stays where it is, and so does the other.
    """
    count = joints_m.shape[1]
    skins = _along(joints_m)
    palm = _palm_gap(hand, skins[:, :, PLACES:]) <= 0.0
    met, meets = np.full(4, count), np.full(4, NONE)
    for place in range(count):
        here = np.stack([skins[f, min(place, met[f])] for f in range(4)])
        apart = np.linalg.norm(here[:, None, :, None] - here[None, :, None], axis=-1).min((2, 3))
        touching = apart < 2.0 * hand.link_radius_m
        np.fill_diagonal(touching, False)
        for finger in np.flatnonzero(met > place):
            others = np.flatnonzero(touching[finger])
            if len(others):
                met[finger], meets[finger] = place, others[0]
            elif palm[finger, place]:
                met[finger] = place
    return met, meets


def _along(joints_m: np.ndarray) -> np.ndarray:
    """Places along the links' axes, (finger, place of the path, link x place, 3)."""
    share = np.linspace(0.0, 1.0, PLACES)[:, None]
    start, end = joints_m[:, :, :-1, None], joints_m[:, :, 1:, None]
    return (start + share * (end - start)).reshape(*joints_m.shape[:2], -1, 3)


def _palm_gap(hand: HandTable, axis_m: np.ndarray) -> np.ndarray:
    """Distance between a finger's skin and the palm's three bars, by places (..., place, 3) on the
    axes of its outer links (...,)."""
    thick = hand.palm_thickness_m / 2
    y = np.maximum(np.abs(axis_m[..., 1]) - hand.finger_spacing_m, 0.0)
    beside = np.stack([np.abs(axis_m[..., 0] - x) for x in
                       (-hand.palm_gap_m / 2, 0.0, hand.palm_gap_m / 2)]).min(0)
    apart = np.sqrt(y**2 + beside**2 + (axis_m[..., 2] + thick) ** 2).min(-1)
    return apart - thick - hand.link_radius_m
