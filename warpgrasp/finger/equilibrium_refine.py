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

from warpgrasp.core.dtypes import HALF, ZERO, real
from warpgrasp.finger.chain_energy import (
    largest_magnitude,
    refined_energy,
    secant_compliance,
)
from warpgrasp.geometry.scene import Scene, body_is_convex

_ITERATIONS = wp.constant(60)
_SEARCH = wp.constant(40)
_ATTEMPTS = wp.constant(6)
_LEVEL = wp.constant(real(1e-6))  # slope [N m]
_NUDGE = wp.constant(real(1e-4))  # [rad]: off the crease that the first attempt starts on
_SAME = wp.constant(real(1e-12))  # [J]: found twice
_ARMIJO = wp.constant(real(1e-4))
_WOLFE = wp.constant(real(0.5))


@wp.func(inline=False)
def refine_equilibrium(
    scene: Scene, body: int, hand: Any, base: wp.transformd, command: Any, begun: Any,
    friction: Any
):
    """The equilibrium at or below `begun`; `base` is in the body's frame. The energy never rises.

    `hand` is a Hand, and `begun` its Equilibrium; or a Chain, and its ChainRest.
    """
    convex = body_is_convex(scene, body)
    best = begun
    nudge = begun.q - begun.q
    for attempt in range(_ATTEMPTS):
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
            for _try in range(_SEARCH):
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
        for j in range(len(nudge)):
            nudge[j] = _NUDGE * real(2 * (((5 * attempt + 3) >> j) & 1) - 1)
    return best
