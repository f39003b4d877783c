"""Status codes and option words of fits. A bad set of points gets a status, not an exception."""

from enum import IntEnum
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool

LEAST_FALL = 1e-12
"""Default tolerance: a fit has converged when a round of iterations lowers its cost by less than
this fraction."""

FAR, LEAST_EXTENT_M = 10.0, 0.05
"""What is touched from so many times its extent (at least) above a table on does not stand on it.
"""


class FitStatus(IntEnum):
    """Outcome of one fit; only `converged` means an optimum, within the tolerance of the fit."""

    converged = 0
    """The cost no longer falls."""
    not_converged = 1
    """The iteration limit was reached first; the parameters are finite and usable."""
    too_few_points = 2
    """Fewer different points than the shape needs; the result is their bounding box."""
    degenerate_point = 3
    """All points coincide."""
    degenerate_line = 4
    """All points lie on a line."""
    degenerate_plane = 5
    """All points lie in a plane, so the thickness of a solid is unknown."""
    bad_points = 6
    """An unmasked point or its evidence is NaN or beyond 1e12 m (of a free form also the mean
    there), a variance is negative, or the table is no height that a body touched there stands on:
    all points lie below it, or far above it (`FAR`)."""


def status_names(status) -> list[str]:
    """Names of status codes, shape [fit], as written to files."""
    return [FitStatus(int(code)).name for code in status]


def is_fitted(status) -> Bool[np.ndarray, " fit"]:
    """Whether each status leaves usable parameters: converged, or out of iterations."""
    return np.isin(status, (FitStatus.converged, FitStatus.not_converged))


Kind = Literal["solina", "solina_box", "radial", "distance", "volume_distance"]
Loss = Literal["none", "pseudo_huber", "cauchy", "geman_mcclure"]
Monotone = Literal["none", "falling", "rising"]


def check_word(name: str, word: str, words: Any) -> None:
    """Raise ValueError, naming the choices, if `word` is not one of the Literal `words`."""
    known = get_args(words)
    if word not in known:
        raise ValueError(f"{name}: {word!r}, should be one of {', '.join(known)}")
