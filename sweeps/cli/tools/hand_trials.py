"""Guesses of a hand beside each other: each explores a few bodies, and the best one stays.

No rule about joints says how well a hand feels: a thumb that stands opposite the fingers may bar
the hand from an object that is as wide as the gap. So the guess of the rules is compared with
others, by episodes on a floating wrist: all by the share of the surface that they touch, then the
best few by how near the recovered bodies are. The best of several is so partly by chance, so it and
the first are compared once more on other bodies. Every guess has the same episodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import run_cells
from sweeps.spec.cell import Cell
from sweeps.spec.objects import object_of_argument
from warpgrasp.chain.chain_hand import chain_of
from warpgrasp.chain_closing.chain_path import closing_misfit
from warpgrasp.hands.hand_checks import MOST_MEETING
from warpgrasp.hands.hand_model import HandModel
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.parameters import FLOATING, ArmTable, ContactTable, HandTable

SEQUENCES = ("ring6", "rim6-ring12")
FIRST_BODIES, FIRST_EPISODES = ("block", "wine_bottle", "hammer-1"), 2
"""Of all guesses; and episodes on each."""
LAST_BODIES, LAST_EPISODES = (*FIRST_BODIES, "small_cylinder", "mug-3", "box-1", "bowl-1"), 3
"""Of the best few."""
FEW = 5
BETTER = 0.85
"""A guess may replace the first where its chamfer distance is at most so many times as large [est],
"""
OTHER_BODIES = ("coke_bottle", "funnel", "mug-8", "hammer-6", "box-3", "bowl-2", "wedge")
STILL_BETTER = 0.95
"""and on these, which did not choose it, at most so many times [est]."""


@dataclass(frozen=True)
class Trial:
    """Means of a hand over some bodies and sequences of poses, each of which counts alike."""

    touched: float
    """Share of the surface within 10 mm of a contact."""
    chamfer_mm: float
    """Geometric mean."""


def trial_misfit(hand: HandModel) -> str:
    """Why no guess of a hand can be tried; empty where they can."""
    return closing_misfit(chain_of(hand), HandTable(), _contact(hand))


def _contact(hand: HandModel) -> ContactTable:
    """The default, but fingers that are too many to meet pass through one another."""
    return replace(ContactTable(), self_contact=len(hand.fingers) <= MOST_MEETING)


def best_guess(first: HandModel, others: Sequence[HandModel]) -> tuple[HandModel, Trial, Trial]:
    """The best of some guesses of a hand; its last trial, and that of the first guess."""
    touched = [tried(hand, FIRST_BODIES, FIRST_EPISODES).touched for hand in others]
    few = [first, *(others[k] for k in np.argsort(touched)[::-1][:FEW])]
    last = [tried(hand, LAST_BODIES, LAST_EPISODES) for hand in few]
    best = int(np.argmin([trial.chamfer_mm for trial in last]))
    if not _is_better(last[best], last[0], BETTER):
        return first, last[0], last[0]
    own, other = (tried(hand, OTHER_BODIES, LAST_EPISODES) for hand in (first, few[best]))
    return (few[best], other, own) if _is_better(other, own, STILL_BETTER) else (first, own, own)


def _is_better(one: Trial, other: Trial, times: float) -> bool:
    return one.chamfer_mm <= times * other.chamfer_mm


def tried(hand: HandModel, bodies: Sequence[str], episodes: int) -> Trial:
    """What a hand does in so many episodes of each sequence on each of some bodies."""
    touched, chamfer = [], []
    with TemporaryDirectory() as folder:
        file = Path(folder) / "hand.toml"
        file.write_text(hand_text(hand))
        for name in SEQUENCES:
            cells = [Cell(STRATEGIES[name], object_of_argument(body, None), body,
                          arm=ArmTable(kind=FLOATING), hand=HandTable(kind=str(file)),
                          contact=_contact(hand))
                     for body in bodies]
            for rows in run_cells([(cell, np.arange(episodes)) for cell in cells], "cpu"):
                touched.append(np.nan_to_num(rows["touched10mm"]).mean())
                chamfer.append(np.nan_to_num(rows["chamfer_mm"], nan=np.inf).mean())
    return Trial(float(np.mean(touched)), float(np.exp(np.mean(np.log(chamfer)))))
