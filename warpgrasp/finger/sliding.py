# type: ignore  # Warp functions, which type checkers cannot follow
"""Which way a place of a finger's skin slides over what it touches, and how far friction lets the
force there lean.

A finger that is commanded further while a surface holds it keeps off the surface only by the push
that its servos yield to: of the motion that its command asks for, the part into the surface is
taken back by a push along the normal, which turns the joints as their servos are stiff. What is
left goes along the surface. A finger that stops has mostly slid: friction then holds all it can
against the motion (Coulomb), so that the force on what is touched leans along it.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import ZERO, real, vec2

LEAN_MEAN, LEAN_SIGMA = 0.9, 0.2
"""How far a force leans along the way its finger slides, mean and deviation, and the deviation
across it; shares of the coefficient [est]. Of stops of two hands on four bodies (docs/model.md)
it is 0.94, 0.14 and 0.22 where the coefficient is known; that of a skin is not."""
LEAN_UNKNOWN = 0.5
"""Deviation each way where a finger slides nowhere: of directions that fill the cone evenly."""
_LEAN_MEAN = wp.constant(real(LEAN_MEAN))
_LEAN_SIGMA = wp.constant(real(LEAN_SIGMA))
_LEAN_UNKNOWN = wp.constant(real(LEAN_UNKNOWN))
_TINY = wp.constant(real(1e-300))
STILL_M = 1e-9
"""What goes by less in a step of the command stays."""
_STILL = wp.constant(real(STILL_M))


@wp.func
def sliding_way(by_out: Any, by_one: Any, by_two: Any, way: Any, ease: Any):
    """Unit vector along which a place slides, by the two directions along the surface that go with
    its outward one; zero where it stays.

    `by_out`, `by_one` and `by_two` are its motions per radian of each joint [m/rad], `way` the
    command's last step [rad], and `ease` how far a joint yields to a torque [rad/(N m)]; both 0 of
    joints held by their stops. Joints may be counted in other units, if all five are.
    """
    yielding = wp.cw_mul(by_out, ease)
    push = wp.dot(by_out, way) / wp.max(wp.dot(by_out, yielding), _TINY)
    one = wp.dot(by_one, way) - push * wp.dot(by_one, yielding)
    two = wp.dot(by_two, way) - push * wp.dot(by_two, yielding)
    size = wp.sqrt(one * one + two * two)
    if size < _STILL:
        return vec2(ZERO, ZERO)
    return vec2(one, two) / size


@wp.func
def lean_mean(slides: vec2, friction: real):
    """How far a force leans in the mean, both ways along the surface, as a share of its push.
    `slides` is of `sliding_way`, `friction` the coefficient."""
    return slides * (_LEAN_MEAN * friction)


@wp.func
def lean_sigma(slides: vec2, friction: real):
    """Its standard deviation, the same both ways."""
    return wp.where(wp.length_sq(slides) > ZERO, _LEAN_SIGMA, _LEAN_UNKNOWN) * friction
