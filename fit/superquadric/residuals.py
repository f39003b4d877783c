"""Residuals and normal equations of one superquadric, in JAX, in a unit-scale frame."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fit.optimize.batch import vmap_cond
from fit.optimize.pieces import Span, sum_of_pieces
from fit.optimize.solver import NormalEquations, robust
from fit.optimize.xla_flags import force_materialize
from fit.superquadric.field import (
    chosen_residual,
    chosen_slopes,
    distance,
    log_square_radius,
    residual,
    slopes,
)
from fit.superquadric.parameter_vector import Body, Form, Tensor, by_parameters, product, unpack
from fit.superquadric.support import support

UPRIGHT_DOUBT = 3.0
"""Scale of the robust prior on the tilt, in its standard deviations."""


BY_POINT = ("points", "weight", "normals", "normal_weight")
"""Fields of `FitData` with a value for each touch."""


class FitData(NamedTuple):
    """Data of one fit in its unit frame. Unused optional evidence is None."""

    points: Float[Tensor, "3 point"]
    weight: Float[Tensor, " point"]
    """1/standard deviation, scaled so that the squares sum to one; 0 for padding."""
    rotation: Float[Tensor, "3 3"]
    """Orientation relative to which rotation parameters are defined."""
    loss_scale: Float[Tensor, ""]
    """Scale of the robust loss of weighted residuals."""
    ridge: Float[Tensor, ""]
    """Weight of the prior on exponents, taper and bend."""
    edge: Float[Tensor, ""]
    """Weight of the prior on e1."""
    upright: Float[Tensor, " 2"] | None = None
    """Prior that one of the body's axes is vertical: standard deviation of the tilt, and weight."""
    plane: Float[Tensor, " 5"] | None = None
    """Down direction (3), height of the table along it, weight of its residual."""
    normals: Float[Tensor, "3 point"] | None = None
    normal_weight: Float[Tensor, " point"] | None = None
    free: Float[Tensor, "5 free"] | None = None
    """Balls of free space: centre (3), radius, weight."""


def normal_equations(
    theta, data: FitData, form: Form, span: Span | None = None, kind=None
) -> NormalEquations:
    """JᵀJ, Jᵀr and cost of all residuals: points, free space, other evidence and priors.

    Residuals are differentiated by the fields of the body and their products summed, then
    `by_parameters` transforms the sums to theta. Each prior depends on one parameter. With `span`
    the fields `BY_POINT` are pieces, [slot, ..., point], of which those of the span count. `kind`
    is the residual's number in `field.KINDS`; None: that of the form.
    """
    body = unpack(theta, data.rotation, form)

    def of_touches(values):
        piece = data._replace(**values)
        raw, transform = _touch_terms(piece, form)
        local = body.local(piece.points)
        found = (slopes(raw, body.shape, local) if kind is None
                 else chosen_slopes(kind, body.shape, local))
        columns = [_point_columns(piece.points, local, found, transform)]
        if piece.normals is not None:
            columns.append(_normal_columns(body, piece, form))
        return _sums(jnp.concatenate(columns, axis=1))

    touches = {name: getattr(data, name) for name in BY_POINT}
    sums = of_touches(touches) if span is None else sum_of_pieces(of_touches, touches, span)
    columns = []
    if data.plane is not None:
        columns.append(_table_columns(body, data.plane))
    if data.upright is not None:
        columns.append(_tilt_columns(body, data.upright))
    if columns:
        sums = sums + _sums(jnp.concatenate(columns, axis=1))
    if data.free is not None:
        # Fits without free space share this program with masked balls.
        sums = sums + vmap_cond(_free_space_sums, jnp.any(data.free[4] > 0.0), body, data.free)
    sums = by_parameters(by_parameters(sums, theta, form).T, theta, form)
    stiffness, pull, energy = _priors(theta, data)
    return NormalEquations(sums[:-1, :-1] + stiffness * np.eye(len(theta)), sums[-1, :-1] + pull,
                  0.5 * sums[-1, -1] + energy)


