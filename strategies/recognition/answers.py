"""Which known object was felt, if any, in each world of a batch, and by which way.

    belief and recovered body → description by one way → density of each known object → probability

Faces come first where two or more were felt that are not parallel, then the profile where a contour
stands for the body, else the parameters of the superquadric.
"""

from dataclasses import dataclass

import numpy as np

from fit.match_parameters import log_density, posterior
from strategies.recognition.descriptions import (
    FACES,
    WAYS,
    Described,
    described,
)
from strategies.recognition.known_models import KnownModels, KnownObject
from strategies.recognition.match_faces import log_density_of_any, log_density_of_faces
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from warpgrasp.objects.catalogue_names import NONE_OF_THESE

NONE = NONE_OF_THESE
ALIGNMENT = "catalogue_alignment"
AS_FELT = "as_felt"
RARE = 0.1
"""Episodes added on either side where a kind of evidence was found always or never [est]."""


@dataclass(frozen=True)
class Recognition:
    """Answers, (world,) each."""

    name: np.ndarray
    """A known object, "none of these", or "" where there is nothing to compare."""
    way: np.ndarray
    """By which way it was recognized: faces, profile, parameters, catalogue_alignment, or ""."""
    probability: np.ndarray
    """Of the answer; NaN where there is none."""


def no_answer(worlds: int) -> Recognition:
    """Nothing told of any world."""
    return Recognition(np.full(worlds, "", object), np.full(worlds, "", object),
                       np.full(worlds, np.nan))


def recognize(
    belief: Belief, recovered: Recovered, models: KnownModels, *, way: str = AS_FELT,
    none_prior: float = 0.2,
) -> Recognition:
    """The likeliest answer in each world, by `way` or by the first that there is evidence for.

    A way that the models leave unused gives no answer. `none_prior` is the probability of an object
    that is not among the models before anything is felt.
    """
    answer = no_answer(belief.worlds)
    names = np.array([*models.names, NONE], object)
    left = np.ones(belief.worlds, bool)
    for one in WAYS if way == AS_FELT else (way,):
        if one in models.unused:
            continue
        if not left.any():
            break
        found = described(belief, recovered, one).part(left)
        share = probabilities(found, models, one, none_prior=none_prior)
        best = share.argmax(1)
        answer.name[found.rows] = names[best]
        answer.way[found.rows] = one
        answer.probability[found.rows] = share.max(1, initial=0.0)
        left[found.rows] = False
    return answer


def probabilities(
    found: Described, models: KnownModels, way: str, *, none_prior: float
) -> np.ndarray:
    """Of each known object and, last, of those that are not listed, (row, object + 1)."""
    return posterior(log_densities(found, models, way), none_prior=none_prior,
                     temperature=models.temperature[way])


def log_densities(found: Described, models: KnownModels, way: str) -> np.ndarray:
    """Logarithms of the densities of what was felt, (row, object + 1), unlisted ones last."""
    every = (*models.objects, models.unlisted)
    if way == FACES:
        of_any = log_density_of_any(found.faces)
        values = np.stack([
            of_any if known.faces is None
            else log_density_of_faces(found.faces, known.faces.model, known.faces.std_m)
            for known in every], 1)
    else:
        # Of an object seldom found this way no more is known than of any.
        populations = [known.populations.get(way, models.unlisted.populations[way])
                       for known in every]
        values = np.stack([log_density(found.numbers, found.covariance, population)
                           for population in populations], 1)
    return values + [_log_rate(known, way) for known in every]


def _log_rate(known: KnownObject, way: str) -> float:
    """How often an object gives evidence of this kind."""
    return float(np.log((known.found[way] + RARE) / (known.tried[way] + 2 * RARE)))
