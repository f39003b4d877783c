"""Where the fingers of a hand that closes on nothing meet one another and the palm.

Where a thumb stands opposite a finger, both meet half way on most closing paths, and other fingers
end at the palm. What lies beyond, a finger reaches only if the other one was stopped by the object
before.
"""

import numpy as np

from warpgrasp.hand_capsules import HandCapsules

PLACES = 9
"""Along a link, its ends among them."""
NONE = -1


def hand_meetings(hand: HandCapsules, ends_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The place at which each finger first touches another or the palm, as many as there are where
    it never does, and the finger it touches there, `NONE` for the palm: int (finger,) each.

    `ends_m` (finger, place, link, 2, 3): axes of links of fingers that close side by side, hand
    frame. A finger that meets another stays where it is, and so does the other.
    """
    fingers, count = ends_m.shape[:2]
    share = np.linspace(0.0, 1.0, PLACES)[:, None]
    axes = ends_m[..., :1, :] + share * (ends_m[..., 1:, :] - ends_m[..., :1, :])
    palm = _at_palm(hand, axes)
    thick = hand.radius_m.reshape(-1)
    thick = thick[:, None] + thick
    links = len(thick)
    met, meets = np.full(fingers, count), np.full(fingers, NONE)
    for place in range(count):
        here = np.stack([axes[f, min(place, met[f])] for f in range(fingers)]).reshape(-1, 3)
        apart = _apart(here, here).reshape(links, PLACES, links, PLACES).min((1, 3))
        near = (apart < thick).reshape(hand.meets.shape) & hand.meets
        touching = near.any((1, 3))
        for finger in np.flatnonzero(met > place):
            others = np.flatnonzero(touching[finger])
            if len(others):
                met[finger], meets[finger] = place, others[0]
            elif palm[finger, place]:
                met[finger] = place
    return met, meets


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Distances of points (n, 3) and (m, 3), (n, m)."""
    return np.linalg.norm(one[:, None] - other[None], axis=-1)


def _at_palm(hand: HandCapsules, axes_m: np.ndarray) -> np.ndarray:
    """Whether a finger touches the palm, bool (finger, place of the path), by places on the axes
    of its links (finger, place of the path, link, place, 3)."""
    found = np.zeros(axes_m.shape[:2], bool)
    for bar, (ends, radius) in enumerate(zip(hand.bars_m, hand.bar_radius_m, strict=True)):
        if hand.meets_palm[..., bar].any():
            way = ends[1] - ends[0]
            share = np.clip((axes_m - ends[0]) @ way / (way @ way), 0.0, 1.0)
            gap = np.linalg.norm(axes_m - ends[0] - share[..., None] * way, axis=-1).min(-1)
            touch = gap - radius <= hand.radius_m[:, None]
            found |= (touch & hand.meets_palm[:, None, :, bar]).any(-1)
    return found
