"""What a hand can be asked for: a procedure that it cannot do ends the episode and says why."""

import numpy as np

from warpgrasp.chain.chain_hand import chain_of_table
from warpgrasp.parameters import HandTable

STATUS = "not_possible"
"""Of an episode whose strategy asks for what its hand cannot do; its note begins with it too."""
FAILED = "strategy_failed"
NEEDS = {
    "planar": "feels with the pad of one extended finger",
    "contour": "feels with the pads of an opposed pair of fingers",
    "decide": "goes on to procedures that feel with pads",
}


class NotPossible(ValueError):
    """A hand cannot do what it is asked; the message says what and why."""


def check_possible(procedure: str, hand: HandTable) -> None:
    """Raise NotPossible where a hand cannot carry out a procedure: pads are simulated on the
    Utah-MIT hand alone, and so are fingers that are extended."""
    chain = chain_of_table(hand)
    if chain is not None and procedure in NEEDS:
        raise NotPossible(f"{STATUS}: {procedure} {NEEDS[procedure]}, and the hand "
                          f"{chain.model.name} has none in this simulator")


def check_foreseeable(hand: HandTable) -> None:
    """Raise NotPossible for a hand that feels no touches which strategies could foresee."""
    chain = chain_of_table(hand)
    if chain is not None and chain.model.senses == "nothing":
        raise NotPossible(f"{STATUS}: this strategy foresees touches, and the hand "
                          f'{chain.model.name} feels none: its file says senses = "nothing"')


def fault_status(fault: np.ndarray) -> np.ndarray:
    """How episodes ended whose strategies were at fault, by what is said of them, (world,)."""
    return np.where(np.char.startswith(fault.astype(str), STATUS), STATUS, FAILED)