def residual_vector(theta, data: FitData, form: Form) -> Float[Array, " residual"]:
    """The residuals of `normal_equations`, to check them."""
    body = unpack(theta, data.rotation, form)
    raw, transform = _touch_terms(data, form)
    each = [transform(raw(body.shape, body.local(data.points)))]
    if data.plane is not None:
        reach = support(body.numbers, body.inward(data.plane[:3, None])[:, 0])
        each.append(_above_table(body, data.plane, reach)[None])
    if data.upright is not None:
        each.append(_tilt(body.rotation[2], data.upright))
    if data.normals is not None:
        reach = jax.vmap(support, (None, 1))(body.numbers, body.inward(data.normals))
        each.append(robust(_outside_planes(body, data, reach), data.loss_scale, form.loss))
    if data.free is not None:
        raw, transform = _free_space_terms(data.free)
        each.append(transform(raw(body.shape, body.local(data.free[:3]))))
    edge = data.edge * jnp.sqrt(jax.nn.sigmoid(theta[3:4]))
    return jnp.concatenate([*each, data.ridge * theta[3:5], data.ridge * theta[11:], edge])


def _touch_terms(data: FitData, form: Form) -> tuple[Callable, Callable]:
    """Raw residual of touches, of (shape, local point), and its weighted robust form."""
    return (lambda shape, local: residual(shape, local, form.residual),
            lambda raw: robust(data.weight * raw, data.loss_scale, form.loss))


def _free_space_terms(free: Float[Tensor, "5 free"]) -> tuple[Callable, Callable]:
    """The same for balls of free space."""
    return distance, lambda away: free[4] * jnp.maximum(free[3] - away, 0.0)


def _free_space_sums(body: Body, free: Float[Tensor, "5 free"]):
    raw, transform = _free_space_terms(free)
    local = body.local(free[:3])
    return _sums(_point_columns(free, local, slopes(raw, body.shape, local), transform))


def _point_columns(
    places: Float[Tensor, "coordinate point"], local, found: tuple, transform: Callable
) -> Float[Array, "row point"]:
    """Derivatives of residuals at points, as `_columns`, from their `slopes` before `transform`."""
    value, by_shape, by_place = found
    value, factor = jax.jvp(transform, (value,), (jnp.ones_like(value),))
    return _columns(value, jax.tree.leaves(by_shape), by_place, local, by_place,
                    force_materialize(places[2])(factor))


def _columns(value, by_shape, by_arm, arm, by_shift, factor) -> Float[Array, "row column"]:
    """Derivatives, times a factor, by the fields of the body, by its rotation, which moves points
    or directions `arm` of its frame, and by its translation. One column per residual; rows in the
    order of `by_parameters`, and last the values."""
    (x, y, z), (dx, dy, dz) = arm, by_arm
    by_turn = [dy * z - dz * y, dz * x - dx * z, dx * y - dy * x]
    rows = [*by_shape, *by_turn, *by_shift]
    return jnp.stack([*(row * factor for row in rows), value])


def _sums(columns):
    """Sums of products of residuals and their derivatives."""
    return columns @ columns.T


def _above_table(body: Body, plane: Float[Tensor, " 5"], reach) -> Float[Array, ""]:
    """Residual of the table: the body's lowest point lies on it."""
    down, height, weight = plane[:3], plane[3], plane[4]
    return weight * (jnp.sum(down * body.position) + reach - height)


def _table_columns(body: Body, plane: Float[Tensor, " 5"]):
    down = body.inward(plane[:3, None])
    reach, (by_shape, by_down) = jax.value_and_grad(support, argnums=(0, 1))(
        body.numbers, down[:, 0])
    numbers = jnp.concatenate(jax.tree.leaves(by_shape))[:, None]
    value = _above_table(body, plane, reach)[None]
    return _columns(value, numbers, by_down[:, None], down, -down, plane[4])


def _tilt(up: Float[Array, " 3"], upright: Float[Tensor, " 2"]) -> Float[Array, " 3"]:
    """Residuals of the prior that an axis of the body is vertical; `up` is in its frame.

    They are products of two coordinates, which vanish if an axis is vertical and grow with tilt.
    """
    return _tilt_residual(up * jnp.roll(up, -1), upright)


