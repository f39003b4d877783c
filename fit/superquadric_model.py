"""The least-squares problem of one superquadric, in JAX: residuals and normal equations.

Everything here is for a single fit, in a frame where the points have unit scale; `batch` makes a
batch of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.normal_residual import Normal
from fit.robust import robust
from fit.superquadric_body import Body, Form, Tensor, body_slopes, unpack
from fit.superquadric_field import distance, log_square_radius, residual, slopes
from fit.superquadric_support import support
from fit.where_any import where_any

UPRIGHT_DOUBT = 3.0
"""Standard deviations of tilt beyond which a body is rather believed to lean."""


class Lane(NamedTuple):
    """The data of one fit, in its own unit frame. Optional evidence is None where switched off."""

    points: Float[Tensor, "3 point"]
    weight: Float[Tensor, " point"]
    """1/standard deviation, scaled so that the squares sum to one; 0 for padding."""
    rotation: Float[Tensor, "3 3"]
    """Orientation about which the tangent parameters turn."""
    loss_scale: Float[Tensor, ""]
    """Residual (weighted) at which the robust loss begins to bend."""
    ridge: Float[Tensor, ""]
    """Weight of the prior that keeps what no point shows from drifting."""
    edge: Float[Tensor, ""]
    """Weight of the prior on the profile's exponent."""
    upright: Float[Tensor, " 2"] | None = None
    """Of the prior that one of the body's axes, whichever, is vertical: the standard deviation of
    the tilt, and the weight of so many of them."""
    plane: Float[Tensor, " 5"] | None = None
    """Down direction (3), height of the plane along it, weight of the support residual."""
    normals: Float[Tensor, "3 point"] | None = None
    normal_weight: Float[Tensor, " point"] | None = None
    free: Float[Tensor, "5 free"] | None = None
    """Balls known to lie outside: centre (3), radius, weight."""


def normal_equations(theta, lane: Lane, form: Form) -> Normal:
    """JᵀJ, Jᵀr and cost of all residuals: points, free balls, the other evidence, the ridge.

    The many residuals at points are differentiated by one backward pass to the numbers of the
    body, a copy for each point; summed there; and brought to theta by one small matrix. The few
    others in forward mode.
    """
    body = unpack(theta, lane.rotation, form)
    step = body_slopes(theta, form)
    sums = _sums(_touched(lane, form), body, lane.points)
    if lane.free is not None:
        # Fits that know no free space yet have it masked, for they share the compiled program.
        sums = sums + where_any(
            lambda body, free: _sums(_free(free), body, free[:3]),
            jnp.any(lane.free[4] > 0.0), body, lane.free)
    matrix = step.T @ sums[:-1, :-1] @ step
    gradient, cost = sums[-1, :-1] @ step, 0.5 * sums[-1, -1]
    if lane.plane is not None:
        r, j = jax.value_and_grad(_above_table)(theta, lane, form)
        matrix, gradient, cost = matrix + jnp.outer(j, j), gradient + r * j, cost + 0.5 * r**2
    others = lambda t: (_others(t, lane, form),) * 2  # noqa: E731
    j, r = jax.jacfwd(others, has_aux=True)(theta)
    return Normal(matrix + j.T @ j, gradient + r @ j, cost + 0.5 * r @ r)


def residuals(theta, lane: Lane, form: Form) -> Float[Array, " residual"]:
    """The residuals themselves, in the order of `normal_equations`."""
    body = unpack(theta, lane.rotation, form)
    each = [_touched(lane, form)(body.shape, body.local(lane.points))]
    if lane.free is not None:
        each.append(_free(lane.free)(body.shape, body.local(lane.free[:3])))
    table = [] if lane.plane is None else [_above_table(theta, lane, form)[None]]
    return jnp.concatenate([*each, *table, _others(theta, lane, form)])


def _touched(lane: Lane, form: Form) -> Callable:
    """The residuals of touches, of (shape, point in its frame)."""
    return lambda shape, local: robust(
        lane.weight * residual(shape, local, form.residual), lane.loss_scale, form.loss)


def _free(free: Float[Tensor, "5 free"]) -> Callable:
    """Those of balls known to lie outside."""
    return lambda shape, local: free[4] * jnp.maximum(free[3] - distance(shape, local), 0.0)


def _sums(function: Callable, body: Body, places: Float[Tensor, "3 point"]):
    """The sums of products of residuals and their derivatives by the numbers of the body."""
    local = body.local(places)
    value, by_shape, by_place = slopes(function, body.shape, local)
    # A turn of the body moves a point the other way in its frame.
    by_turn = jnp.cross(by_place, local, axis=0)
    rows = jnp.concatenate([*jax.tree.leaves(by_shape), by_turn, by_place, value[None]])
    return rows @ rows.T


def _above_table(theta, lane: Lane, form: Form) -> Float[Array, ""]:
    """Residual of the support plane: the body's lowest point lies on it."""
    assert lane.plane is not None
    body = unpack(theta, lane.rotation, form)
    down, height, weight = lane.plane[:3], lane.plane[3], lane.plane[4]
    return weight * (down @ body.position + support(body, down) - height)


def _others(theta, lane: Lane, form: Form) -> Float[Array, " residual"]:
    """The other residuals of the body as a whole, and the ridge."""
    body = unpack(theta, lane.rotation, form)
    parts = []
    if lane.upright is not None:
        u = body.rotation[2]
        # The products vanish exactly where one axis is vertical, and grow with the tilt.
        tilt = jnp.stack([u[0] * u[1], u[1] * u[2], u[2] * u[0]]) / lane.upright[0]
        parts.append(lane.upright[1] * robust(tilt, UPRIGHT_DOUBT, "cauchy"))
    if lane.normals is not None and lane.normal_weight is not None:
        # The tangent plane at a touch is a plane of the dual superquadric: n.(x - t) = h(n).
        reach = jax.vmap(lambda n: support(body, n), in_axes=1)(lane.normals)
        along = jnp.sum(lane.normals * (lane.points - body.position[:, None]), axis=0)
        parts.append(robust(lane.normal_weight * (along - reach), lane.loss_scale, form.loss))
    parts.append(lane.ridge * jnp.concatenate([theta[3:5], theta[11:]]))
    # Half its square is the exponent above its least: that of an exponential distribution.
    parts.append(lane.edge * jnp.sqrt(jax.nn.sigmoid(theta[3:4])))
    return jnp.concatenate(parts)


def look(theta, lane: Lane, form: Form) -> tuple[Body, Array, Array, Array]:
    """The body; each point's distance, the normal there, and its unweighted residual."""
    body = unpack(theta, lane.rotation, form)
    local = body.local(lane.points)
    _, _, steepest = slopes(log_square_radius, body.shape, local)
    normal = steepest / jnp.sqrt(jnp.sum(steepest**2, axis=0) + 1e-24)
    return (body, distance(body.shape, local), body.rotation @ normal,
            residual(body.shape, local, form.residual))
