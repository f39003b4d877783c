"""Any hand as capsules: its fingers' links on given commands, its palm, and its wrist.

The Utah-MIT hand and hands of chains give the same tables; who reads them need not know which hand
it is. All places are in the hand's frame, of the hand that is believed, touching nothing, its
weight apart.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, pi

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, capsule_ends, chain_of_table
from warpgrasp.chain.chain_kernel import CAPSULES
from warpgrasp.finger.path_table import path_table
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, LINK_COUNT, hand_links
from warpgrasp.parameters import HandTable

_STILL = 1e-9
"""Joints are no farther past a stop by rounding [rad]."""
BALLS = 3
"""Along a link at least, its end among them."""
_THICKER = 0.25
"""Of a ball's radius: capsules that are thicker by less are filled by balls on their axes."""
_RING_SPACING = 1.5
"""Between neighbours in a ring, of a ball's radius."""
_SHORTEST_M = 1e-12
_FEELS_BY_TIP, _FEELS_NOTHING = "tip_switches", "nothing"


@dataclass(frozen=True, eq=False)
class HandCapsules:
    """What does not change as fingers move. Links that a finger has not are beyond its `count`."""

    table: HandTable
    chain: ChainHand | None
    """None for the Utah-MIT hand."""
    base: np.ndarray
    """Poses of the fingers' own frames in the hand's, (finger, 7)."""
    count: np.ndarray
    """Of each finger's capsules, from its base on, int (finger,)."""
    radius_m: np.ndarray
    """(finger, link)."""
    outer: np.ndarray
    """Which of them are on the last two links, bool (finger, link)."""
    feels: np.ndarray
    """Where the hand feels a touch, bool (finger, link)."""
    meets: np.ndarray
    """Which links may touch one another, bool (finger, link, finger, link)."""
    meets_palm: np.ndarray
    """Which may touch which bar, bool (finger, link, bar)."""
    bars_m: np.ndarray
    """Ends of the palm's capsules, then of the wrist's, (bar, 2, 3)."""
    bar_radius_m: np.ndarray
    """(bar,)."""
    low_rad: np.ndarray
    """Stops of the joints that are commanded, (finger, width)."""
    high_rad: np.ndarray
    within_m: np.ndarray
    """Places within palm and wrist: balls about them with the radius of the thinnest link reach
    their surface, and hardly farther, (ball, 3)."""

    @property
    def fingers(self) -> int:
        """How many fingers."""
        return len(self.count)

    def places(self, q_rad: np.ndarray) -> np.ndarray:
        """Ends of all links' axes on commands (finger, step, width), as far as stops let joints go:
        (finger, step, link, 2, 3) [m]."""
        q_rad = self._within_stops(q_rad)
        if self.chain is None:
            return _utah_mit_places(self.table, q_rad)
        found = np.zeros((*q_rad.shape[:2], self.radius_m.shape[1], 2, 3))
        for f in range(self.fingers):
            found[f, :, :self.count[f]] = capsule_ends(self.chain, f, q_rad[f])
        return found

    def places_from_base(self, q_rad: np.ndarray) -> np.ndarray:
        """The same in the fingers' own frames, where closings have tables of them."""
        if self.chain is not None:
            return self.places(q_rad)
        links = path_table(self.table, self._within_stops(q_rad)[None])[1][0]
        return np.moveaxis(np.stack([links["start"], links["end"]], 3), 1, 2)

    def _within_stops(self, q_rad: np.ndarray) -> np.ndarray:
        past = q_rad - np.clip(q_rad, self.low_rad[:, None], self.high_rad[:, None])
        past[np.abs(past) < _STILL] = 0.0
        return q_rad - past


def capsules_of_hand(table: HandTable) -> HandCapsules:
    """The capsules of a table's hand, the same record for the same hand. Raises HandError for a
    hand that cannot be used."""
    chain = chain_of_table(table)
    return _utah_mit(table) if chain is None else _chains(chain, table)


def balls_within(
    ends_m: np.ndarray, radius_m: float, ball_m: float, start: bool = False
) -> np.ndarray:
    """Centres of balls of radius `ball_m` that fill the surface of a capsule whose axis ends at
    places (..., 2, 3): (..., ball, 3) [m].

    Along the axis they touch one another at least. A thicker capsule has rings of them just within
    its surface, and one in each cap. Without `start` the axis of a thin one begins beyond its first
    end, where the end of the link before is.
    """
    first, way = ends_m[..., :1, :], ends_m[..., 1:, :] - ends_m[..., :1, :]
    length = float(np.linalg.norm(way, axis=-1).max())
    count = max(1, ceil(length / (2.0 * ball_m)))
    off = radius_m - ball_m
    if off < _THICKER * ball_m:
        count = max(BALLS, count) if length > ball_m else 1
        share = np.arange(0 if start else 1, count + 1)[:, None] / count
        return first + share * way
    axis = first + (np.arange(count) + 0.5)[:, None] / count * way
    u = way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), _SHORTEST_M)
    side = np.cross(u, np.eye(3)[np.abs(u).argmin(-1)])
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    around = max(4, ceil(2 * pi * off / (_RING_SPACING * ball_m)))
    turn = np.linspace(0.0, 2 * pi, around, endpoint=False)[:, None]
    offset = off * (np.cos(turn) * side + np.sin(turn) * np.cross(u, side))
    rings = axis[..., :, None, :] + offset[..., None, :, :]
    caps = ends_m + off * np.concatenate([-u, u], -2)
    return np.concatenate([rings.reshape(*axis.shape[:-2], -1, 3), caps], -2)


