"""What a hand can be asked for: a procedure that it cannot do ends the episode and says why."""

from math import degrees

import numpy as np

from strategies.poses.postures import extended_finger, opposed_pair
from warpgrasp.chain.chain_hand import chain_of_table
from warpgrasp.mechanism.touch_postures import (
    ExtendedFinger,
    OpposedPair,
    index_abduction_rad,
)
from warpgrasp.parameters import UTAH_MIT, HandTable, PadTable

STATUS = "not_possible"
"""Of an episode whose strategy asks for what its hand cannot do; its note begins with it too."""
FAILED = "strategy_failed"


class NotPossible(ValueError):
    """A hand cannot do what it is asked; the message says what and why."""


def extended_of(hand: HandTable, pads: PadTable) -> ExtendedFinger:
    """The hand with one finger extended. Raises NotPossible for a hand that has none to touch with.
    """
    found = extended_finger(hand, pads)
    if found is None:
        raise NotPossible(f"{STATUS}: planar feels with the pad of one extended finger, and no "
                          f"finger of the hand {_name(hand)} has a pad on its last link")
    return found


def opposed_of(hand: HandTable, pads: PadTable) -> OpposedPair:
    """Two fingers that close towards each other. Raises NotPossible for a hand that has none."""
    found = opposed_pair(hand, pads)
    if found is None:
        why = "no opposed pair with pads on their last links"
        if hand.kind == UTAH_MIT and pads.distal:
            turn, most = degrees(index_abduction_rad(hand)), degrees(hand.abduction_limit_rad[1])
            why = (f"none: with finger_spacing_mm = {1e3 * hand.finger_spacing_m:g} its index "
                   f"finger faces the thumb at an abduction of {turn:.1f} deg, and can turn by "
                   f"{most:g} (abduction_limit_deg)")
        raise NotPossible(f"{STATUS}: contour feels with the pads of an opposed pair of fingers, "
                          f"and the hand {_name(hand)} has {why}")
    return found


def check_possible(procedure: str, hand: HandTable, pads: PadTable) -> None:
    """Raise NotPossible where a hand cannot carry out a procedure that feels with pads. `decide`
    goes on to either of them."""
    if procedure in ("planar", "decide"):
        extended_of(hand, pads)
    if procedure in ("contour", "decide"):
        opposed_of(hand, pads)


def _name(hand: HandTable) -> str:
    chain = chain_of_table(hand)
    return hand.kind if chain is None else chain.model.name


def check_foreseeable(hand: HandTable) -> None:
    """Raise NotPossible for a hand that feels no touches which strategies could foresee."""
    chain = chain_of_table(hand)
    if chain is not None and chain.model.senses == "nothing":
        raise NotPossible(f"{STATUS}: this strategy foresees touches, and the hand "
                          f'{chain.model.name} feels none: its file says senses = "nothing"')


def fault_status(fault: np.ndarray) -> np.ndarray:
    """How episodes ended whose strategies were at fault, by what is said of them, (world,)."""
    return np.where(np.char.startswith(fault.astype(str), STATUS), STATUS, FAILED)
