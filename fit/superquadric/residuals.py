"""The least-squares problem of one superquadric, in JAX: residuals and normal equations.

Everything here is for a single fit, in a frame where the points have unit scale; `batch` makes a
batch of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fit.optimize.robust_loss import robust
from fit.optimize.solver import Normal
from fit.optimize.vmap_cond import where_any
from fit.optimize.xla_flags import storing
from fit.superquadric.field import distance, log_square_radius, residual, slopes
from fit.superquadric.parameter_vector import Body, Form, Tensor, by_parameters, product, unpack
from fit.superquadric.support import support

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
    """JᵀJ, Jᵀr and cost of all residuals: points, free balls, the other evidence, the priors.

    Residuals are differentiated backwards to the numbers of the body, a copy of these for each,
    and summed there; the sums are brought to theta by hand. The priors have a parameter each.
    """
    body = unpack(theta, lane.rotation, form)
    columns = [_at_points(body, lane.points, *_touched(lane, form))]
    if lane.plane is not None:
        columns.append(_of_table(body, lane.plane))
    if lane.upright is not None:
        columns.append(_of_tilt(body, lane.upright))
    if lane.normals is not None:
        columns.append(_of_normals(body, lane, form))
    sums = _sums(jnp.concatenate(columns, axis=1))
    if lane.free is not None:
        # Fits that know no free space yet have it masked, for they share the compiled program.
        sums = sums + where_any(
            lambda body, free: _sums(_at_points(body, free[:3], *_free(free))),
            jnp.any(lane.free[4] > 0.0), body, lane.free)
    sums = by_parameters(by_parameters(sums, theta, form).T, theta, form)
    stiffness, pull, energy = _priors(theta, lane)
    return Normal(sums[:-1, :-1] + stiffness * np.eye(len(theta)), sums[-1, :-1] + pull,
                  0.5 * sums[-1, -1] + energy)


def residual_vector(theta, lane: Lane, form: Form) -> Float[Array, " residual"]:
    """The residuals themselves, in the order of `normal_equations`."""
    body = unpack(theta, lane.rotation, form)
    raw, made = _touched(lane, form)
    each = [made(raw(body.shape, body.local(lane.points)))]
    if lane.plane is not None:
        reach = support(body.numbers, body.inward(lane.plane[:3, None])[:, 0])
        each.append(_above_table(body, lane.plane, reach)[None])
    if lane.upright is not None:
        each.append(_tilt(body.rotation[2], lane.upright))
    if lane.normals is not None:
        reach = jax.vmap(support, (None, 1))(body.numbers, body.inward(lane.normals))
        each.append(robust(_outside_planes(body, lane, reach), lane.loss_scale, form.loss))
    if lane.free is not None:
        raw, made = _free(lane.free)
        each.append(made(raw(body.shape, body.local(lane.free[:3]))))
    edge = lane.edge * jnp.sqrt(jax.nn.sigmoid(theta[3:4]))
    return jnp.concatenate([*each, lane.ridge * theta[3:5], lane.ridge * theta[11:], edge])


def _touched(lane: Lane, form: Form) -> tuple[Callable, Callable]:
    """A touch's raw residual, of (shape, point in its frame), and what is made of it."""
    return (lambda shape, local: residual(shape, local, form.residual),
            lambda raw: robust(lane.weight * raw, lane.loss_scale, form.loss))


def _free(free: Float[Tensor, "5 free"]) -> tuple[Callable, Callable]:
    """The same of balls known to lie outside."""
    return distance, lambda away: free[4] * jnp.maximum(free[3] - away, 0.0)


def _at_points(
    body: Body, places: Float[Tensor, "3 point"], raw: Callable, made: Callable
) -> Float[Array, "row point"]:
    """The derivatives of residuals at points, as `_columns`."""
    local = body.local(places)
    value, by_shape, by_place = slopes(raw, body.shape, local)
    value, factor = jax.jvp(made, (value,), (jnp.ones_like(value),))
    return _columns(value, jax.tree.leaves(by_shape), by_place, local, by_place,
                    storing(places[2])(factor))


def _columns(value, by_shape, by_arm, arm, by_shift, factor) -> Float[Array, "row column"]:
    """Derivatives, times a factor, of what hangs on a body's numbers, on places or directions
    `arm` in its frame and on a shift of the frame: a turn of the body turns them the other way.
    A column each; in the order of `by_parameters`, and last the values themselves."""
    (x, y, z), (dx, dy, dz) = arm, by_arm
    by_turn = [dy * z - dz * y, dz * x - dx * z, dx * y - dy * x]
    rows = [*by_shape, *by_turn, *by_shift]
    return jnp.stack([*(row * factor for row in rows), value])


