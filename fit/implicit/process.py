"""One Gaussian process over signed distance, in JAX, in a unit-scale frame.

The distance f to the body is a prior mean m plus a process g of zero mean with a Matern 3/2 kernel
(Williams and Fitzgibbon 2007; Dragiev, Toussaint and Gienger 2011; with a body as mean, Martens
and others 2017). A touch says f = 0, so g = -m there. The hyperparameters maximize the marginal
likelihood times a broad prior; the descent takes the average information in place of the Hessian
(Gilmour, Thompson and Cullis 1995), which has the form of a Gauss-Newton matrix.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Float, Int

from fit.optimize.solver import NormalEquations
from fit.superquadric.parameter_vector import Tensor

SQRT3 = 3.0**0.5
LOG_LENGTH = (-0.4, 0.7)
"""Prior mean and standard deviation of the logarithm of the length scale; the unit is the root mean
square distance of the touches from their centre [est]."""
LOG_SLOPE = (-0.9, 1.0)
"""Of amplitude / length^1.5, which is what nearby touches determine (Zhang 2004) [est]."""
LEAST_AMPLITUDE = 0.02
"""Added to the amplitude as a standard deviation, in unit frames [est]: a body that explains every
touch is still not known so well where nothing was felt."""
LOG_NOISE_STD = 0.35
"""Of the noise about its prior median [est]."""


class ProcessData(NamedTuple):
    """Data of one fit in its unit frame."""

    points: Float[Tensor, "row 3"]
    target: Float[Tensor, " row"]
    """What g is there: distance felt less the mean."""
    variance: Float[Tensor, " row"]
    """Known variance of the target."""
    noisy: Float[Tensor, " row"]
    """1 where the fitted noise comes on top of it."""
    weight: Float[Tensor, " row"]
    """Share of its precision that a row keeps: less than 1 for a likely outlier."""
    used: Float[Tensor, " row"]
    """1, or 0 for padding."""
    touch: Int[Tensor, " row"]
    """The row of the touch that a row comes from: its own of a touch; -1 of a ball or padding."""
    log_noise: Float[Tensor, ""]
    """Prior mean of the logarithm of the noise."""


class Posterior(NamedTuple):
    """What the touches leave of the process."""

    alpha: Float[Tensor, " row"]
    """Coefficients of the kernel; 0 where not used."""
    noise: Float[Tensor, " row"]
    """Variance of each row."""
    deleted: Float[Tensor, " row"]
    """What all other rows predict for a row, less its target."""
    deleted_variance: Float[Tensor, " row"]
    """Variance of that prediction of g, without the row's own noise."""
    cost: Float[Tensor, ""]


def matern(distance, length):
    """The Matern 3/2 kernel of amplitude 1."""
    scaled = SQRT3 * distance / length
    return (1.0 + scaled) * jnp.exp(-scaled)


def unpack(theta):
    """Length scale, amplitude and noise from theta = log(length, amplitude / length^1.5, noise)."""
    amplitude = jnp.sqrt(jnp.exp(2.0 * theta[1] + 3.0 * theta[0]) + LEAST_AMPLITUDE**2)
    return jnp.exp(theta[0]), amplitude, jnp.exp(theta[2])


def distances(a, b):
    """Distances of points [row, 3] and [column, 3]."""
    square = (a * a).sum(1)[:, None] + (b * b).sum(1)[None] - 2.0 * a @ b.T
    return jnp.sqrt(jnp.maximum(square, 0.0))


def row_noise(theta, data: ProcessData):
    """Variance of each row; 1 where not used."""
    noise = data.variance + data.noisy * jnp.exp(2.0 * theta[2])
    return jnp.where(data.used > 0, noise / data.weight, 1.0)


def _factored(theta, data: ProcessData):
    """The kernel's scaled distances, its matrix, the noise, the Cholesky factor, its inverse."""
    length, amplitude, _ = unpack(theta)
    rows = len(data.target)
    scaled = SQRT3 * distances(data.points, data.points) / length
    scaled = scaled * (1.0 - jnp.eye(rows))  # rounding would leave a distance to itself
    both = data.used[:, None] * data.used[None]
    signal = amplitude**2 * both * (1.0 + scaled) * jnp.exp(-scaled)
    noise = row_noise(theta, data)
    lower = jnp.linalg.cholesky(signal + jnp.diag(noise))
    inverse = solve_triangular(lower, jnp.eye(rows), lower=True)
    return scaled, signal, noise, lower, inverse


