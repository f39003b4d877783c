"""The least-squares problem of one superquadric, in JAX: parameters in, residuals out.

Everything here is for a single fit, in a frame where the points have unit scale; `batch` makes a
batch of it. All functions are total: finite for every finite parameter vector, with finite
derivatives, since one non-finite trial step would poison a lane for ever.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

LEAST_EXPONENT, GREATEST_EXPONENT = 0.1, 2.0
TINY = 1e-12
"""Added to squared scaled coordinates: moves a surface by less than a micrometre."""
LEAST_TAPER_FACTOR = 0.02
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
    residual: Literal["solina", "radial", "distance", "volume_distance"]
    loss: Literal["none", "pseudo_huber", "cauchy", "geman_mcclure"]

    @property
    def parameters(self) -> int:
        """Number of parameters: 11, 13 or 15."""
        return 11 + 2 * self.taper + 2 * self.bend


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
    upright: Float[Tensor, ""] | None = None
    """Weight of the prior that one of the body's axes, whichever, is vertical."""
    plane: Float[Tensor, " 5"] | None = None
    """Down direction (3), height of the plane along it, weight of the support residual."""
    normals: Float[Tensor, "3 point"] | None = None
    normal_weight: Float[Tensor, " point"] | None = None
    free: Float[Tensor, "5 free"] | None = None
    """Balls known to lie outside: centre (3), radius, weight."""


class Body(NamedTuple):
    """A superquadric in the unit frame."""

    size: Float[Array, " 3"]
    exponents: Float[Array, " 2"]
    rotation: Float[Array, "3 3"]
    position: Float[Array, " 3"]
    taper: Float[Array, " 2"] | None
    bend: Float[Array, " 2"] | None
    """Curvature as a vector in the body's x, y plane, per unit length."""


def unpack(theta: Float[Array, " parameter"], rotation: Float[Tensor, "3 3"], form: Form) -> Body:
    """The body of a parameter vector.

    theta: log sizes (3), logits of the exponents (2), turn about `rotation` (3, Cayley), position
    (3), then arctanh of the taper (2) and the bend (2) where the form has them.
    """
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
    return Body(size, exponents, jnp.matmul(rotation, cayley(theta[5:8])), theta[8:11], taper, bend)


def cayley(w: Float[Array, " 3"]) -> Float[Array, "3 3"]:
    """Rotation of the quaternion (w/2, 1) normalised: rational, the identity to first order in w.

    Its only blind spot is half a turn, which no descent from a sensible start makes.
    """
    h = 0.5 * w
    skew = jnp.array([[0.0, -h[2], h[1]], [h[2], 0.0, -h[0]], [-h[1], h[0], 0.0]])
    return jnp.eye(3) + 2.0 * (skew + skew @ skew) / (1.0 + h @ h)


def log_square_radius(body: Body, points: Float[Array, "3 point"]) -> Float[Array, " point"]:
    """log F^e1 of points: twice the log of the scaled radius, 0 on the surface."""
    return _log_square_radius(body, straighten(body, points))


def _log_square_radius(body: Body, straight: Float[Array, "3 point"]):
    scaled = jnp.log((straight / body.size[:, None]) ** 2 + TINY)
    return _log_f_e1(scaled, body.exponents)


@jax.custom_jvp
def _log_f_e1(logs: Float[Array, "3 point"], exponents: Float[Array, " 2"]):
    """log F^e1 from logs of squared scaled coordinates."""
    return _log_f_e1_parts(logs, exponents)[0]


def _log_f_e1_parts(logs, exponents):
    """The value, its shares of the three coordinates, and its slopes along e1 and e2.

    log F^e1 is a soft maximum of soft maxima: its slopes along the logs are the weights of the
    soft maxima, which sum to one, and along an exponent the entropy of the weights it governs.
    """
    (lx, ly, lz), (e1, e2) = logs, exponents
    section, x_share, section_entropy = _soft_maximum(lx, ly, e2)
    value, section_share, entropy = _soft_maximum(section, lz, e1)
    shares = (section_share * x_share, section_share * (1.0 - x_share), 1.0 - section_share)
    return value, shares, (entropy, section_share * section_entropy)


def _soft_maximum(a, b, heat):
    """heat log(exp(a/heat) + exp(b/heat)), the weight of a, and the entropy of the two weights."""
    gap = (a - b) / heat
    decay = jnp.exp(-jnp.abs(gap))
    spill = jnp.log1p(decay)
    larger = 1.0 / (1.0 + decay)
    weight = jnp.where(gap > 0.0, larger, 1.0 - larger)
    entropy = spill + jnp.abs(gap) * (1.0 - larger)
    return jnp.maximum(a, b) + heat * spill, weight, entropy


@_log_f_e1.defjvp
def _log_f_e1_jvp(primals, tangents):
    value, shares, slopes = _log_f_e1_parts(*primals)
    logs, exponents = tangents
    along = shares[0] * logs[0] + shares[1] * logs[1] + shares[2] * logs[2]
    return value, along + slopes[0] * exponents[0] + slopes[1] * exponents[1]


