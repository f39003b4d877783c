"""Why numbers of a robot's tables do not go together, as messages.

They take numbers, not tables: `parameters`, whose tables ask them, imports this module. Lengths
are in metres, and messages name a spec's keys in its units.
"""

from collections.abc import Mapping, Sequence
from math import pi

from warpgrasp.spec_words import word_of

LARGEST_ERROR = 3.0
"""Standard deviations: no robot leaves the bench with more."""


def factor_misfit(shares: Mapping[str, float]) -> str:
    """Why a factor with these relative errors, by their fields, could be zero or less: of the
    largest one; empty where none can."""
    name = max(shares, key=shares.__getitem__)
    if shares[name] * LARGEST_ERROR < 1.0:
        return ""
    return (f"{word_of(name)[0]} times scale is {100 * shares[name]:g} %, which would make a "
            f"factor zero or less; should be below {100 / LARGEST_ERROR:.0f} %")


def pad_width_misfit(width_m: float, face_radius_m: float) -> str:
    """Why a pad with a face of this radius is too wide for the palmar half of a link; empty where
    it is not."""
    most = pi * face_radius_m
    return "" if width_m <= most else (
        f"pad of {1e3 * width_m:g} mm is wider than the palmar half of a link; width_mm should be "
        f"{1e3 * most:.3g} mm at most")


def pad_length_misfit(link: int, length_m: float, bent_m: float, link_length_m: float) -> str:
    """Why a pad of which `bent_m` lie over the fingertip does not fit along its link; empty where
    it does."""
    if 0.0 <= length_m - bent_m <= link_length_m:
        return ""
    return (f"pad of {length_m * 1e3:g} mm does not fit link {link} of {link_length_m * 1e3:g} mm; "
            f"should be {bent_m * 1e3:.3g} to {(bent_m + link_length_m) * 1e3:.3g} mm long")


def order_misfit(low: Sequence[float], high: Sequence[float], names: str) -> str:
    """Why limits of the keys `names` ("low_deg should be below high_deg") are none; empty where
    every low one is below its high one."""
    if all(least < most for least, most in zip(low, high, strict=True)):
        return ""
    return f"{names}; are {tuple(low)} and {tuple(high)} in SI units"
