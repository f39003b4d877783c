# type: ignore  # Warp functions, which type checkers cannot follow
"""The equilibrium of a finger: the least energy of its servos and its skin.

Newton steps on the Gauss-Newton Hessian of `finger_energy` with backtracking, so that the energy
never rises. Each link stays in the valley of the distance in which it lies. At a stop the
equilibrium is refined (`equilibrium_refine`).

- A link that a step would press counts as pressed. Otherwise a finger that has just lost its
  contact would move to its command, deep inside the body, and return by halves.
- Along an edge Newton steps are too short, since the energy curves less there than its Hessian
  says. They are lengthened by Anderson acceleration of depth one (Walker and Ni 2011, Anderson
  acceleration for fixed-point iterations), as long as the energy falls.
- A last step that is small enough is taken without another evaluation.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real
from warpgrasp.finger.chain_energy import (
    finger_energy,
    finger_length,
    largest_magnitude,
    loosened,
    with_friction,
)
from warpgrasp.geometry.scene import Scene

_ITERATIONS = wp.constant(30)
_HALVINGS = wp.constant(12)
_GRADIENT = wp.constant(real(1e-6))  # [N m]; 0.2 mN on a tendon, a 300th of the converter's step
_LAST = wp.constant(real(2e-5))  # [rad]; to a tendon's reading a tenth of a converter's step
_STILL = wp.constant(real(1e-7))  # [rad]; less is not halved again
_CREEP = wp.constant(real(0.1))  # share of a step gained by it; a right Hessian gains all
_JOINTS = wp.constant(real(4.0))  # each turns all of the finger beyond it


@wp.func
def joints_toward(rest: Any, torque: Any, skin: real):
    """How far joints go to first order by a torque on them [N m], a link that is near included."""
    way = rest.compliance * torque
    bite = rest.near_depth - wp.dot(rest.near, way)
    if bite > ZERO:
        yields = rest.compliance * rest.near
        way += yields * (bite / (ONE / skin + wp.dot(rest.near, yields)))
    return way


@wp.func(inline=False)
def finger_equilibrium(
    scene: Scene, body: int, hand: Any, base: wp.transformd, command: Any, start: Any, last: Any,
    samples: int, friction: Any
):
    """The equilibrium for a command, from `start`; `base` is in the body's frame.

    `hand` is a Hand, and `last` its Equilibrium; or a Chain, and its ChainRest.

    The valleys of the distance are chosen at the start, with `samples` compared, and followed from
    there. `friction` is a Friction, or NO_FRICTION. After a last step without evaluation, energy,
    gradient and compliance are those before it, and depths are upper bounds.
    """
    rest = last
    step = start - last.q
    way = start - start
    scale = real(1.0)
    level = real(0.0)  # of the iteration before
    halvings = int(0)
    plain = int(1)
    for k in range(_ITERATIONS):
        trial = with_friction(finger_energy(
            scene, body, hand, base, command, rest.q + step * scale, rest,
            wp.where(k == 0, samples, 0)), hand.skin, friction)
        halvings += 1
        scale = scale * HALF
        if k == 0 or trial.energy < rest.energy:
            turned = trial.q - rest.q
            rest = trial
            halvings = int(0)
            scale = real(1.0)
            step = joints_toward(rest, -rest.gradient, hand.skin)
            level_before = level
            level = largest_magnitude(rest.gradient)
            last_step = largest_magnitude(step)
            if level < _GRADIENT or (
                    last_step < _LAST and level * level < _GRADIENT * level_before):
                rest.q += step
                rest = loosened(rest, last_step * _JOINTS * finger_length(hand))
                break
            change = step - way
            plain = int(1)
            way = step
            # How much of a step is gained by going it: 1 where the Hessian is right.
            share = -wp.dot(change, turned) / wp.dot(turned, turned)
            if k >= 2 and share > _CREEP and share < ONE - _CREEP:
                step -= (turned + change) * (wp.dot(step, change) / wp.dot(change, change))
                plain = int(0)
        elif plain == 0:
            step = way
            scale = real(1.0)
            plain = int(1)
        if halvings >= _HALVINGS or largest_magnitude(step) * scale < _STILL:
            break
    return rest
