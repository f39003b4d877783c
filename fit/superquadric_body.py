"""The parameter vector of a superquadric and the body it stands for, in JAX, one fit at a time."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fit.robust import Loss
from fit.superquadric_field import Kind, Shape

LEAST_EXPONENT, GREATEST_EXPONENT = 0.1, 2.0
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
    def shape(self) -> Shape:
        """What it is wherever it lies, to be evaluated at points."""
        return jax.tree.map(lambda v: v[:, None],
                            Shape(self.size, self.exponents, self.taper, self.bend))

    def local(self, points: Float[Tensor, "3 point"]) -> Float[Array, "3 point"]:
        """Points in the body's own frame."""
        return self.rotation.T @ (points - self.position[:, None])


def unpack(theta: Float[Array, " parameter"], rotation: Float[Tensor, "3 3"], form: Form) -> Body:
    """The body of a parameter vector.

    theta: log sizes (3), logits of the exponents (2), turn about `rotation` (3, Cayley), position
    (3), then arctanh of the taper (2) and the bend (2) where the form has them.
    """
    shape = _shape(theta, form)
    return Body(shape.size, shape.exponents, jnp.matmul(rotation, cayley(theta[5:8])),
                theta[8:11], shape.taper, shape.bend)


def body_slopes(
    theta: Float[Array, " parameter"], rotation: Float[Tensor, "3 3"], form: Form
) -> Float[Array, "motion parameter"]:
    """Derivatives of the body by theta: of the shape's numbers, of its turn about its own axes,
    and of the place of a fixed point in its frame as it is shifted.

    The rows belong to the shape's fields one after the other, then the turn, then the shift.
    """
    numbers = jax.jacfwd(lambda t: jnp.concatenate(jax.tree.leaves(_shape(t, form))))(theta)
    h = 0.5 * theta[5:8]
    turn = (jnp.eye(3) - _skew(h)) / (1.0 + h @ h)
    shift = -jnp.matmul(rotation, cayley(theta[5:8])).T
    rest = jnp.zeros((3, form.parameters - 11), theta.dtype)
    none = jnp.zeros((3, 3), theta.dtype)
    before = jnp.zeros((3, 5), theta.dtype)
    return jnp.concatenate([numbers, jnp.concatenate([before, turn, none, rest], axis=1),
                            jnp.concatenate([before, none, shift, rest], axis=1)])


def _shape(theta: Float[Array, " parameter"], form: Form) -> Shape:
    size = jnp.exp(jnp.clip(theta[0:3], -8.0, 4.0))
    span = GREATEST_EXPONENT - LEAST_EXPONENT
    exponents = LEAST_EXPONENT + span * jax.nn.sigmoid(theta[3:5])
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
    skew = _skew(h)
    return jnp.eye(3) + 2.0 * (skew + skew @ skew) / (1.0 + h @ h)


def _skew(h):
    return jnp.array([[0.0, -h[2], h[1]], [h[2], 0.0, -h[0]], [-h[1], h[0], 0.0]])
