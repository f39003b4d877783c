"""Recognition of a recovered shape by its numbers and their covariance.

Each known object is a population of shapes that were recovered of it before. A new shape x with
covariance C belongs to it with the density of a multivariate Student t about the population's mean,
with the scatter of the population plus C: the random effects model of meta-analysis (Hardy and
Thompson 1996), with tails for recoveries that went wrong (Lange, Little and Taylor 1989). Unlisted
objects are one more population: "none of these" is an answer. They are of several kinds, so that
their density is a sum of kernels about those that were felt (Silverman 1986), beside a broad one.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.special import gammaln, logsumexp

TAIL = 5.0
"""Degrees of freedom of the Student t [est]: one recovery in some twenty goes wrong."""
ROUNDS = 30
"""Of expectation and maximisation."""
PRIOR_COUNT = 6.0
"""Recoveries that the common scatter counts for in the scatter of one object [est]."""
LEAST_VARIANCE = 1e-6
KERNEL_WIDTH = 0.3
"""Of a kernel about one unlisted object, as a share of their spread [est]: from 0.15 to 0.5 answers
are hardly better or worse (`docs/design_notes/fits.md`)."""
BROAD_COUNT = 6.0
"""Kernels that the broad density counts for: objects unlike all that were felt [est]."""


@dataclass(frozen=True)
class Kernels:
    """Where the objects of a mixed population lie, and how far others like them lie about each."""

    middles: Float[np.ndarray, "object number"]
    scatter: Float[np.ndarray, "number number"]


@dataclass(frozen=True)
class Population:
    """Shapes of one kind: where their numbers lie and how they scatter, beyond what is measured."""

    mean: Float[np.ndarray, " number"]
    scatter: Float[np.ndarray, "number number"]
    count: int
    """Recoveries that it was learned from."""
    kernels: Kernels | None = None
    """Of a population of unlike objects; its mean and scatter are then those of all together."""


def population_of(
    shapes: Float[np.ndarray, "shape number"],
    covariance: Float[np.ndarray, "shape number number"],
    common: Float[np.ndarray, "number number"] | None = None,
) -> Population:
    """The population that some shapes with their covariances were drawn from.

    `common` is the scatter to which few shapes are drawn; without it, a small share of theirs.
    Raises ValueError without shapes.
    """
    count, width = shapes.shape
    if count == 0:
        raise ValueError("shapes: none; a population needs one at least")
    floor = LEAST_VARIANCE * np.eye(width)
    middle = np.median(shapes, axis=0)
    spread = (1.4826 * np.median(np.abs(shapes - middle), axis=0)) ** 2
    common = np.diag(spread) + floor if common is None else common
    mean, scatter = middle, common + floor
    for _ in range(ROUNDS):
        inverse = np.linalg.inv(scatter + covariance)
        away = shapes - mean
        square = np.einsum("si,sij,sj->s", away, inverse, away)
        weight = (TAIL + width) / (TAIL + square)
        pull = np.einsum("s,sij->sij", weight, inverse)
        mean = np.linalg.solve(pull.sum(0), np.einsum("sij,sj->i", pull, shapes))
        # Each shape's own deviation from the mean, as far as its covariance does not explain it.
        own = np.einsum("ij,sjk,sk->si", scatter, inverse, shapes - mean)
        left = scatter - np.einsum("ij,sjk,kl->sil", scatter, inverse, scatter)
        total = np.einsum("s,si,sj->ij", weight, own, own) + left.sum(0)
        scatter = (total + PRIOR_COUNT * common) / (count + PRIOR_COUNT) + floor
    return Population(mean, 0.5 * (scatter + scatter.T), count)


def kernels_of(
    shapes: Float[np.ndarray, "shape number"], objects: Int[np.ndarray, " shape"],
    population: Population, common: Float[np.ndarray, "number number"] | None = None,
) -> Kernels:
    """Kernels about the objects that shapes were recovered of: the medians of each one's shapes.

    `population` is that of all shapes, `common` the scatter of shapes of one object.
    """
    middles = np.array([np.median(shapes[objects == one], axis=0) for one in np.unique(objects)])
    scatter = KERNEL_WIDTH**2 * population.scatter + (0.0 if common is None else common)
    return Kernels(middles, scatter)


def log_density(
    shapes: Float[np.ndarray, "shape number"],
    covariance: Float[np.ndarray, "shape number number"],
    population: Population,
) -> Float[np.ndarray, " shape"]:
    """Logarithm of the population's density at shapes measured with these covariances."""
    broad = _log_student(shapes, covariance, population.mean[None],
                         population.scatter * (1 + 1 / population.count))[:, 0]
    kernels = population.kernels
    if kernels is None:
        return broad
    count = len(kernels.middles)
    near = logsumexp(_log_student(shapes, covariance, kernels.middles, kernels.scatter), axis=1)
    return np.logaddexp(near, np.log(BROAD_COUNT) + broad) - np.log(count + BROAD_COUNT)


def _log_student(shapes: np.ndarray, covariance: np.ndarray, means: np.ndarray,
                 scatter: np.ndarray) -> np.ndarray:
    """Log densities of Student t about several means, (shape, mean)."""
    width = shapes.shape[1]
    scale = scatter + covariance
    away = shapes[:, None] - means
    square = (away * np.linalg.solve(scale, away.swapaxes(1, 2)).swapaxes(1, 2)).sum(2)
    return (gammaln((TAIL + width) / 2) - gammaln(TAIL / 2) - 0.5 * width * np.log(TAIL * np.pi)
            - 0.5 * np.linalg.slogdet(scale)[1][:, None]
            - 0.5 * (TAIL + width) * np.log1p(square / TAIL))


def posterior(
    log_densities: Float[np.ndarray, "shape population"],
    *, none_prior: float, temperature: float = 1.0,
) -> Float[np.ndarray, "shape population"]:
    """Probability of each population, the last one being unlisted objects; rows sum to one.

    `none_prior` is the probability of an unlisted object before anything is felt; listed ones share
    the rest. Log densities are divided by `temperature`, which is above one where errors of the
    numbers are more alike than the populations say (Guo and others 2017).
    """
    listed = log_densities.shape[1] - 1
    prior = np.append(np.full(listed, (1 - none_prior) / max(listed, 1)), none_prior)
    log = log_densities / temperature + np.log(prior)
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    return weight / weight.sum(axis=1, keepdims=True)