def straighten(body: Body, points: Float[Array, "3 point"]):
    """x, y, z of points in the body's frame with bend and taper undone."""
    x, y, z = body.rotation.T @ (points - body.position[:, None])
    if body.bend is not None:
        x, y, z = _unbend(x, y, z, body.bend)
    if body.taper is not None:
        height = z / body.size[2]
        x = x / jnp.maximum(1.0 + body.taper[0] * height, LEAST_TAPER_FACTOR)
        y = y / jnp.maximum(1.0 + body.taper[1] * height, LEAST_TAPER_FACTOR)
    return jnp.stack([x, y, z])


def _unbend(x, y, z, bend):
    """The inverse of the bend (Solina and Bajcsy 1990) in a form that has a limit at k = 0."""
    k = jnp.sqrt(jnp.sum(bend**2) + 1e-18)
    turn = bend[0] * x + bend[1] * y
    outer = turn / k
    across = (k * z) ** 2
    radius = jnp.sqrt(jnp.maximum((1.0 - turn) ** 2 + across, 1e-6))
    longer = (turn * (turn - 2.0) + across) / (1.0 + radius)
    shift = (outer * longer / k + outer**2 + z**2) / (1.0 + radius)
    ahead = jnp.maximum(1.0 - turn, 0.1)
    return x - bend[0] * shift, y - bend[1] * shift, z / ahead * _arctan_ratio(k * z / ahead)


def _arctan_ratio(u):
    """arctan(u)/u, smooth through zero."""
    small = jnp.abs(u) < 1e-3
    safe = jnp.where(small, 1.0, u)
    return jnp.where(small, 1.0 - u**2 / 3.0, jnp.arctan(safe) / safe)


def support(body: Body, direction: Float[Tensor, " 3"], nodes: int = 17) -> Float[Array, ""]:
    """How far the body reaches along a world direction, from its position.

    Every section across z is a superellipse, scaled by the profile and the taper, moved and turned
    by the bend: its own support is closed-form, so the body's is a maximum over the height alone.
    Taken on a grid of the profile's angle and refined by a parabola; by the envelope theorem the
    derivative at the best height held fixed is the derivative of the support. Without taper and
    bend: [(|a1 d1|^p2 + |a2 d2|^p2)^(p1/p2) + |a3 d3|^p1]^(1/p1), p = 2/(2 - e).
    """
    d = body.rotation.T @ direction
    if body.taper is None and body.bend is None:
        return _straight_support(body, d)
    angles = jnp.linspace(-jnp.pi / 2, jnp.pi / 2, nodes)
    at = lambda angle: _section_support(body, d, angle)  # noqa: E731
    reach = jax.vmap(at)(angles)
    top = jnp.argmax(reach)
    best = jnp.clip(top, 1, nodes - 2)
    left, middle, right = reach[best - 1], reach[best], reach[best + 1]
    bow = jnp.minimum(left - 2.0 * middle + right, -1e-12)
    shift = jnp.clip(0.5 * (left - right) / bow, -1.0, 1.0)
    refined = angles[best] + shift * (angles[1] - angles[0])
    chosen = jnp.where(at(refined) >= reach[top], refined, angles[top])
    return at(jax.lax.stop_gradient(chosen))


def _straight_support(body: Body, d: Float[Array, " 3"]) -> Float[Array, ""]:
    e1, e2 = body.exponents
    p1, p2 = (2.0 / jnp.maximum(2.0 - e, 1e-3) for e in (e1, e2))
    lx, ly, lz = jnp.log((body.size * d) ** 2 + TINY)
    section = jnp.logaddexp(0.5 * p2 * lx, 0.5 * p2 * ly) / p2
    return jnp.exp(jnp.logaddexp(p1 * section, 0.5 * p1 * lz) / p1)


def _section_support(body: Body, d: Float[Array, " 3"], angle: Float[Array, ""]):
    """Reach along d (body frame) of the section at height a3 sign(sin) |sin|^e1 of the profile."""
    e1, e2 = body.exponents
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    profile = jnp.exp(0.5 * e1 * jnp.log(cos**2 + TINY))
    height = jnp.sign(sin) * jnp.exp(0.5 * e1 * jnp.log(sin**2 + TINY))
    z = body.size[2] * height
    across, centre = d[:2], z * d[2]
    if body.bend is not None:
        k = jnp.sqrt(jnp.sum(body.bend**2) + 1e-18)
        turn = k * z
        toward = body.bend @ d[:2] / k
        # Along the bend's direction the section's own axis tips out of the plane towards z.
        tip = (1.0 - jnp.cos(turn)) * toward + jnp.sin(turn) * d[2]
        across = across - tip * body.bend / k
        half = 0.5 * turn
        centre = (z * jnp.sinc(turn / jnp.pi) * d[2]
                  + half * z * jnp.sinc(half / jnp.pi) ** 2 * toward)
    widths = body.size[:2] * across
    if body.taper is not None:
        widths = widths * jnp.maximum(1.0 + body.taper * height, LEAST_TAPER_FACTOR)
    power = 2.0 / jnp.maximum(2.0 - e2, 1e-3)
    wide = jnp.exp(jnp.logaddexp(*(0.5 * power * jnp.log(widths**2 + TINY))) / power)
    return centre + profile * wide


