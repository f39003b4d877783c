"""Model selection for a set of touches: superquadrics, a polyhedron, or a surface of revolution.

Uses the Bayesian information criterion (Schwarz 1978), n log(mean square distance) + k log n, with
k parameters and n *different* places touched: repeated touches of one place add no evidence.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from fit.arrays import is_valid, row_sums
from fit.fit_status import is_fitted
from fit.polyhedron import PolyhedronFit, fit_polyhedron
from fit.revolution.fit import fit_revolution
from fit.revolution.record import RevolutionFit, RevolutionOptions
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.record import SuperquadricFit, SuperquadricOptions

MODELS = ("superquadric", "tapered", "bent", "polyhedron", "revolution")
"""Columns of a choice, simplest first."""


@dataclass(frozen=True)
class ShapeChoice:
    """The chosen model of each set, with the fits of all models."""

    model: Int[np.ndarray, " fit"]
    """Index into `MODELS`; -1 if no model could be fitted."""
    criterion: Float[np.ndarray, "fit model"]
    """Information criterion, less is better; infinite if a model could not be fitted."""
    probability: Float[np.ndarray, "fit model"]
    """Posterior probability under a uniform prior; zeros if no model was fitted."""
    places: Int[np.ndarray, " fit"]
    """Number of different places touched."""
    superquadric: SuperquadricFit
    tapered: SuperquadricFit
    bent: SuperquadricFit
    polyhedron: PolyhedronFit
    revolution: RevolutionFit

    def names(self) -> list[str]:
        """Name of the chosen model of each set, or `none`."""
        return [MODELS[k] if k >= 0 else "none" for k in self.model]


def choose_shape(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"] | None = None,
    *,
    table_z: float | Float[np.ndarray, " fit"] | None = None,
    noise_m: float = 5e-4,
    same_place_m: float = 1e-3,
    options: SuperquadricOptions | None = None,
    revolution: RevolutionOptions | None = None,
) -> ShapeChoice:
    """Choose a model for each set of touches [m].

    `noise_m` is the noise of a touch; no model is rewarded for smaller residuals. Touches closer
    than `same_place_m` count once. Raises ValueError for an array of the wrong shape.
    """
    points = np.asarray(points, float)
    mask = np.ones(points.shape[:2], bool) if mask is None else np.asarray(mask, bool)
    base = options or SuperquadricOptions()
    forms = ((False, False), (True, False), (True, True))
    # One residual for all models, so that their distances are comparable.
    fits = [fit_superquadric(points, mask, table_z=table_z, options=replace(
        base, taper=taper, bend=bend, residual="volume_distance")) for taper, bend in forms]
    round_body = fit_revolution(points, mask, table_z=table_z, options=revolution)
    faces = fit_polyhedron(points, mask, fits[0])
    places = count_places(points, mask, same_place_m)

    good = is_fitted(fits[0].status)
    n_points = np.maximum(fits[0].n_points, 1)
    flat = np.sqrt(row_sums(faces.distance_m**2) / n_points)
    rms = np.stack([*(fit.rms_m for fit in fits), flat, round_body.rms_m], axis=1)
    contour = round_body.radius_m.shape[1] + 6
    parameters = np.tile([11, 13, 15, 0, contour], (len(points), 1))
    # Three per plane; the assignment of a touch to a face (the outermost) is not a parameter.
    parameters[:, 3] = 3 * faces.used.sum(axis=1)
    n = np.maximum(places, 1)[:, None]
    criterion = n * np.log(rms**2 + noise_m**2) + parameters * np.log(n)
    # A model needs fewer parameters than places.
    criterion = np.where(good[:, None] & (parameters < n), criterion, np.inf)
    some = np.isfinite(criterion).any(axis=1)
    best = np.where(some, np.argmin(criterion, axis=1), -1)
    least = np.where(some, criterion.min(axis=1), 0.0)
    weight = np.exp(-0.5 * (criterion - least[:, None]))
    probability = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    plain, tapered, bent = fits
    return ShapeChoice(best, criterion, probability, places, plain, tapered, bent, faces,
                       round_body)


def count_places(points, mask, same_place_m: float) -> Int[np.ndarray, " fit"]:
    """Number of different places touched: a greedy cover by touches at least that far apart.

    Touches are taken in the order of their coordinates, so that neither the input order nor the
    origin matters.
    """
    kept = mask & is_valid(points).all(axis=2)
    return np.array([_count(p[k], same_place_m) for p, k in zip(points, kept, strict=True)], int)


def _count(points: np.ndarray, same_place_m: float) -> int:
    points = points[np.lexsort(points.T)]
    place = np.zeros(len(points), bool)
    for k, point in enumerate(points):
        place[k] = (np.linalg.norm(points[place] - point, axis=1) >= same_place_m).all()
    return int(place.sum())
