# type: ignore  # Warp functions, which type checkers cannot follow
"""The places of a finger's skin that a contact is looked for at, and how well a force at each of
them explains the torques felt.
"""

import numpy as np
import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, vec2, vec3
from warpgrasp.finger.sliding import Lean

ALONG, AROUND, CAP = 24, 13, 5
"""Places along a link, around its palmar half, and rings of the tip's cap."""
_ALONG = wp.constant(ALONG)
_STEP = wp.constant(real(1.0 / ALONG))
_around_vec = wp.types.vector(length=AROUND, dtype=real)
_cap_vec = wp.types.vector(length=CAP, dtype=real)
_TURNS = np.pi * ((np.arange(AROUND) + 0.5) / AROUND - 0.5)
_UPS = 0.5 * np.pi * (np.arange(CAP) + 0.5) / CAP
AROUND_COS = wp.constant(_around_vec(*np.cos(_TURNS)))
AROUND_SIN = wp.constant(_around_vec(*np.sin(_TURNS)))
CAP_COS = wp.constant(_cap_vec(*np.cos(_UPS)))
CAP_SIN = wp.constant(_cap_vec(*np.sin(_UPS)))
LEANS = 5
"""Forces tried where there is friction: the one that leans as in the mean, and four about it."""
_lean_vec = wp.types.vector(length=LEANS, dtype=real)
# Together they have a deviation of one each way.
_LEAN = np.sqrt(2 * LEANS / (LEANS - 1))
_LEAN_ANGLES = 2 * np.pi * np.arange(LEANS - 1) / (LEANS - 1)
_LEAN_ALONG = wp.constant(_lean_vec(0.0, *(_LEAN * np.cos(_LEAN_ANGLES))))
_LEAN_ACROSS = wp.constant(_lean_vec(0.0, *(_LEAN * np.sin(_LEAN_ANGLES))))
LEAST_SWEPT_M = 1e-3
"""Places that go outwards by less per radian of the command, or inwards, count as this: another
finger or the arm may have pushed them [est]."""
_LEAST_SWEPT = wp.constant(real(LEAST_SWEPT_M))


@wp.func
def force_gain(square: real, along: real, least: real):
    """The share of the weighted square of the torques that a force of the best size >= 0 explains.

    `square` is that of the torques of a unit force, `least` where they count as none, and `along`
    their product with the measured ones.
    """
    push = wp.max(along, ZERO)
    return push * push / wp.max(square, least)


@wp.func
def force_gain_at(square: vec3, along: vec2, share: real, least: real):
    """The gain of a force at a place along a link: torques are linear in the place."""
    return force_gain(square[0] + share * (square[1] + share * square[2]),
                      along[0] + share * along[1], least)


@wp.func
def swept_share(outwards: real, turned: real):
    """What skin sweeps that goes `outwards` [m] for a step of the command that turns joints by
    `turned` [rad]; the same everywhere where it turns none."""
    return wp.where(turned > ZERO, wp.max(outwards, turned * _LEAST_SWEPT), ONE)


@wp.func
def lean_tried(lean: Lean, number: int):
    """How far one of the forces tried leans, both ways along the surface, as a share of its push.
    """
    return (lean.mean + lean.along * real(_LEAN_ALONG[number])
            + lean.across * real(_LEAN_ACROSS[number]))


@wp.func
def _peak(square: vec3, along: vec2):
    """Where along the link the derivative of along^2 / square vanishes; 0 if nowhere between."""
    top = along[0] * square[1] - real(2.0) * along[1] * square[0]
    bottom = along[1] * square[1] - real(2.0) * along[0] * square[2]
    if top * bottom > ZERO and wp.abs(top) < wp.abs(bottom):
        return top / bottom
    return ZERO


@wp.func
def most_force_gain(square: vec3, along: vec2, least: real):
    """The largest gain of any place along the link."""
    most = wp.max(force_gain_at(square, along, ZERO, least),
                  force_gain_at(square, along, ONE, least))
    return wp.max(most, force_gain_at(square, along, _peak(square, along), least))


@wp.func
def most_placed_gain(square: vec3, along: vec2, least: real):
    """The largest gain of the grid's places along the link: those at its ends, or next to the peak,
    of which one may be a force that turns no joint."""
    most = wp.max(force_gain_at(square, along, HALF * _STEP, least),
                  force_gain_at(square, along, ONE - HALF * _STEP, least))
    first = int(wp.floor(_peak(square, along) / _STEP - HALF)) - 1
    for i in range(4):
        share = (real(wp.clamp(first + i, 0, _ALONG - 1)) + HALF) * _STEP
        most = wp.max(most, force_gain_at(square, along, share, least))
    return most
