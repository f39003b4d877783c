# type: ignore  # Warp functions, which type checkers cannot follow
"""What is known of a pressed finger between the commands at which it was looked at.

A finger rests where 1/2 K |command - q|^2 + C(q) is least, C being the energy of its contacts: q is
the proximal point of the command. Where C is convex, Moreau's theorem (Proximite et dualite dans un
espace hilbertien, 1965) makes the map from the command to `command - q` firmly nonexpansive, as the
map to q is (Bauschke and Combettes, Convex analysis and monotone operator theory, 2nd edition,
propositions 4.4 and 12.28): where a command moves by d, the torques K (command - q) of the joints
move by an `a` with |a|^2 <= a . K d. So `a` lies in the ball that has 0 and K d as the ends of a
diameter.

A link that bears on an edge or a round wall is not quite convex: as it turns it can slip away. Then
torques fall while joints move on. Two rests show it: `agree` asks whether torques change against
the joints by no more than a share of their stiffness.
"""

import warp as wp

from warpgrasp.closing.energy import Rest
from warpgrasp.core.dtypes import HALF, ONE, ZERO, greater, real, struct, vec4
from warpgrasp.core.random_kernel import counter_key, counter_uniform
from warpgrasp.mechanism.tendon_kernel import (
    TendonSensor,
    moving_sign,
    tendon_tensions,
    tension_difference_read,
    tension_noise,
)
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand

_AGAINST = wp.constant(real(0.2))  # of the joints' stiffness
_SLACK = wp.constant(real(1e-9))  # [N m rad], of rests that are not quite level


@struct
class Ball:
    """Torques of the four joints that are possible [N m]."""

    centre: vec4
    radius: real


@wp.func
def torque_after(command: vec4, rest: Rest, other: vec4, stiffness: real):
    """Torques possible at another command, where `rest` is that of `command`."""
    ball = Ball()
    way = (other - command) * (stiffness * HALF)
    ball.centre = (command - rest.q) * stiffness + way
    ball.radius = wp.length(way)
    return ball


@wp.func
def in_both(one: Ball, two: Ball):
    """The least ball around what two balls share.

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
def agree(command: vec4, rest: Rest, other: vec4, other_rest: Rest, stiffness: real):
    """Whether two rests are as an all but convex energy has them."""
    turn = other_rest.q - rest.q
    rise = (other - command - turn) * stiffness
    return wp.dot(rise, turn) >= -_AGAINST * stiffness * wp.dot(turn, turn) - _SLACK


@wp.func
def joints_ahead(command: vec4, rest: Rest, other: vec4, stiffness: real):
    """Joints at another command to first order, where `rest` is that of `command`."""
    return rest.q + rest.compliance * ((other - command) * stiffness)


_SIXTH = wp.constant(real(1.0 / 6.0))
_THIRTYSECOND = wp.constant(real(1.0 / 32.0))


@wp.func
def _surely_below(sensor: TendonSensor, pull: real, moving: real, noise: wp.uint64):
    """Whether a joint's reading surely stays below the threshold; `pull` [N] is its true size.

    Friction adds to it where tendons move. A normal of Box and Muller is at most sqrt(-2 log u) by
    size, and u takes no root or cosine; for exp(-x), which u is compared with, the first terms of
    exp(x / 4) to the fourth do.
    """
    margin = sensor.threshold - sensor.step - wp.abs(moving) * sensor.rub - pull
    if margin <= ZERO or sensor.noise <= ZERO:
        return margin > ZERO
    x = margin * margin * (_THIRTYSECOND / (sensor.noise * sensor.noise))
    e = ONE + x * (ONE + x * (HALF + x * _SIXTH))
    least = wp.min(counter_key(counter_key(noise, 0), 1), counter_key(counter_key(noise, 1), 1))
    return counter_uniform(least) * (e * e) * (e * e) >= ONE


@wp.func
def stop_reading(
    hand: Hand, sensor: TendonSensor, torque: vec4, delta: vec4, key: wp.uint64
):
    """The largest tendon difference of the flexion joints in one reading of each [N], by size.

    `delta` is the command's last move. Readings that are sure to stay below the threshold are left
    out.
    """
    largest = real(0.0)
    for j in range(1, 4):
        moving = moving_sign(delta[j])
        noise = counter_key(key, j)
        if not _surely_below(sensor, wp.abs(torque[j]) * sensor.per_torque[j], moving, noise):
            d = tension_difference_read(
                sensor, tendon_tensions(hand, j, torque[j], moving), tension_noise(noise))
            if wp.abs(d) > wp.abs(largest):
                largest = d
    return largest


@wp.func
def may_stop(hand: Hand, sensor: TendonSensor, torque: Ball, delta: vec4, key: wp.uint64):
    """Whether some of the torques possible would have that same reading stop the finger.

    A reading rises with the torque, so the ends of what is possible tell.
    """
    for j in range(1, 4):
        moving = moving_sign(delta[j])
        noise = counter_key(key, j)
        centre = torque.centre[j]
        if not _surely_below(sensor, (wp.abs(centre) + torque.radius) * sensor.per_torque[j],
                             moving, noise):
            drawn = tension_noise(noise)
            low = tendon_tensions(hand, j, centre - torque.radius, moving)
            high = tendon_tensions(hand, j, centre + torque.radius, moving)
            if tension_difference_read(sensor, high, drawn) > sensor.threshold:
                return True
            if tension_difference_read(sensor, low, drawn) < -sensor.threshold:
                return True
    return False
