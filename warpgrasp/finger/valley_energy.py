# type: ignore  # Warp functions, which type checkers cannot follow
"""What the refinement of an equilibrium needs: a finger's energy with every valley searched."""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import ONE, ZERO, mat44, real, vec4
from warpgrasp.finger.energy import Equilibrium, finger_energy, free_equilibrium, put
from warpgrasp.finger.friction import with_friction
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import deepest_valley
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_pose, link_direction, link_start

_PARTS = wp.constant(8)  # of an eighth of a link: half a millimetre
_FAR = wp.constant(real(1.0))  # [m]
_STIFF = wp.constant(real(1e4))  # a valley already found is not left: steps of micrometres


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
