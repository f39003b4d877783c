"""The parameter vector of a superquadric and the body it stands for, in JAX, one fit at a time."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fit.fit_status import Kind, Loss
from fit.superquadric.field import Shape

LEAST_EXPONENT, GREATEST_EXPONENT = 0.1, 2.0
_SPAN = GREATEST_EXPONENT - LEAST_EXPONENT
TAPER_REACH = 1.05
"""Above one, so that the full taper of a wedge or a cone lies at a finite parameter."""
GREATEST_BEND = 1.0
"""Curvature times the body's half diagonal stays below this, so that it never folds."""
Tensor = Array | np.ndarray
"""Numpy on the way in, JAX once traced."""


class Form(NamedTuple):
    """What is fixed when a fit is compiled."""

    taper: bool
    bend: bool
    residual: Kind
    loss: Loss

    @property
    def parameters(self) -> int:
        """Number of parameters: 11, 13 or 15."""
        return 11 + 2 * self.taper + 2 * self.bend


class Body(NamedTuple):
    """A superquadric in the unit frame."""

    size: Float[Array, " 3"]
    exponents: Float[Array, " 2"]
    rotation: Float[Array, "3 3"]
    position: Float[Array, " 3"]
    taper: Float[Array, " 2"] | None
    bend: Float[Array, " 2"] | None
    """Curvature as a vector in the body's x, y plane, per unit length."""

    @property
    def numbers(self) -> Shape:
        """What it is wherever it lies."""
        return Shape(self.size, self.exponents, self.taper, self.bend)

    @property
    def shape(self) -> Shape:
        """The same, to be evaluated at points."""
        return jax.tree.map(lambda v: v[:, None], self.numbers)

    def local(self, points: Float[Tensor, "3 point"]) -> Float[Array, "3 point"]:
        """Points in the body's own frame."""
        return self.rotation.T @ (points - self.position[:, None])

    def inward(self, directions: Float[Tensor, "3 n"]) -> Float[Array, "3 n"]:
        """World directions in the body's own frame."""
        return product(self.rotation.T, directions)


def unpack(theta: Float[Array, " parameter"], rotation: Float[Tensor, "3 3"], form: Form) -> Body:
    """The body of a parameter vector.

    theta: log sizes (3), logits of the exponents (2), turn about `rotation` (3, Cayley), position
    along its axes (3), then arctanh of the taper (2) and the bend (2) where the form has them. No
    number belongs to the world's axes, so that a turned set descends by the turned path.
    """
    shape = _shape(theta, form)
    turned = jnp.matmul(rotation, cayley(theta[5:8]))
    position = jnp.matmul(rotation, theta[8:11])
    return Body(shape.size, shape.exponents, turned, position, shape.taper, shape.bend)


def by_parameters(
    slopes: Float[Array, "number column"], theta: Float[Array, " parameter"], form: Form
) -> Float[Array, "parameter column"]:
    """Derivatives by theta of what has these derivatives by the body: the chain rule, by hand.

    Rows of `slopes`: by the numbers of the shape, field by field; by a turn of the body about its
    own axes (3); by a shift of a fixed point in its frame (3), which is one of the body the other
    way; then whatever else, which stays. The product with a matrix, written out: it is mostly
    zeros, and compilers make slow work of small ones.
    """
    size, exponents, taper, bend = _shape(theta, form)
    numbers = form.parameters - 6
    turn, shift, rest = jnp.split(slopes[numbers:], [3, 6])
    per_size = jnp.where((theta[0:3] > -8.0) & (theta[0:3] < 4.0), size, 0.0)
    by_size = per_size[:, None] * slopes[0:3]
    share = (exponents - LEAST_EXPONENT) / _SPAN
    rows = [(_SPAN * share * (1.0 - share))[:, None] * slopes[3:5]]
    h = 0.5 * theta[5:8]
    rows.append((turn + jnp.cross(h[:, None], turn, axis=0)) / (1.0 + jnp.sum(h**2)))
    rows.append(-product(cayley(theta[5:8]), shift))
    if taper is not None:
        steep = TAPER_REACH * (1.0 - jnp.tanh(theta[11:13]) ** 2)
        rows.append(jnp.where(jnp.abs(taper) < 1.0, steep, 0.0)[:, None] * slopes[5:7])
    if bend is not None:
        by_bend = slopes[numbers - 2 : numbers]
        v = theta[form.parameters - 2 :]
        longer = 1.0 + jnp.sum(v**2)
        along = jnp.sum(by_bend * bend[:, None], axis=0)
        square = jnp.sum(size**2)
        by_size = by_size - (per_size * size / square)[:, None] * along
        limit = GREATEST_BEND / jnp.sqrt(square * longer)
        rows.append(limit * by_bend - (v / longer)[:, None] * along)
    return jnp.concatenate([by_size, *rows, rest])


def product(matrix: Float[Tensor, "3 3"], columns: Float[Tensor, "3 n"]) -> Float[Array, "3 n"]:
    """`matrix @ columns`, written out."""
    return sum(matrix[:, k, None] * columns[None, k] for k in range(3))  # pyright: ignore


def _shape(theta: Float[Array, " parameter"], form: Form) -> Shape:
    size = jnp.exp(jnp.clip(theta[0:3], -8.0, 4.0))
    exponents = LEAST_EXPONENT + _SPAN * jax.nn.sigmoid(theta[3:5])
    taper, bend = None, None
    if form.taper:
        taper = jnp.clip(TAPER_REACH * jnp.tanh(theta[11:13]), -1.0, 1.0)
    if form.bend:
        v = theta[form.parameters - 2 :]
        limit = GREATEST_BEND / jnp.sqrt(jnp.sum(size**2))
        bend = limit * v / jnp.sqrt(1.0 + jnp.sum(v**2))
    return Shape(size, exponents, taper, bend)


def cayley(w: Float[Array, " 3"]) -> Float[Array, "3 3"]:
    """Rotation of the quaternion (w/2, 1) normalised: rational, the identity to first order in w.

    Its only blind spot is half a turn, which no descent from a sensible start makes.
    """
    h = 0.5 * w
    square = jnp.sum(h**2)
    # The square of the skew matrix is h hᵀ - |h|².
    twice = _skew(h) + h[:, None] * h - square * jnp.eye(3)
    return jnp.eye(3) + 2.0 * twice / (1.0 + square)


def _skew(h):
    return jnp.array([[0.0, -h[2], h[1]], [h[2], 0.0, -h[0]], [-h[1], h[0], 0.0]])
