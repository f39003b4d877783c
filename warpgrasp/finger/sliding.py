# type: ignore  # Warp functions, which type checkers cannot follow
"""How the force on a place of a finger's skin leans, by friction, when its command goes further.

A finger that is commanded further while a surface holds it yields as its servos are stiff. Of the
motion that its command asks of the place, a push along the normal takes back what goes into the
surface, and friction what goes along it, as far as it can (Coulomb). If the force that takes back
all of it lies within the friction cone, the place sticks, and the force leans as that one does.
Otherwise the force lies on the edge of the cone and leans along the way that the place then slides.
Step by step force and motion grow alike, so this holds from the first touch on.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, struct, vec2, vec3

LEAN_MOST, LEAN_SIGMA = 0.9, 0.2
"""How far a force that slides leans, mean and deviation; shares of the coefficient [est]. Where the
coefficient is known all lie on the edge of the cone; that of a skin is not."""
LEAN_ASIDE = 0.1
"""Deviation of any force across the way it leans, and along it of one that sticks [est]."""
LEAN_UNKNOWN = 0.5
"""Deviation each way where a finger goes nowhere: of directions that fill the cone evenly."""
STILL_M = 1e-9
"""What goes by less in a step of the command stays."""
FLAT = 1e-7
"""Share of how far a place yields along the surface that it yields at least, each way, and its
square outwards: a finger of two joints does not go across at all."""
LEAST = 1e-3
"""Least share of its push without friction that a place is taken to be pushed by, sliding."""
STEPS = 3
"""Newton's steps to the force of a place that slides, right to some 0.03 of the cone."""
_LEAN_MOST = wp.constant(real(LEAN_MOST))
_LEAN_SIGMA = wp.constant(real(LEAN_SIGMA))
_LEAN_ASIDE = wp.constant(real(LEAN_ASIDE))
_LEAN_UNKNOWN = wp.constant(real(LEAN_UNKNOWN))
_STILL = wp.constant(real(STILL_M))
_FLAT = wp.constant(real(FLAT))
_STEPS = wp.constant(STEPS)
_TINY = wp.constant(real(1e-300))
_LEAST = wp.constant(real(LEAST))


@struct
class Lean:
    """How far a force leans both ways along the surface, as shares of its push."""

    mean: vec2
    along: vec2
    """One standard deviation along the way it leans."""
    across: vec2
    """One across that way."""


@struct
class _Sideways:
    """How a place goes along the surface while a push keeps it out of it."""

    push: real
    """Takes back all of the command's step into the surface, without friction [N]."""
    tilt: vec2
    """How much less push it takes for each newton along the surface, both ways."""
    slides: vec2
    """Motion without friction [m]."""
    one: real
    both: real
    two: real
    """How far it yields: to a force one way, the other way by that force, and the other way [m/N].
    """


@wp.func
def _sideways(by_out: Any, by_one: Any, by_two: Any, way: Any, ease: Any):
    """With arguments as `force_lean`: the part along the normal taken out (a Schur complement)."""
    side = _Sideways()
    yielding = wp.cw_mul(by_out, ease)
    one = wp.dot(by_one, wp.cw_mul(by_one, ease))
    two = wp.dot(by_two, wp.cw_mul(by_two, ease))
    flat = _FLAT * (one + two) + _TINY
    easy = ONE / (wp.dot(by_out, yielding) + _FLAT * flat + _TINY)
    into = wp.dot(by_out, way)
    pull = vec2(wp.dot(by_one, yielding), wp.dot(by_two, yielding))
    side.push = into * easy
    side.tilt = pull * easy
    side.slides = vec2(wp.dot(by_one, way), wp.dot(by_two, way)) - side.tilt * into
    side.one = one - side.tilt[0] * pull[0] + flat
    side.both = wp.dot(by_two, wp.cw_mul(by_one, ease)) - side.tilt[0] * pull[1]
    side.two = two - side.tilt[1] * pull[1] + flat
    return side


@wp.func
def _passing(side: _Sideways, slip: real, motion: vec2):
    """The force along the surface at which a motion passes where each newton also lets `slip` [m]
    pass, times the determinant of how far the place yields then, and that determinant."""
    one = side.one + slip
    two = side.two + slip
    return vec3(two * motion[0] - side.both * motion[1], one * motion[1] - side.both * motion[0],
                one * two - side.both * side.both)


@wp.func
def force_lean(by_out: Any, by_one: Any, by_two: Any, way: Any, ease: Any, friction: real):
    """How the force on what a place touches leans, as a `Lean`.

    `by_out`, `by_one` and `by_two` are the motions of the place per radian of each joint [m/rad],
    outwards and both ways along the surface, `way` is the command's last step [rad], and `ease` how
    far a joint yields to a torque [rad/(N m)]; both 0 of joints held by their stops. Joints may be
    counted in other units, if all five are. `friction` is the coefficient.
    """
    lean = Lean()
    side = _sideways(by_out, by_one, by_two, way, ease)
    if wp.length(side.slides) < _STILL:
        lean.along = vec2(_LEAN_UNKNOWN * friction, ZERO)
        lean.across = vec2(ZERO, _LEAN_UNKNOWN * friction)
        return lean
    cone = _LEAN_MOST * friction
    sigma = _LEAN_SIGMA * friction
    aside = _LEAN_ASIDE * friction
    # Pushed from elsewhere it slides as if there were no friction.
    lean.mean = wp.normalize(side.slides) * cone
    if side.push > ZERO:
        held = _passing(side, ZERO, side.slides)
        force = vec2(held[0], held[1])
        push = side.push * held[2] - wp.dot(side.tilt, force)
        if wp.length(force) <= cone * push:
            lean.mean = force / push
            sigma = aside
        else:
            slip = real(0.0)
            for _ in range(_STEPS):
                # Newton's method makes one over this force like one over what the cone allows.
                size = wp.length(force)
                ahead = force / size
                wanted = wp.max(ONE + cone * wp.dot(side.tilt, ahead), _LEAST) / (cone * side.push)
                less = _passing(side, slip, ahead)
                shrinks = ahead[0] * less[0] + ahead[1] * less[1]
                turns = wp.dot(side.tilt, vec2(less[0], less[1]) - ahead * shrinks) / side.push
                slope = less[2] * shrinks / size
                slope = wp.max(slope + turns, HALF * slope)
                slip = wp.max(slip + less[2] * (wanted - less[2] / size) / slope, ZERO)
                held = _passing(side, slip, side.slides)
                force = vec2(held[0], held[1])
            lean.mean = wp.normalize(force) * cone
    ahead = vec2(ONE, ZERO)
    if wp.length_sq(lean.mean) > ZERO:
        ahead = wp.normalize(lean.mean)
    lean.along = ahead * sigma
    lean.across = vec2(-ahead[1], ahead[0]) * aside
    return lean
