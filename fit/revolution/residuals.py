"""Residuals and normal equations of one surface of revolution, in JAX, in a unit-scale frame.

Parameters theta, in the frame of the start: slopes of the axis against z (2), x and y of its middle
(2), lower and upper end along z (2), logarithms of the radii.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.optimize.pieces import Span, sum_of_pieces
from fit.optimize.solver import NormalEquations, normal_equations_of, robust
from fit.revolution.record import RevolutionOptions
from fit.superquadric.parameter_vector import Tensor

BY_POINT = ("points", "weight")
"""Fields of `FitData` with a value for each touch."""
ROUNDED = 1e-14
"""Added to the square of each distance, so that it has a slope on the contour."""
EXACT_COST = ROUNDED
"""Cost of a fit, in unit frames, below which only rounding is left: where all touches lie on the
contour it is half of `ROUNDED`."""


class FitData(NamedTuple):
    """Data of one fit, in its unit frame."""

    points: Float[Tensor, "3 point"]
    weight: Float[Tensor, " point"]
    rotation: Float[Tensor, "3 3"]
    """Frame of the start; its z is the axis."""
    loss_scale: Float[Tensor, ""]
    plane: Float[Tensor, " 5"]
    """Down direction (3), height of the table along it, weight of its residual: 0 without one."""
    tilt_weight: Float[Tensor, ""]
    """Of the axis' slopes against the start's, as residuals."""
    middle: Float[Tensor, " 3"]
    """Where the axis' middle is expected across z, in the frame of the start (2), and the weight of
    that."""


class Body(NamedTuple):
    """A surface of revolution in the unit frame, with evenly spaced nodes."""

    foot: Float[Tensor, " 3"]
    axis: Float[Tensor, " 3"]
    height: Float[Array, ""]
    radius: Float[Array, " node"]


class Evaluated(NamedTuple):
    """A body beside its touches."""

    body: Body
    distance: Float[Array, " point"]
    """Signed distances of touches, positive outside."""
    touch_information: Float[Array, "parameter parameter"]
    """JᵀJ of these touches."""
    body_information: Float[Array, "parameter parameter"]
    """JᵀJ of table, smoothing and priors."""


class Nearest(NamedTuple):
    """Nearest points of the closed contour to points of the half plane (height, radius)."""

    distance: Float[Array, " point"]
    """Signed, positive outside."""
    by_height: Float[Array, " point"]
    by_radius: Float[Array, " point"]
    """Derivatives of the distance by height and radius."""
    height: Float[Tensor, " point"]
    """Height of the nearest point."""
    segment: Float[Array, " point"]
    """0 is the lower end, the last is the upper end."""
    share: Float[Array, " point"]
    """Position along the segment, 0 to 1."""


def unpack(theta, rotation: Float[Tensor, "3 3"]) -> Body:
    """The body of a parameter vector."""
    local = _direction(theta)
    axis = rotation @ local
    middle = rotation @ _middle(theta)
    height = _height(theta)
    return Body(middle - 0.5 * height * axis, axis, height, _radius(theta))


def normal_equations(
    theta, data: FitData, options: RevolutionOptions, span: Span | None = None
) -> NormalEquations:
    """JᵀJ, Jᵀr and cost. Residuals of touches are differentiated by hand.

    With `span` the fields `BY_POINT` are pieces, [slot, ..., point], of which those of the span
    count.
    """
    of_touches = lambda values: _touch_sums(theta, data._replace(**values), options)  # noqa: E731
    touches = {name: getattr(data, name) for name in BY_POINT}
    sums = of_touches(touches) if span is None else sum_of_pieces(of_touches, touches, span)
    few = _of_body(theta, data, options)
    return NormalEquations(sums[:-1, :-1] + few.matrix, sums[-1, :-1] + few.gradient,
                           0.5 * sums[-1, -1] + few.cost)


def residuals(theta, data: FitData, options: RevolutionOptions) -> Float[Array, " residual"]:
    """The residuals of `normal_equations`."""
    return jnp.concatenate(
        [_touch_rows(theta, data, options)[-1], _body_residuals(theta, data, options)])


def evaluate(theta, data: FitData, options: RevolutionOptions) -> "Evaluated":
    """What a fit's results need, of any part of its touches."""
    body = unpack(theta, data.rotation)
    s, rho, *_ = _half_plane(theta, data)
    return Evaluated(
        body, nearest_of_contour(body.height, body.radius, s, rho).distance,
        _touch_sums(theta, data, options)[:-1, :-1], _of_body(theta, data, options).matrix)


def _touch_sums(theta, data: FitData, options: RevolutionOptions):
    """Sums of products of touches' residuals and their derivatives."""
    columns = _touch_rows(theta, data, options)
    return columns @ columns.T


def _of_body(theta, data: FitData, options: RevolutionOptions) -> NormalEquations:
    """Normal equations of all but the touches."""
    return normal_equations_of(lambda t, data: _body_residuals(t, data, options))(theta, data)