def residuals(theta, lane: Lane, form: Form) -> Float[Array, " residual"]:
    """All residuals of one fit: points, then each piece of evidence, then the ridge."""
    body = unpack(theta, lane.rotation, form)
    parts = [robust(lane.weight * point_residual(body, lane.points, form), lane.loss_scale, form)]
    if lane.plane is not None:
        down, height, weight = lane.plane[:3], lane.plane[3], lane.plane[4]
        parts.append(weight * (down @ body.position + support(body, down) - height)[None])
    if lane.upright is not None:
        u = body.rotation[2]
        # The products vanish exactly where one axis is vertical, and grow with the tilt.
        parts.append(lane.upright * jnp.stack([u[0] * u[1], u[1] * u[2], u[2] * u[0]]))
    if lane.normals is not None and lane.normal_weight is not None:
        # The tangent plane at a touch is a plane of the dual superquadric: n.(x - t) = h(n).
        reach = jax.vmap(lambda n: support(body, n), in_axes=1)(lane.normals)
        along = jnp.sum(lane.normals * (lane.points - body.position[:, None]), axis=0)
        parts.append(robust(lane.normal_weight * (along - reach), lane.loss_scale, form))
    if lane.free is not None:
        centre, radius, weight = lane.free[:3], lane.free[3], lane.free[4]
        parts.append(weight * jnp.maximum(radius - distance(body, centre), 0.0))
    parts.append(lane.ridge * jnp.concatenate([theta[3:5], theta[11:]]))
    return jnp.concatenate(parts)


def point_residual(body: Body, points, form: Form) -> Float[Array, " point"]:
    """Unweighted residual of points, in units of the frame.

    solina: sqrt(a1 a2 a3) (F^e1 - 1), whose volume factor prefers the least body that explains the
    touches (Solina and Bajcsy 1990); radial: distance along the ray from the centre;
    distance: that along the surface normal, to first order; volume_distance: the latter with
    Solina's volume factor, which serves tapered bodies, for near the tip of a taper F^e1 grows so
    fast that a touch there counts for many.
    """
    if form.residual == "solina":
        log_square = jnp.clip(log_square_radius(body, points), -30.0, 8.0)
        return jnp.sqrt(jnp.prod(body.size)) * jnp.expm1(log_square)
    if form.residual == "radial":
        straight = straighten(body, points)
        length = jnp.sqrt(jnp.sum(straight**2, axis=0) + TINY)
        return -length * jnp.expm1(-0.5 * _log_square_radius(body, straight))
    away = distance(body, points)
    if form.residual == "distance":
        return away
    return 2.0 * jnp.sqrt(jnp.prod(body.size)) * away


def distance(body: Body, points) -> Float[Array, " point"]:
    """Signed distance along the normal to first order: (beta - 1)/|grad beta|, beta the radius.

    Without taper beta is convex for exponents up to 2, so outside this never exceeds the distance.
    The gradient is that before the bend, which turns it and hardly stretches it.
    """
    straight = straighten(body, points)
    scaled = jnp.log((straight / body.size[:, None]) ** 2 + TINY)
    log_square, shares, _ = _log_f_e1_parts(scaled, body.exponents)
    x, y, z = straight
    gx, gy, gz = (share * c / (c**2 + TINY * a**2)
                  for share, c, a in zip(shares, straight, body.size, strict=True))
    if body.taper is not None:
        factors = 1.0 + body.taper[:, None] * (z / body.size[2])
        kx, ky = jnp.where(factors > LEAST_TAPER_FACTOR, body.taper[:, None], 0.0)
        fx, fy = jnp.maximum(factors, LEAST_TAPER_FACTOR)
        gx, gy = gx / fx, gy / fy
        gz = gz - (gx * x * kx + gy * y * ky) / body.size[2]
    slope = jnp.sqrt(gx**2 + gy**2 + gz**2 + TINY)
    return -jnp.expm1(-0.5 * jnp.clip(log_square, -8.0, 30.0)) / slope


def log_radius_gradient(body: Body, points) -> Float[Array, "3 point"]:
    """Gradient of log beta in the world: an outward normal, of length 1/distance-per-log."""
    single = lambda p: 0.5 * log_square_radius(body, p[:, None])[0]  # noqa: E731
    return jax.vmap(jax.grad(single), in_axes=1, out_axes=1)(points)


def robust(r, scale, form: Form):
    """r reshaped so that half its square is the robust loss of r: still plain least squares."""
    if form.loss == "none":
        return r
    z = (r / scale) ** 2
    if form.loss == "geman_mcclure":
        return r / jnp.sqrt(1.0 + z)
    small = z < 1e-6
    safe = jnp.where(small, 1.0, z)
    if form.loss == "cauchy":
        ratio = jnp.log1p(safe) / safe
        return r * jnp.sqrt(jnp.where(small, 1.0 - 0.5 * z, ratio))
    ratio = 2.0 * (jnp.sqrt(1.0 + safe) - 1.0) / safe
    return r * jnp.sqrt(jnp.where(small, 1.0 - 0.25 * z, ratio))
