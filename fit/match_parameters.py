"""Recognition against a catalogue: by parameters with their covariance, and by radius profile.

Every entry is compared as a probability density at what was recovered, beside a broad background
that stands for objects nobody listed: "none of these" is one of the answers. By faces, see
`interpretation_tree`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fit.revolution.fit import usable
from fit.revolution.record import RevolutionFit
from fit.superquadric.geometry import SuperquadricLike

NONE = "none of these"
PARAMETERS = (0, 1, 2, 3, 4, 11, 12)
"""Tangent coordinates that say what a body is, not where: log sizes, exponents, tapers."""
MODEL_STD = np.array([0.06, 0.06, 0.06, 0.15, 0.15, 0.15, 0.15])
"""How far a recovered shape may be from its entry when the touches are perfect: a real object is
no superquadric, and two fits of it differ by what was touched."""
BACKGROUND_STD = np.array([0.7, 0.7, 0.7, 0.6, 0.6, 0.5, 0.5])
"""Spread of objects at large, about the middle of the catalogue."""


@dataclass(frozen=True)
class Entry:
    """One object of a catalogue; a recovered model may serve as an entry too."""

    name: str
    size_m: tuple[float, float, float]
    """Half extents of its superquadric [m]."""
    exponents: tuple[float, float]
    taper: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class ProfileEntry:
    """One object of revolution: its contour from the lower end up."""

    name: str
    height_m: tuple[float, ...]
    radius_m: tuple[float, ...]


@dataclass(frozen=True)
class Candidate:
    """One answer."""

    name: str
    probability: float
    distance: float
    """Mahalanobis distance of the entry from what was recovered."""


def entry_of_fit(name: str, fit: SuperquadricLike, row: int = 0) -> Entry:
    """A catalogue entry of a recovered superquadric."""
    def numbers(values) -> tuple:
        return tuple(float(v) for v in values[row])

    return Entry(name, numbers(fit.size_m), numbers(fit.exponents), numbers(fit.taper))


def recognize_parameters(
    fit: SuperquadricLike,
    covariance: Float[np.ndarray, "fit 15 15"],
    catalogue: list[Entry],
    *,
    none_prior: float = 0.1,
) -> list[list[Candidate]]:
    """Ranked candidates of each fit, "none of these" among them; probabilities sum to one.

    `covariance` is that of `superquadric_uncertainty`. A superquadric can be written in several
    ways (x and y exchanged, the taper upside down, any axis as z where the exponents agree): each
    entry is compared in the way that suits it best. Raises ValueError for an empty catalogue.
    """
    if not catalogue:
        raise ValueError("catalogue: empty; list at least one Entry")
    pick = np.array(PARAMETERS)
    cov = covariance[:, pick[:, None], pick]
    here = np.concatenate([np.log(np.maximum(fit.size_m, 1e-9)), fit.exponents, fit.taper], axis=1)
    ways = [_ways(entry) for entry in catalogue]
    centre = np.concatenate(ways).mean(axis=0)
    answers = []
    for x, c in zip(here, cov, strict=True):
        near, broad = c + np.diag(MODEL_STD**2), c + np.diag(BACKGROUND_STD**2)
        square = np.array([min(_square(x - way, near) for way in entry) for entry in ways])
        log = -0.5 * square - 0.5 * np.linalg.slogdet(near)[1] + np.log((1 - none_prior)
                                                                        / len(catalogue))
        none = _square(x - centre, broad)
        log_none = -0.5 * none - 0.5 * np.linalg.slogdet(broad)[1] + np.log(none_prior)
        names = [entry.name for entry in catalogue]
        answers.append(_ranked(names, log, square, log_none, none))
    return answers


def recognize_profile(
    fit: RevolutionFit,
    catalogue: list[ProfileEntry],
    *,
    model_std_m: float = 2e-3,
    none_prior: float = 0.1,
) -> list[list[Candidate]]:
    """Ranked candidates of each surface of revolution by contour, height and (so) volume.

    Radii are compared at the fit's own nodes; neighbours on a smooth contour err together, which
    counts as every other node being known. Raises ValueError for an empty catalogue.
    """
    if not catalogue:
        raise ValueError("catalogue: empty; list at least one ProfileEntry")
    share = np.linspace(0.0, 1.0, fit.radius_m.shape[1])
    answers = []
    for row, good in enumerate(usable(fit)):
        radius, height = fit.radius_m[row], fit.height_m[row]
        std = np.hypot(fit.radius_std_m[row], model_std_m)
        tall = max(0.03 * height, 2 * model_std_m)
        square, broad = [], []
        for entry in catalogue:
            z = np.asarray(entry.height_m) - entry.height_m[0]
            true = np.interp(share * z[-1], z, entry.radius_m)
            square.append(0.5 * np.sum(((radius - true) / std) ** 2)
                          + ((height - z[-1]) / tall) ** 2)
            broad.append(true)
        spread = 0.015
        middle = np.mean(broad, axis=0)
        none = (0.5 * np.sum((radius - middle) ** 2 / (std**2 + spread**2))
                + ((height - 0.15) / 0.1) ** 2)
        normal = -0.5 * np.sum(np.log(std)) - np.log(tall)
        log = -0.5 * np.array(square) + normal + np.log((1 - none_prior) / len(catalogue))
        log_none = (-0.5 * none - 0.25 * np.sum(np.log(std**2 + spread**2)) - np.log(0.1)
                    + np.log(none_prior))
        if not good:
            log = np.full(len(catalogue), -np.inf)
        names = [entry.name for entry in catalogue]
        answers.append(_ranked(names, log, np.array(square), log_none, float(none)))
    return answers


def _ways(entry: Entry) -> np.ndarray:
    """The parameter vectors that all describe the entry's body, shape [way, 7]."""
    (a1, a2, a3), (e1, e2), (kx, ky) = entry.size_m, entry.exponents, entry.taper
    ways = []
    for s in (1.0, -1.0):
        ways += [(a1, a2, a3, e1, e2, s * kx, s * ky), (a2, a1, a3, e1, e2, s * ky, s * kx)]
    if abs(e1 - e2) < 0.1 and kx == ky == 0:
        ways += [(a2, a3, a1, e1, e2, 0, 0), (a3, a2, a1, e1, e2, 0, 0),
                 (a1, a3, a2, e1, e2, 0, 0), (a3, a1, a2, e1, e2, 0, 0)]
    table = np.array(ways, float)
    table[:, :3] = np.log(table[:, :3])
    return table


def _square(difference: np.ndarray, covariance: np.ndarray) -> float:
    return float(difference @ np.linalg.solve(covariance, difference))


def _ranked(names, log, square, log_none: float, square_none: float) -> list[Candidate]:
    every = np.append(log, log_none)
    weight = np.exp(every - every.max())
    weight /= weight.sum()
    distance = np.sqrt(np.append(square, square_none))
    candidates = [Candidate(name, float(w), float(d)) for name, w, d in
                  zip([*names, NONE], weight, distance, strict=True)]
    return sorted(candidates, key=lambda c: -c.probability)
