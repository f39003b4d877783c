"""How deep the links of a hand lie in one another: by samples of their axes."""

import numpy as np

from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import HandTable

OVERLAP_M = 5e-4
"""Two skins give less than this where links touch."""


def link_overlap(hand: HandTable, hand_pose: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
    """How deep links of fingers are in those of others at most [m], (hand,), negative where apart.

    `hand_pose` (hand, 7), `q_rad` (hand, finger 4, 4).
    """
    points, _ = hand_links(hand, hand_pose, q_rad)
    share = np.linspace(0.0, 1.0, 13)[:, None]
    a, b = points[:, :, 1:-1, None], points[:, :, 2:, None]
    axes = (a + (b - a) * share).reshape(len(points), 4, -1, 3)
    deepest = np.full(len(points), -1.0)
    for one in range(4):
        for two in range(one + 1, 4):
            apart = np.linalg.norm(axes[:, one, :, None] - axes[:, two, None], axis=-1)
            deepest = np.maximum(deepest, 2 * hand.link_radius_m - apart.reshape(
                len(points), -1).min(1))
    return deepest