def _tilt_residual(products, upright):
    return upright[1] * robust(products / upright[0], UPRIGHT_DOUBT, "cauchy")


def _tilt_columns(body: Body, upright: Float[Tensor, " 2"]):
    up = body.rotation[2]
    after = jnp.roll(up, -1)
    value, slope = jax.jvp(lambda products: _tilt_residual(products, upright), (up * after,),
                           (jnp.ones_like(up),))
    by_up = after * np.eye(3) + up * np.roll(np.eye(3), 1, axis=0)
    none = jnp.zeros(3, up.dtype)
    numbers = sum(len(v) for v in jax.tree.leaves(body.numbers))
    return _columns(value, [none] * numbers, by_up, up[:, None], [none] * 3, slope)


def _outside_planes(body: Body, data: FitData, reach: Float[Array, " point"]):
    """Weighted distances of touches outside the body's tangent planes with the given normals.

    The tangent plane is a point of the dual superquadric: n.(x - t) = h(n).
    """
    assert data.normals is not None
    assert data.normal_weight is not None
    along = jnp.sum(data.normals * (data.points - body.position[:, None]), axis=0)
    return data.normal_weight * (along - reach)


def _normal_columns(body: Body, data: FitData, form: Form):
    assert data.normals is not None
    normals = body.inward(data.normals)
    reach, (by_shape, by_normal) = jax.vmap(
        jax.value_and_grad(support, argnums=(0, 1)), (None, 1), (0, -1))(
        body.numbers, normals)
    value, slope = jax.jvp(lambda away: robust(away, data.loss_scale, form.loss),
                           (_outside_planes(body, data, reach),), (data.normal_weight,))
    numbers = jnp.concatenate(jax.tree.leaves(by_shape))
    return _columns(value, numbers, by_normal, normals, -normals, -slope)


def _priors(theta, data: FitData) -> tuple[Tensor, Array, Array]:
    """Diagonal of JᵀJ, Jᵀr and cost of the priors.

    They are a ridge, and an exponential distribution of e1: half the squared residual is
    proportional to e1 above its minimum.
    """
    ridged, profile = np.zeros((2, len(theta)))
    ridged[3:5], ridged[11:], profile[3] = 1.0, 1.0, 1.0
    share = jax.nn.sigmoid(theta[3])
    edge = data.edge**2 * share
    half = 0.5 * (1.0 - share)
    ridge = data.ridge**2 * ridged
    return (ridge + edge * half**2 * profile, ridge * theta + edge * half * profile,
            0.5 * (jnp.sum(ridge * theta**2) + edge))


def arms_of_normals(
    theta, rotation: Float[Tensor, "3 3"], points: Float[Tensor, "3 point"],
    normals: Float[Tensor, "3 point"], form: Form
) -> Float[Array, " point"]:
    """How far touches are from where the body's tangent plane with their normal touches it.

    An error of the normal times this is the error of `_outside_planes`.
    """
    body = unpack(theta, rotation, form)
    feet = jax.vmap(jax.grad(support, argnums=1), (None, 1), 1)(
        body.numbers, body.inward(normals))
    return jnp.sqrt(jnp.sum((feet - body.local(points)) ** 2, axis=0))


def evaluate(
    theta, rotation: Float[Tensor, "3 3"], points: Float[Tensor, "3 point"], form: Form, kind
) -> tuple[Body, Array, Array, Array]:
    """The body, and for each point its distance, normal, and unweighted residual.

    `kind` is the residual's number in `field.KINDS`, the form's own is not used.
    """
    body = unpack(theta, rotation, form)
    local = body.local(points)
    # Materialized, or XLA recomputes the whole field for each row of the normal.
    stored = force_materialize(points[2])
    steepest = [stored(row) for row in slopes(log_square_radius, body.shape, local)[2]]
    shorter = stored(1.0 / jnp.sqrt(sum(row**2 for row in steepest) + 1e-24))
    normal = jnp.stack([row * shorter for row in steepest])
    return (body, distance(body.shape, local), product(body.rotation, normal),
            chosen_residual(kind, body.shape, local))