@lru_cache(maxsize=16)
def _utah_mit(table: HandTable) -> HandCapsules:
    thick = table.palm_thickness_m / 2
    bars = [((x, -table.finger_spacing_m, -thick), (x, table.finger_spacing_m, -thick))
            for x in (-table.palm_gap_m / 2, 0.0, table.palm_gap_m / 2)]
    bars.append(((0.0, 0.0, -max(table.mount_length_m, thick)), (0.0, 0.0, -thick)))
    links = (FINGER_COUNT, LINK_COUNT)
    beyond = np.broadcast_to(np.arange(LINK_COUNT) > 0, links)
    others = ~np.eye(FINGER_COUNT, dtype=bool)[:, None, :, None]
    palm = np.arange(len(bars)) < len(bars) - 1
    low, high = (np.tile([abduction, *flexion], (FINGER_COUNT, 1)) for abduction, flexion in zip(
        table.abduction_limit_rad, (table.flexion_low_rad, table.flexion_high_rad), strict=True))
    x, y = table.palm_gap_m / 2, table.finger_spacing_m
    base = [(-x, -y, 0, 0, 0, 0, 1), (-x, 0, 0, 0, 0, 0, 1), (-x, y, 0, 0, 0, 0, 1),
            (x, 0, 0, 0, 0, 1, 0)]
    return HandCapsules(
        table=table, chain=None, base=np.array(base, float),
        count=np.full(FINGER_COUNT, LINK_COUNT), radius_m=np.full(links, table.link_radius_m),
        outer=beyond, feels=np.ones(links, bool), meets_palm=beyond[..., None] & palm,
        meets=np.broadcast_to(others, (*links, *links)),
        bars_m=np.array(bars), bar_radius_m=np.full(len(bars), thick), low_rad=low, high_rad=high,
        within_m=_slab_and_wrist(table))


def _slab_and_wrist(table: HandTable) -> np.ndarray:
    """Places within a slab with rounded edges and a cylinder, (ball, 3)."""
    thick, radius = table.palm_thickness_m, table.link_radius_m
    x = np.linspace(-1, 1, 5) * (table.palm_gap_m / 2 + thick / 2 - radius)
    y = np.linspace(-1, 1, 5) * (table.finger_spacing_m + thick / 2 - radius)
    face = np.stack(np.meshgrid(x, y, [-radius, radius - thick]), -1).reshape(-1, 3)
    turn = np.arange(4) * pi / 2
    ring = (thick / 2 - radius) * np.stack([np.cos(turn), np.sin(turn)], -1)
    z = -np.linspace(thick, table.mount_length_m, 4)
    wrist = np.concatenate([np.tile(ring, (len(z), 1)), np.repeat(z, 4)[:, None]], 1)
    return np.concatenate([face, wrist])


def _utah_mit_places(table: HandTable, q_rad: np.ndarray) -> np.ndarray:
    pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (q_rad.shape[1], 1))
    joints = hand_links(table, pose, q_rad.swapaxes(0, 1))[0][:, :, 1:].swapaxes(0, 1)
    return np.stack([joints[:, :, :-1], joints[:, :, 1:]], 3)


@lru_cache(maxsize=16)
def _chains(chain: ChainHand, table: HandTable) -> HandCapsules:
    # Kernels of chains, which the Utah-MIT hand does without.
    from warpgrasp.chain.chain_move import palm_and_wrist
    from warpgrasp.chain_closing.chain_meeting import palm_of

    count = np.array([len(own) for own in chain.capsules])
    most = int(count.max())
    radius, joint = np.zeros((chain.fingers, most)), np.full((chain.fingers, most), -1)
    low, high = (np.zeros((chain.fingers, chain.width)) for _ in range(2))
    outer, feels = (np.zeros((chain.fingers, most), bool) for _ in range(2))
    for f, finger in enumerate(chain.model.fingers):
        radius[f, :count[f]] = [c.radius for c in chain.capsules[f]]
        joint[f, :count[f]] = chain.capsule_joint[f]
        outer[f] = np.isin(joint[f], sorted(set(chain.capsule_joint[f]))[-2:])
        feels[f] = joint[f] >= 0
        if chain.model.senses == _FEELS_BY_TIP:
            feels[f] = joint[f] == len(finger.joints) - 1
        for d, j in enumerate(chain.drives[f]):
            low[f, d], high[f, d] = finger.joints[j].low_rad, finger.joints[j].high_rad
    feels &= chain.model.senses != _FEELS_NOTHING
    bars, bar_radius = palm_and_wrist(chain, table)
    thinnest = min(float(own[:n].min()) for own, n in zip(radius, count, strict=True))
    within = np.concatenate([np.zeros((0, 3)), *(
        balls_within(ends, float(r), thinnest, start=True)
        for ends, r in zip(bars, bar_radius, strict=True))])
    whole = chain.fingers * CAPSULES
    free = ~palm_of(chain)[2].reshape(chain.fingers, CAPSULES, -1)[:, :most]
    meets_palm = np.zeros((chain.fingers, most, len(bars)), bool)
    meets_palm[..., :len(chain.palm)] = free[..., whole:whole + len(chain.palm)]
    base = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (chain.fingers, 1))
    meets = free[..., :whole].reshape(chain.fingers, most, chain.fingers, CAPSULES)[..., :most]
    return HandCapsules(
        table=table, chain=chain, base=base, count=count, radius_m=radius, outer=outer, feels=feels,
        meets=meets, meets_palm=meets_palm, bars_m=bars, bar_radius_m=bar_radius, low_rad=low,
        high_rad=high, within_m=within.reshape(-1, 3))
