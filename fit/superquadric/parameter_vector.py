"""Parameter vector of a superquadric and the body it describes, in JAX, for one fit."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fit.fit_status import Kind, Loss
from fit.superquadric.field import Shape
from fit.superquadric.record import MAX_EXPONENT, MIN_EXPONENT

_SPAN = MAX_EXPONENT - MIN_EXPONENT
TAPER_BOUND = 1.05
"""Above one, so that the full taper of a wedge or cone has a finite parameter."""
MAX_BEND = 1.0
"""Bound of curvature times the half diagonal, so that the body never folds."""
Tensor = Array | np.ndarray
"""NumPy arrays, or traced JAX arrays."""


class Form(NamedTuple):
    """Compile-time constants of a fit."""

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
    """Curvature vector in the body's x, y plane, per unit length."""

    @property
    def numbers(self) -> Shape:
        """The shape without the pose."""
        return Shape(self.size, self.exponents, self.taper, self.bend)

    @property
    def shape(self) -> Shape:
        """The same with an axis to broadcast against points."""
        return jax.tree.map(lambda v: v[:, None], self.numbers)

    def local(self, points: Float[Tensor, "3 point"]) -> Float[Array, "3 point"]:
        """Points in the body's own frame."""
        return self.rotation.T @ (points - self.position[:, None])

    def inward(self, directions: Float[Tensor, "3 n"]) -> Float[Array, "3 n"]:
        """World directions in the body's own frame."""
        return product(self.rotation.T, directions)


def unpack(theta: Float[Array, " parameter"], rotation: Float[Tensor, "3 3"], form: Form) -> Body:
    """The body of a parameter vector.

    theta: log sizes (3), logits of the exponents (2), rotation relative to `rotation` (3, Cayley),
    position along its axes (3), then arctanh of the taper (2) and the bend (2) if the form has
    them. None refers to the world's axes, so that descents are equivariant under rotation.
    """
    shape = _shape(theta, form)
    turned = jnp.matmul(rotation, cayley(theta[5:8]))
    position = jnp.matmul(rotation, theta[8:11])
    return Body(shape.size, shape.exponents, turned, position, shape.taper, shape.bend)


def by_parameters(
    slopes: Float[Array, "number column"], theta: Float[Array, " parameter"], form: Form
) -> Float[Array, "row column"]:
    """Derivatives by theta, from derivatives by the body: the chain rule by hand.

    Rows of `slopes`: by the fields of the shape; by rotation of the body about its own axes (3); by
    translation of a fixed point in its frame (3), the opposite of one of the body; others are
    kept. Written out, because the Jacobian is mostly zeros and small products compile poorly.
    """
    size, exponents, taper, bend = _shape(theta, form)
    numbers = form.parameters - 6
    turn, shift, rest = jnp.split(slopes[numbers:], [3, 6])
    per_size = jnp.where((theta[0:3] > -8.0) & (theta[0:3] < 4.0), size, 0.0)
    by_size = per_size[:, None] * slopes[0:3]
    share = (exponents - MIN_EXPONENT) / _SPAN
    rows = [(_SPAN * share * (1.0 - share))[:, None] * slopes[3:5]]
    h = 0.5 * theta[5:8]
    rows.append((turn + jnp.cross(h[:, None], turn, axis=0)) / (1.0 + jnp.sum(h**2)))
    rows.append(-product(cayley(theta[5:8]), shift))
    if taper is not None:
        steep = TAPER_BOUND * (1.0 - jnp.tanh(theta[11:13]) ** 2)
        rows.append(jnp.where(jnp.abs(taper) < 1.0, steep, 0.0)[:, None] * slopes[5:7])
    if bend is not None:
        by_bend = slopes[numbers - 2 : numbers]
        v = theta[form.parameters - 2 :]
        longer = 1.0 + jnp.sum(v**2)
        along = jnp.sum(by_bend * bend[:, None], axis=0)
        square = jnp.sum(size**2)
        by_size = by_size - (per_size * size / square)[:, None] * along
        limit = MAX_BEND / jnp.sqrt(square * longer)
        rows.append(limit * by_bend - (v / longer)[:, None] * along)
    return jnp.concatenate([by_size, *rows, rest])


def product(matrix: Float[Tensor, "3 3"], columns: Float[Tensor, "3 n"]) -> Float[Array, "3 n"]:
    """`matrix @ columns`, written out for XLA."""
    return sum(matrix[:, k, None] * columns[None, k] for k in range(3))  # pyright: ignore


def _shape(theta: Float[Array, " parameter"], form: Form) -> Shape:
    size = jnp.exp(jnp.clip(theta[0:3], -8.0, 4.0))
    exponents = MIN_EXPONENT + _SPAN * jax.nn.sigmoid(theta[3:5])
    taper, bend = None, None
    if form.taper:
        taper = jnp.clip(TAPER_BOUND * jnp.tanh(theta[11:13]), -1.0, 1.0)
    if form.bend:
        v = theta[form.parameters - 2 :]
        limit = MAX_BEND / jnp.sqrt(jnp.sum(size**2))
        bend = limit * v / jnp.sqrt(1.0 + jnp.sum(v**2))
    return Shape(size, exponents, taper, bend)


def cayley(w: Float[Array, " 3"]) -> Float[Array, "3 3"]:
    """Rotation of the normalised quaternion (w/2, 1): about w to first order.

    It cannot represent a rotation by pi, which descents from `starts` do not need.
    """
    h = 0.5 * w
    square = jnp.sum(h**2)
    # The square of the skew matrix is h hᵀ - |h|².
    twice = _skew(h) + h[:, None] * h - square * jnp.eye(3)
    return jnp.eye(3) + 2.0 * twice / (1.0 + square)


def _skew(h):
    return jnp.array([[0.0, -h[2], h[1]], [h[2], 0.0, -h[0]], [-h[1], h[0], 0.0]])