def nearest_of_contour(
    height: Float[Tensor, ""], radius: Float[Array, " node"],
    s: Float[Tensor, " point"], rho: Float[Tensor, " point"],
) -> Nearest:
    """Nearest points to (`s`, `rho`), height and radius, of the contour closed by flat ends."""
    count = radius.shape[0]
    radii = jnp.concatenate([jnp.zeros(1), radius, jnp.zeros(1)])
    step = height / (count - 1)

    def along(segment, r0, r1):
        """Lower end and height of a segment, position of the nearest point, offset from it."""
        h0 = step * jnp.maximum(segment - 1.0, 0.0)
        dh = jnp.where((segment > 0.5) & (segment < count - 0.5), step, 0.0)
        dr = r1 - r0
        share = jnp.clip(((s - h0) * dh + (rho - r0) * dr) / (dh**2 + dr**2), 0.0, 1.0)
        return h0, dh, share, s - h0 - share * dh, rho - r0 - share * dr

    every = jnp.arange(count + 1.0)[:, None]
    *_, off_s, off_rho = along(every, radii[:-1, None], radii[1:, None])
    index = jnp.argmin(off_s**2 + off_rho**2, axis=0)
    segment = index.astype(radii.dtype)
    h0, dh, share, off_s, off_rho = along(segment, radii[index], radii[index + 1])
    # The side of the nearest segment is not enough: past a sharp corner it can be the wrong one.
    place = jnp.clip(s / step, 0.0, count - 1.0)
    below = jnp.minimum(jnp.floor(place), count - 2.0)
    low = below.astype(jnp.int32)
    wall = radius[low] + (place - below) * (radius[low + 1] - radius[low])
    side = jnp.where((s > 0.0) & (s < height) & (rho < wall), -1.0, 1.0)
    length = jnp.sqrt(off_s**2 + off_rho**2 + ROUNDED)
    return Nearest(side * length, side * off_s / length, side * off_rho / length,
                   h0 + share * dh, segment, share)


def _direction(theta) -> Float[Array, " 3"]:
    """The axis in the frame of the start."""
    return jnp.stack([theta[0], theta[1], jnp.ones_like(theta[0])]) / _steepness(theta)


def _steepness(theta):
    return jnp.sqrt(1.0 + theta[0] ** 2 + theta[1] ** 2)


def _middle(theta) -> Float[Array, " 3"]:
    return jnp.stack([theta[2], theta[3], 0.5 * (theta[4] + theta[5])])


def _height(theta):
    return jnp.sqrt((theta[5] - theta[4]) ** 2 + 1e-6)


def _radius(theta) -> Float[Array, " node"]:
    return jnp.exp(jnp.clip(theta[6:], -6.0, 3.0))


def _half_plane(theta, data: FitData):
    """Heights along the axis, radii, radial vectors [3, point], heights from the middle."""
    axis = _direction(theta)
    from_middle = data.rotation.T @ data.points - _middle(theta)[:, None]
    along = jnp.sum(axis[:, None] * from_middle, axis=0)
    arm = from_middle - axis[:, None] * along
    return along + 0.5 * _height(theta), jnp.sqrt(jnp.sum(arm**2, axis=0) + 1e-12), arm, along


def _touch_rows(theta, data: FitData, options: RevolutionOptions) -> Float[Array, "row point"]:
    """Derivatives by theta of the residuals of touches; the last row holds the residuals."""
    height = _height(theta)
    axis = _direction(theta)
    radius = _radius(theta)
    s, rho, (x, y, z), along = _half_plane(theta, data)
    at = nearest_of_contour(height, radius, s, rho)
    value, factor = jax.jvp(
        lambda away: robust(data.weight * away, data.loss_scale, options.loss),
        (at.distance,), (jnp.ones_like(s),))
    # Rotation of the axis about the middle, translation of the middle, change of length.
    tilt = (at.by_height - at.by_radius * along / rho) / _steepness(theta)
    out = at.by_radius / rho
    raised = -(at.by_height * axis[2] + out * z)
    longer = (at.by_height * (0.5 - at.height / height)) * (theta[5] - theta[4]) / height
    rows = [tilt * x, tilt * y, -(at.by_height * axis[0] + out * x),
            -(at.by_height * axis[1] + out * y), 0.5 * raised - longer, 0.5 * raised + longer]
    free = jnp.where((theta[6:] > -6.0) & (theta[6:] < 3.0), radius, 0.0)[:, None]
    # Hat functions: a radius moves the contour in the two segments at its node.
    hat = 1.0 - jnp.abs(at.segment + at.share - jnp.arange(1.0, radius.shape[0] + 1)[:, None])
    nodes = -at.by_radius * free * jnp.maximum(hat, 0.0)
    return jnp.concatenate([jnp.stack(rows) * factor, nodes * factor, value[None]])


def _body_residuals(theta, data: FitData, options: RevolutionOptions) -> Float[Array, " residual"]:
    """Smoothing, table, monotonicity, and priors of tilt and middle."""
    foot, axis, height, radius = unpack(theta, data.rotation)
    bow = radius[2:] - 2.0 * radius[1:-1] + radius[:-2]
    down = data.plane[:3]
    places = foot + height * jnp.linspace(0.0, 1.0, radius.shape[0])[:, None] * axis
    rim = jnp.sqrt(jnp.maximum(1.0 - (down @ axis) ** 2, 0.0) + 1e-12)
    reach = jnp.max(places @ down + rim * radius)  # of a body that lies, any node's
    parts = [options.smoothing * bow, data.plane[4] * (reach - data.plane[3])[None]]
    if options.monotone != "none":
        # Relative to the world's z; the contour follows the axis.
        rise = jnp.diff(radius) * jnp.sign(axis[2] + 1e-12)
        wrong = rise if options.monotone == "falling" else -rise
        parts.append(3.0 * jnp.maximum(wrong, 0.0))
    parts.append(data.tilt_weight * theta[0:2])
    parts.append(data.middle[2] * (theta[2:4] - data.middle[:2]))
    return jnp.concatenate(parts)
