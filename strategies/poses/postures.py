"""How a table's hand touches with one finger or two, and where its hand then stands.

To touch a surface one finger is extended, and the hand leans so that the fingertip's pad, bent over
the tip, faces the surface while the rest of the hand stays clear of it.
"""

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.chain.chain_hand import ChainHand, chain_of_table
from warpgrasp.chain.chain_pairs import chain_opposed
from warpgrasp.chain.chain_postures import chain_extended
from warpgrasp.mechanism.touch_postures import (
    ExtendedFinger,
    OpposedPair,
    utah_mit_extended,
    utah_mit_opposed,
)
from warpgrasp.parameters import HandTable, PadTable


def extended_finger(hand: HandTable, pads: PadTable) -> ExtendedFinger | None:
    """The hand with one finger extended; None where no finger's tip bears a pad. Raises HandError
    for a hand that cannot be used."""
    return _extended(hand, pads, chain_of_table(hand))


@lru_cache(maxsize=16)
def _extended(hand: HandTable, pads: PadTable, chain: ChainHand | None) -> ExtendedFinger | None:
    """As `extended_finger`; `chain` is the table's, whose file may have changed."""
    if chain is not None:
        return chain_extended(chain, pads)
    return utah_mit_extended(hand, pads) if pads.distal else None


def opposed_pair(hand: HandTable, pads: PadTable) -> OpposedPair | None:
    """Two of its fingers that close towards each other; None where no two with pads do."""
    return _opposed(hand, pads, chain_of_table(hand))


@lru_cache(maxsize=16)
def _opposed(hand: HandTable, pads: PadTable, chain: ChainHand | None) -> OpposedPair | None:
    """As `opposed_pair`; `chain` is the table's."""
    if chain is not None:
        return chain_opposed(chain, pads)
    return utah_mit_opposed(hand, pads) if pads.distal else None


def poking_pose(
    one: ExtendedFinger, touch_m: np.ndarray, inward: np.ndarray, lean: np.ndarray
) -> np.ndarray:
    """Hand poses whose extended finger's pad touches `touch_m` while probing along `inward`.

    `touch_m`, unit `inward` and `lean` have shape (..., 3); the finger points along `inward` turned
    towards `lean` (its part across `inward`). Returns (..., 7), position [m], quaternion xyzw.
    """
    touch_m, inward, lean = np.broadcast_arrays(touch_m, inward, lean)
    side = lean - (lean * inward).sum(-1, keepdims=True) * inward
    side = side / np.linalg.norm(side, axis=-1, keepdims=True)
    c, s = np.cos(one.lean_rad), np.sin(one.lean_rad)
    x, z = c * inward - s * side, s * inward + c * side
    stands = np.stack([x, np.cross(z, x), z], -1).reshape(-1, 3, 3)
    turn = Rotation.from_matrix((stands[:, :, None] * one.axes).sum(-1))
    tip = turn.apply(one.tip_m).reshape(touch_m.shape)
    quaternion = turn.as_quat().reshape(*touch_m.shape[:-1], 4)
    return np.concatenate([touch_m - one.ball_m * inward - tip, quaternion], -1)
