"""Recognition against a catalogue by parameters with their covariance, or by radius profile.

Each entry gives a probability density at the recovered shape. A broad background density stands for
unlisted objects: "none of these" is one of the answers. For polyhedra see `interpretation_tree`.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fit.fit_status import is_fitted
from fit.revolution.record import RevolutionFit
from fit.superquadric.geometry import SuperquadricLike

NONE = "none of these"
PARAMETERS = (0, 1, 2, 3, 4, 11, 12)
"""Tangent coordinates of shape rather than pose: log sizes, exponents, tapers."""
MODEL_STD = np.array([0.06, 0.06, 0.06, 0.15, 0.15, 0.15, 0.15])
"""Standard deviations of a shape recovered from perfect touches: a real object is no superquadric,
and its fit depends on where it was touched."""
BACKGROUND_STD = np.array([0.7, 0.7, 0.7, 0.6, 0.6, 0.5, 0.5])
"""Standard deviations of unlisted objects about the mean of the catalogue."""


@dataclass(frozen=True)
class Entry:
    """One object of a catalogue."""

    name: str
    size_m: tuple[float, float, float]
    """Half extents of its superquadric [m]."""
    exponents: tuple[float, float]
    taper: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class ProfileEntry:
    """One object of revolution: its contour [m] from the lower end up."""

    name: str
    height_m: tuple[float, ...]
    radius_m: tuple[float, ...]


@dataclass(frozen=True)
class Candidate:
    """One answer, with its posterior probability."""

    name: str
    probability: float
    distance: float
    """Mahalanobis distance between the entry and the recovered shape."""


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
    """Ranked candidates of each fit, including "none of these"; probabilities sum to one.

    `covariance` is that of `superquadric_uncertainty`. A superquadric has several equivalent
    parameter vectors (x and y exchanged, z reversed, any axis as z if the exponents agree); the
    nearest one of each entry counts. Raises ValueError for an empty catalogue.
    """
    if not catalogue:
        raise ValueError("catalogue: empty; list at least one Entry")
    pick = np.array(PARAMETERS)
    cov = covariance[:, pick[:, None], pick]
    here = np.concatenate([np.log(np.maximum(fit.size_m, 1e-9)), fit.exponents, fit.taper], axis=1)
    vectors = [_equivalent_vectors(entry) for entry in catalogue]
    centre = np.concatenate(vectors).mean(axis=0)
    answers = []
    for x, c in zip(here, cov, strict=True):
        near, broad = c + np.diag(MODEL_STD**2), c + np.diag(BACKGROUND_STD**2)
        square = np.array([min(_square(x - vector, near) for vector in entry) for entry in vectors])
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
    """Ranked candidates of each surface of revolution, by contour and height.

    Radii are compared at the nodes of the fit. Errors of neighbouring nodes are correlated, so
    each node counts half. Raises ValueError for an empty catalogue.
    """
    if not catalogue:
        raise ValueError("catalogue: empty; list at least one ProfileEntry")
    share = np.linspace(0.0, 1.0, fit.radius_m.shape[1])
    answers = []
    for row, good in enumerate(is_fitted(fit.status)):
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


def _equivalent_vectors(entry: Entry) -> np.ndarray:
    """Equivalent parameter vectors of the entry's body, shape [vector, 7]."""
    (a1, a2, a3), (e1, e2), (kx, ky) = entry.size_m, entry.exponents, entry.taper
    vectors = []
    for s in (1.0, -1.0):
        vectors += [(a1, a2, a3, e1, e2, s * kx, s * ky), (a2, a1, a3, e1, e2, s * ky, s * kx)]
    if abs(e1 - e2) < 0.1 and kx == ky == 0:
        vectors += [(a2, a3, a1, e1, e2, 0, 0), (a3, a2, a1, e1, e2, 0, 0),
                 (a1, a3, a2, e1, e2, 0, 0), (a3, a1, a2, e1, e2, 0, 0)]
    table = np.array(vectors, float)
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
