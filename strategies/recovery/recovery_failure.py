"""Why no body was recovered, in words: how few contacts there were, or what contradicts the body.
"""

from dataclasses import replace

import numpy as np

from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered, Shape, superquadric_of
from strategies.recovery.contact_verdict import refuted
from strategies.recovery.evidence import CONTRADICTED_FROM
from strategies.recovery.misfit import UNBELIEVED_M, touch_misfit
from strategies.recovery.plausibility import (
    FEWEST_CONTACTS,
    swept,
    why_implausible,
    within_reach,
)


def why_failed(status: np.ndarray, belief: Belief) -> np.ndarray:
    """A sentence for each world whose status says that no body was recovered, else empty, (world,).

    `status` (world,) as in `Exploration`; those of faulty strategies are not explained here.
    """
    why = {"too_few_contacts": _too_few, "fit_failed": _not_fitted, "fit_implausible": _denied}
    return np.array([why[str(word)](belief.of(np.array([world]))) if word in why else ""
                     for world, word in enumerate(status)], object)


def _too_few(belief: Belief) -> str:
    return f"{_contacts(belief)}, {FEWEST_CONTACTS} are needed"


def _not_fitted(belief: Belief) -> str:
    return f"no superquadric could be fitted to {_contacts(belief)}"


def _denied(belief: Belief) -> str:
    """What contradicts the superquadric that was fitted, in the order in which it is judged."""
    fits, placed = belief.fits, belief.evidence
    said = []
    off = float(touch_misfit(fits, placed)[0])
    if not off < UNBELIEVED_M:
        hint = ' (fit.reconstruct = "chosen" tries a free form then)'
        said.append(f"lies {1e3 * off:.1f} mm from its contacts in the mean, "
                    f"{1e3 * UNBELIEVED_M:.0f} or more are not believed"
                    + hint * (belief.fit.reconstruct == "superquadric"))
    if not within_reach(fits, belief.prior)[0]:
        said.append("is far larger than the prior or far from it")
    if not said:
        said = [*why_implausible(fits, belief.prior, table_plane=belief.fit.table_plane),
                *_contradicted(belief)]
    return "the body fitted " + ("; it ".join(said) if said else "is contradicted")


def _contradicted(belief: Belief) -> list[str]:
    """What torques and free space say against it."""
    placed, felt, said = belief.evidence, belief.unplaced, []
    body = superquadric_of(belief.fits)
    if refuted(Recovered(np.array([Shape.SUPERQUADRIC]), body), placed)[0]:
        against = int((placed.mask & (placed.contradiction > CONTRADICTED_FROM)).sum())
        said.append(f"is contradicted by torques at {against} of {_contacts(belief)}")
    if belief.fit.free_space and felt is not None and swept(belief.fits, replace(
            placed, free_m=felt.free_m, free_mask=felt.free_mask))[0]:
        said.append("is where links passed that met nothing")
    return said


def _contacts(belief: Belief) -> str:
    count = int(belief.evidence.mask.sum())
    return "1 contact" if count == 1 else f"{count} contacts"
