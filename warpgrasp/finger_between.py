"""What is known of a pressed finger between the commands at which it was looked at.

A finger rests where 1/2 K |command - q|^2 + C(q) is least, C being the energy of its contacts: q is
the proximal point of the command. Where C is convex, Moreau's theorem (Proximite et dualite dans un
espace hilbertien, 1965) makes the map from the command to `command - q` firmly nonexpansive, as the
map to q is (Bauschke and Combettes, Convex analysis and monotone operator theory, 2nd edition,
propositions 4.4 and 12.28): as a command moves by d, the joints' torques K (command - q) move by an
`a` with |a|^2 <= a . K d. So `a` lies in the ball that has 0 and K d as the ends of a diameter.

Joints q not wholly at rest are at rest for another command: `q + grad C(q) / K`, which is the
command plus the gradient of the energy over K. So nothing said here asks for a finished descent.
"""

import warp as wp

from warpgrasp.finger_energy import Rest
from warpgrasp.real import HALF, ONE, ZERO, real, vec4


@wp.struct
class Ball:
    """Torques of the four joints that are possible [N m]."""

    centre: vec4
    radius: real


@wp.func
def command_met(command: vec4, rest: Rest, stiffness: real):
    """The command for which the joints of `rest`, a descent to `command`, are at rest."""
    return command + rest.gradient / stiffness


@wp.func
def torque_after(command: vec4, met: vec4, rest: Rest, stiffness: real):
    """Torques possible at `command`, where `rest` is that of the command `met`."""
    ball = Ball()
    way = (command - met) * (stiffness * HALF)
    ball.centre = (met - rest.q) * stiffness + way
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
    s = ZERO
    if square > ZERO:
        s = wp.clamp(HALF + HALF * (one.radius * one.radius - two.radius * two.radius) / square,
                     ZERO, ONE)
    ball = Ball()
    ball.centre = one.centre + apart * s
    ball.radius = wp.sqrt(wp.max(
        one.radius * one.radius * (ONE - s) + two.radius * two.radius * s - square * s * (ONE - s),
        ZERO))
    return ball


@wp.func
def command_ahead(command: vec4, met: vec4, rest: Rest, stiffness: real):
    """Joints at `command` to first order, where `rest` is that of the command `met`."""
    return rest.q + rest.compliance * ((command - met) * stiffness)