def _cost(theta, data: ProcessData, square, lower):
    """Never negative: the determinant is compared with that of the known variances."""
    least = jnp.where(data.used > 0, data.variance / data.weight, 1.0)
    away, scale = _prior(theta, data)
    log_determinant = 2.0 * jnp.log(jnp.diagonal(lower)).sum()
    return (0.5 * square + 0.5 * (log_determinant - jnp.log(least).sum())
            + 0.5 * ((away / scale) ** 2).sum())


def _prior(theta, data: ProcessData):
    """theta less its prior mean, and the standard deviations of the prior."""
    mean = jnp.array([LOG_LENGTH[0], LOG_SLOPE[0], 0.0]).at[2].set(data.log_noise)
    return theta - mean, jnp.array([LOG_LENGTH[1], LOG_SLOPE[1], LOG_NOISE_STD])


def normal_equations(theta, data: ProcessData) -> NormalEquations:
    """Average information, gradient and value of the cost of theta."""
    scaled, signal, noise, lower, inverse_factor = _factored(theta, data)
    _, amplitude, sigma = unpack(theta)
    target = data.target * data.used
    # Three times as fast as the product of the factors.
    inverse = solve_triangular(lower, inverse_factor, lower=True, trans=1)
    alpha = inverse @ target
    both = data.used[:, None] * data.used[None]
    share = 1.0 - (LEAST_AMPLITUDE / amplitude) ** 2
    by_length = 3.0 * share * signal + amplitude**2 * both * scaled**2 * jnp.exp(-scaled)
    by_noise = 2.0 * data.used * data.noisy * sigma**2 / data.weight
    slopes = jnp.stack([by_length @ alpha, 2.0 * share * (signal @ alpha), by_noise * alpha], 1)
    own = jnp.diagonal(inverse)
    traces = jnp.array([(inverse * by_length).sum(),
                        2.0 * share * (data.used * (1.0 - own * noise)).sum(),
                        (own * by_noise).sum()])
    away, scale = _prior(theta, data)
    half = inverse_factor @ slopes
    return NormalEquations(
        matrix=0.5 * half.T @ half + jnp.diag(1.0 / scale**2),
        gradient=0.5 * (traces - alpha @ slopes) + away / scale**2,
        cost=_cost(theta, data, target @ alpha, lower))


def posterior(theta, data: ProcessData) -> Posterior:
    """The posterior of one process, and what it would be at each row without that row."""
    _, _, noise, lower, inverse_factor = _factored(theta, data)
    target = data.target * data.used
    alpha = inverse_factor.T @ (inverse_factor @ target)
    own = (inverse_factor**2).sum(0)
    return Posterior(alpha, noise, -alpha / own, jnp.maximum(1.0 / own - noise, 0.0),
                     _cost(theta, data, target @ alpha, lower))


def slope_at_rows(theta, data: ProcessData):
    """Gradient of g at the rows, [row, 3]."""
    length, amplitude, _ = unpack(theta)
    alpha = posterior(theta, data).alpha
    return slope(length, amplitude, data.points, alpha, data.points)


def slope(length, amplitude, points, alpha, queries):
    """Gradient of g at queries [query, 3].

    That of the kernel is -3 amplitude^2 exp(-r) (x - x_i) / length^2.
    """
    pull = amplitude**2 * jnp.exp(-SQRT3 * distances(queries, points) / length) * alpha[None]
    return -3.0 / length**2 * (queries * pull.sum(1, keepdims=True) - pull @ points)


def predict(length, amplitude, points, alpha, queries):
    """g at queries [query, 3], in single precision, which is twice as fast."""
    scaled = distances(*((x * (SQRT3 / length)).astype(jnp.float32) for x in (queries, points)))
    kernel = (1.0 + scaled) * jnp.exp(-scaled)
    return (kernel @ (amplitude**2 * alpha).astype(jnp.float32)).astype(alpha.dtype)


def covariance_factor(length, amplitude, points, noise, used):
    """The Cholesky factor of the covariance of rows at points [row, 3]."""
    scaled = SQRT3 * distances(points, points) / length * (1.0 - jnp.eye(len(noise)))
    signal = amplitude**2 * used[:, None] * used[None] * (1.0 + scaled) * jnp.exp(-scaled)
    return jnp.linalg.cholesky(signal + jnp.diag(noise))


def predict_with_slope(length, amplitude, points, alpha, noise, used, queries):
    """g at queries [query, 3], its gradient [query, 3] and its variance [query].

    `noise` is that of each row, 1 where not `used`.
    """
    lower = covariance_factor(length, amplitude, points, noise, used)
    across = amplitude**2 * matern(distances(queries, points), length) * used[None]
    solved = solve_triangular(lower, across.T, lower=True)
    variance = jnp.maximum(amplitude**2 - (solved**2).sum(0), 0.0)
    return across @ alpha, slope(length, amplitude, points, alpha, queries), variance
