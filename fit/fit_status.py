"""What became of one fit: a status instead of an exception, so one bad set never stops a batch."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Literal, get_args

LEAST_FALL = 1e-12
"""A fit has converged when a round of iterations lowers its cost by less than this share, if not
told otherwise."""


class FitStatus(IntEnum):
    """Outcome of one fit. `converged` is the only one whose parameters are an optimum, as near as
    `LEAST_FALL`, or the share given in its place, says."""

    converged = 0
    """The cost no longer falls."""
    not_converged = 1
    """The iterations were spent first; the parameters are usable and finite."""
    too_few_points = 2
    """Fewer points than the shape needs; the output is the bounding box of what there is."""
    degenerate_point = 3
    """All points coincide."""
    degenerate_line = 4
    """All points lie on a line."""
    degenerate_plane = 5
    """All points lie in a plane, where a solid has no thickness to be known."""
    bad_points = 6
    """A point that the mask keeps (or its evidence) is NaN, infinite or beyond 1e12 m, or has a
    negative variance."""


def status_names(status) -> list[str]:
    """Names of an array of status codes, shape [fit], as they are written to files."""
    return [FitStatus(int(code)).name for code in status]


Kind = Literal["solina", "solina_box", "radial", "distance", "volume_distance"]
Loss = Literal["none", "pseudo_huber", "cauchy", "geman_mcclure"]
Monotone = Literal["none", "falling", "rising"]


def check_word(name: str, word: str, words: Any) -> None:
    """Raises ValueError with what the option may be where `word` is none of the Literal `words`."""
    known = get_args(words)
    if word not in known:
        raise ValueError(f"{name}: {word!r}, should be one of {', '.join(known)}")