def _sums(columns):
    """Sums of products of residuals and their derivatives."""
    return columns @ columns.T


def _above_table(body: Body, plane: Float[Tensor, " 5"], reach) -> Float[Array, ""]:
    """Residual of the support plane: the body's lowest point lies on it."""
    down, height, weight = plane[:3], plane[3], plane[4]
    return weight * (jnp.sum(down * body.position) + reach - height)


def _of_table(body: Body, plane: Float[Tensor, " 5"]):
    down = body.inward(plane[:3, None])
    reach, (by_shape, by_down) = jax.value_and_grad(support, argnums=(0, 1))(
        body.numbers, down[:, 0])
    numbers = jnp.concatenate(jax.tree.leaves(by_shape))[:, None]
    value = _above_table(body, plane, reach)[None]
    return _columns(value, numbers, by_down[:, None], down, -down, plane[4])


def _tilt(up: Float[Array, " 3"], upright: Float[Tensor, " 2"]) -> Float[Array, " 3"]:
    """Residuals of the prior that an axis of the body is vertical, of the vertical in its frame.

    Products of two coordinates each: they vanish exactly there, and grow with the tilt.
    """
    return _tilt_of(up * jnp.roll(up, -1), upright)


def _tilt_of(products, upright):
    return upright[1] * robust(products / upright[0], UPRIGHT_DOUBT, "cauchy")


def _of_tilt(body: Body, upright: Float[Tensor, " 2"]):
    up = body.rotation[2]
    after = jnp.roll(up, -1)
    value, slope = jax.jvp(lambda products: _tilt_of(products, upright), (up * after,),
                           (jnp.ones_like(up),))
    by_up = after * np.eye(3) + up * np.roll(np.eye(3), 1, axis=0)
    none = jnp.zeros(3, up.dtype)
    numbers = sum(len(v) for v in jax.tree.leaves(body.numbers))
    return _columns(value, [none] * numbers, by_up, up[:, None], [none] * 3, slope)


def _outside_planes(body: Body, lane: Lane, reach: Float[Array, " point"]):
    """How far touches lie outside the body's planes of the normals felt, weighted.

    The tangent plane at a touch is a plane of the dual superquadric: n.(x - t) = h(n).
    """
    assert lane.normals is not None
    assert lane.normal_weight is not None
    along = jnp.sum(lane.normals * (lane.points - body.position[:, None]), axis=0)
    return lane.normal_weight * (along - reach)


def _of_normals(body: Body, lane: Lane, form: Form):
    assert lane.normals is not None
    normals = body.inward(lane.normals)
    reach, (by_shape, by_normal) = jax.vmap(
        jax.value_and_grad(support, argnums=(0, 1)), (None, 1), (0, -1))(
        body.numbers, normals)
    value, slope = jax.jvp(lambda away: robust(away, lane.loss_scale, form.loss),
                           (_outside_planes(body, lane, reach),), (lane.normal_weight,))
    numbers = jnp.concatenate(jax.tree.leaves(by_shape))
    return _columns(value, numbers, by_normal, normals, -normals, -slope)


def _priors(theta, lane: Lane) -> tuple[Tensor, Array, Array]:
    """Diagonal of JᵀJ, Jᵀr and cost of the residuals that have a parameter each.

    The ridge, and one on the profile's exponent, half whose square is the exponent above its
    least: that of an exponential distribution.
    """
    ridged, profile = np.zeros((2, len(theta)))
    ridged[3:5], ridged[11:], profile[3] = 1.0, 1.0, 1.0
    share = jax.nn.sigmoid(theta[3])
    edge = lane.edge**2 * share
    half = 0.5 * (1.0 - share)
    ridge = lane.ridge**2 * ridged
    return (ridge + edge * half**2 * profile, ridge * theta + edge * half * profile,
            0.5 * (jnp.sum(ridge * theta**2) + edge))


def look(theta, lane: Lane, form: Form) -> tuple[Body, Array, Array, Array]:
    """The body; each point's distance, the normal there, and its unweighted residual."""
    body = unpack(theta, lane.rotation, form)
    local = body.local(lane.points)
    # Stored, for each of the normal's rows would else work the whole field out again.
    stored = storing(lane.points[2])
    steepest = [stored(row) for row in slopes(log_square_radius, body.shape, local)[2]]
    shorter = stored(1.0 / jnp.sqrt(sum(row**2 for row in steepest) + 1e-24))
    normal = jnp.stack([row * shorter for row in steepest])
    return (body, distance(body.shape, local), product(body.rotation, normal),
            residual(body.shape, local, form.residual))
