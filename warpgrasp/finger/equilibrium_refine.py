# type: ignore  # Warp functions, which type checkers cannot follow
"""Refinement of an equilibrium, also where the energy is not smooth.

A link that lies flush on a flat face, or between two walls of a cavity, presses by the nearer of
two places (`finger_energy`). The energy has a crease where both are equally near, and Newton steps
stall there; where a link turns about a sharp edge they become short. BFGS steps with a weak Wolfe
line search converge in both cases (Lewis and Overton 2013, Nonsmooth optimization via quasi-Newton
methods). A closing passes the equilibrium at its stop to this function: if a contact place was
missed, or the gradient does not vanish, the descent continues to the least energy near by.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat44, real, vec4
from warpgrasp.finger.energy import (
    Equilibrium,
    finger_energy,
    free_equilibrium,
    largest_magnitude,
    put,
)
from warpgrasp.finger.friction import with_friction
from warpgrasp.geometry.scene import Scene, body_is_convex, body_is_estimated
from warpgrasp.geometry.segment_distance import deepest_valley
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_pose, link_direction, link_start

_PARTS = wp.constant(8)  # of an eighth of a link: half a millimetre
_FAR = wp.constant(real(1.0))  # [m]
_STIFF = wp.constant(real(1e4))  # a valley already found is not left: steps of micrometres
_ITERATIONS = wp.constant(60)
_SEARCH = wp.constant(40)
_FEW = wp.constant(10)
_ATTEMPTS = wp.constant(6)
_LEVEL = wp.constant(real(1e-6))  # slope [N m]
_NUDGE = wp.constant(real(1e-4))  # [rad]: off the crease that the first attempt starts on
_SAME = wp.constant(real(1e-12))  # [J]: found twice
_ARMIJO = wp.constant(real(1e-4))
_WOLFE = wp.constant(real(0.5))


@wp.func
def secant_compliance(compliance: mat44, step: vec4, rise: vec4):
    """The BFGS update of an inverse Hessian by a step and the change of slope along it."""
    share = ONE / wp.dot(step, rise)
    keep = wp.identity(n=4, dtype=real) - wp.outer(step, rise) * share
    return keep * compliance * wp.transpose(keep) + wp.outer(step, step) * share


@wp.func
def refined_energy(
    scene: Scene, body: int, convex: bool, hand: Hand, base: wp.transformd, command: vec4, q: vec4,
    last: Equilibrium, friction: Any
):
    """`finger_energy` and that of friction, with every valley of the distance searched.

    See `deepest_valley`. `friction` is a Friction, or NO_FRICTION. In front of a convex body there
    is one valley, the one of the `last` equilibrium.
    """
    known = free_equilibrium(last.q)
    known.along = last.along
    known.bend = last.bend
    known.depth = last.depth
    if not convex:
        f = finger_pose(hand, base, q)
        for link in range(3):
            along = deepest_valley(scene, body, link_start(f, link), link_direction(f, link),
                                   hand.link_length[link], _PARTS, hand.link_radius)
            known.along = put(known.along, link, along)
            known.bend = put(known.bend, link, _STIFF)
            known.depth = put(known.depth, link, wp.where(along < ZERO, -_FAR, ZERO))
    return with_friction(finger_energy(scene, body, hand, base, command, q, known, 0), hand.skin,
                         friction)


@wp.func
def refine_equilibrium(
    scene: Scene, body: int, hand: Hand, base: wp.transformd, command: vec4, begun: Equilibrium,
    friction: Any
):
    """The equilibrium at or below `begun`; `base` is in the body's frame. The energy never rises.

    For a body whose distance is an estimate the search is made once, with few iterations: its
    gradients are not those of its energy, so that the gradient would never vanish.
    """
    convex = body_is_convex(scene, body)
    estimated = body_is_estimated(scene, body)
    attempts = wp.where(estimated, 1, _ATTEMPTS)
    tries = wp.where(estimated, _FEW, _SEARCH)
    best = Equilibrium()
    nudge = vec4(ZERO, ZERO, ZERO, ZERO)
    for attempt in range(attempts):
        at = wp.where(attempt == 0, begun.q, best.q)
        rest = refined_energy(scene, body, convex, hand, base, command, at + nudge, begun,
                              friction)
        compliance = rest.compliance
        for _iteration in range(_ITERATIONS):
            if largest_magnitude(rest.gradient) < _LEVEL:
                break
            way = -(compliance * rest.gradient)
            fall = wp.dot(rest.gradient, way)
            share = real(1.0)
            low = real(0.0)
            high = real(-1.0)
            found = int(0)
            trial = rest
            for _try in range(tries):
                trial = refined_energy(scene, body, convex, hand, base, command,
                                     rest.q + way * share, rest, friction)
                if trial.energy >= rest.energy + _ARMIJO * share * fall:
                    high = share
                elif wp.dot(trial.gradient, way) < _WOLFE * fall:
                    low = share
                else:
                    found = int(1)
                    break
                share = wp.where(high < ZERO, share + share, (low + high) * HALF)
            if found == 0:
                break
            turned = trial.q - rest.q
            rise = trial.gradient - rest.gradient
            rest = trial
            if wp.dot(turned, rise) <= ZERO:
                break  # the step is too small to change the result
            compliance = secant_compliance(compliance, turned, rise)
        again = wp.abs(rest.energy - best.energy) < _SAME
        if attempt == 0 or rest.energy < best.energy:
            best = rest
        if largest_magnitude(best.gradient) < _LEVEL or again:
            break
        for j in range(4):
            nudge[j] = _NUDGE * real(2 * (((5 * attempt + 3) >> j) & 1) - 1)
    return best
