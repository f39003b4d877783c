# type: ignore  # Warp functions, which type checkers cannot follow
"""Bounds on the joint torques of a pressed finger between commands with a known equilibrium.

The equilibrium minimises 1/2 K |command - q|^2 + C(q), with C the contact energy: q is the proximal
point of the command. Where C is convex, the map from the command to `command - q` is firmly
nonexpansive (Moreau 1965, Proximite et dualite dans un espace hilbertien; Bauschke and Combettes,
Convex analysis and monotone operator theory, 2nd edition, propositions 4.4 and 12.28). When a
command moves by d, the torques K (command - q) move by an `a` with |a|^2 <= a . K d: `a` lies in
the ball with 0 and K d as the ends of a diameter.

A link that bears on an edge or a round wall is not quite convex: it can slip off as it turns, and
torques fall while the joints move on. The weight of links is not either. Torques may therefore
change against the joints by a share s of the stiffness, a . e >= -s K |e|^2 for joints that move by
e = d - a / K. With the square completed, `a` lies in a ball about c K d of the radius r K |d|, with
c = (1 - 2 s) / (2 - 2 s) and r^2 = s / (1 - s) + c^2. That is allowed for where a joint is held by
its stop, and the finger can but slip sideways; elsewhere s is 0. Two equilibria that lie outside
show that something slips (`agree`).
"""

from math import sqrt

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, greater, real, struct, vec2, vec4
from warpgrasp.core.random_kernel import counter_key, counter_uniform
from warpgrasp.finger.energy import Equilibrium
from warpgrasp.mechanism.tendon_kernel import (
    TendonSensor,
    moving_sign,
    tendon_tensions,
    tension_difference_read,
    tension_noise,
    tension_sum,
)
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, beyond_stops

_AGAINST_SHARE = 0.1
_CENTRE_SHARE = (1.0 - 2.0 * _AGAINST_SHARE) / (2.0 - 2.0 * _AGAINST_SHARE)
_AGAINST = wp.constant(real(_AGAINST_SHARE))  # of the joints' stiffness
_CENTRE = wp.constant(real(_CENTRE_SHARE))
_RADIUS = wp.constant(real(sqrt(_AGAINST_SHARE / (1.0 - _AGAINST_SHARE) + _CENTRE_SHARE**2)))
_SLACK = wp.constant(real(1e-9))  # [N m rad], of rests that are not quite level


@struct
class Ball:
    """Torques of the four joints that are possible [N m]."""

    centre: vec4
    radius: real


@wp.func
def bound_shares(hand: Hand, rest: Equilibrium):
    """Centre and radius of the ball of `torque_bound` from an equilibrium, in parts of K |d|."""
    past = beyond_stops(hand, rest.q)
    if wp.dot(past, past) > ZERO:
        return vec2(_CENTRE, _RADIUS)
    return vec2(HALF, HALF)


@wp.func
def torque_bound(command: vec4, rest: Equilibrium, other: vec4, stiffness: real, shares: vec2):
    """Possible torques at another command, from the equilibrium `rest` at `command`, whose
    `bound_shares` are given."""
    ball = Ball()
    way = (other - command) * stiffness
    ball.centre = (command - rest.q) * stiffness + way * shares[0]
    ball.radius = wp.length(way) * shares[1]
    return ball


@wp.func
def intersect_balls(one: Ball, two: Ball):
    """The smallest ball around the intersection of two balls.

    For s in [0, 1] the sum of |a - c1|^2 <= r1^2 and |a - c2|^2 <= r2^2, weighted 1 - s and s, is a
    ball round (1 - s) c1 + s c2 of radius^2 (1 - s) r1^2 + s r2^2 - s (1 - s) |c1 - c2|^2.
    """
    apart = two.centre - one.centre
    square = wp.dot(apart, apart)
    here = one.radius * one.radius
    there = two.radius * two.radius
    s = ZERO
    if square > ZERO:
        s = wp.clamp(HALF + HALF * (here - there) / square, ZERO, ONE)
    ball = Ball()
    ball.centre = one.centre + apart * s
    ball.radius = wp.sqrt(greater(here * (ONE - s) + there * s - square * s * (ONE - s), ZERO))
    return ball


@wp.func
def agree(command: vec4, rest: Equilibrium, other: vec4, other_rest: Equilibrium, stiffness: real):
    """Whether two equilibria are consistent with a nearly convex contact energy."""
    turn = other_rest.q - rest.q
    rise = (other - command - turn) * stiffness
    return wp.dot(rise, turn) >= -_AGAINST * stiffness * wp.dot(turn, turn) - _SLACK


@wp.func
def predict_joints(command: vec4, rest: Equilibrium, other: vec4, stiffness: real):
    """Joints at another command to first order, from the equilibrium `rest` at `command`."""
    return rest.q + rest.compliance * ((other - command) * stiffness)


_SIXTH = wp.constant(real(1.0 / 6.0))
_THIRTYSECOND = wp.constant(real(1.0 / 32.0))


@wp.func
def _surely_below(sensor: TendonSensor, pull: real, moving: real, noise: wp.uint64):
    """Whether a joint's reading certainly stays below the threshold; `pull` [N] is its true value.

    Friction adds to it where tendons move. The absolute value of a Box-Muller normal is at most
    sqrt(-2 log u), so that neither a root nor a cosine is needed; exp(-x), with which u is
    compared, is replaced by the first terms of exp(x / 4) to the fourth power.
    """
    rub = wp.abs(moving) * sensor.friction * tension_sum(sensor, pull)
    margin = sensor.threshold - sensor.step - rub - pull
    if margin <= ZERO or sensor.noise <= ZERO:
        return margin > ZERO
    x = margin * margin * (_THIRTYSECOND / (sensor.noise * sensor.noise))
    e = ONE + x * (ONE + x * (HALF + x * _SIXTH))
    least = wp.min(counter_key(counter_key(noise, 0), 1), counter_key(counter_key(noise, 1), 1))
    return counter_uniform(least) * (e * e) * (e * e) >= ONE


@wp.func
def stop_reading(sensor: TendonSensor, torque: vec4, delta: vec4, key: wp.uint64):
    """The largest absolute tendon difference of the flexion joints [N], one reading of each.

    `delta` is the last step of the command. Readings certain to stay below the threshold are left
    out.
    """
    largest = real(0.0)
    for j in range(1, 4):
        moving = moving_sign(delta[j])
        noise = counter_key(key, j)
        if not _surely_below(sensor, wp.abs(torque[j]) * sensor.per_torque[j], moving, noise):
            d = tension_difference_read(
                sensor, tendon_tensions(sensor, j, torque[j], moving), tension_noise(noise))
            if wp.abs(d) > wp.abs(largest):
                largest = d
    return largest


@wp.func
def may_stop(sensor: TendonSensor, torque: Ball, delta: vec4, key: wp.uint64):
    """Whether a torque inside the ball would make the same reading stop the finger.

    A reading is monotonic in the torque, so that the ends of the interval decide.
    """
    for j in range(1, 4):
        moving = moving_sign(delta[j])
        noise = counter_key(key, j)
        centre = torque.centre[j]
        if not _surely_below(sensor, (wp.abs(centre) + torque.radius) * sensor.per_torque[j],
                             moving, noise):
            drawn = tension_noise(noise)
            low = tendon_tensions(sensor, j, centre - torque.radius, moving)
            high = tendon_tensions(sensor, j, centre + torque.radius, moving)
            if tension_difference_read(sensor, high, drawn) > sensor.threshold:
                return True
            if tension_difference_read(sensor, low, drawn) < -sensor.threshold:
                return True
    return False
