# type: ignore  # Warp functions, which type checkers cannot follow
"""A step of the command of a finger whose skin rubs: its rest, and the friction left in it."""

import warp as wp

from warpgrasp.core.dtypes import ZERO, real, struct, transform, vec4
from warpgrasp.finger.energy import Equilibrium, finger_energy, free_equilibrium
from warpgrasp.finger.equilibrium import finger_equilibrium
from warpgrasp.finger.equilibrium_refine import refine_equilibrium
from warpgrasp.finger.friction import (
    Friction,
    end_friction,
    note_friction,
    start_friction,
    with_friction,
)
from warpgrasp.finger.torque_bounds import predict_joints
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, free_joints

_PASSES = wp.constant(30)
_REFINEMENTS = wp.constant(4)
_CLOSE = wp.constant(real(1e-3))  # [N]; a hundredth of a tendon's noise, by any lever


@struct
class Rubbed:
    """A finger at rest on a command, with friction.

    `friction` is that of the step that led there, `left` what the next step begins with. `pressed`
    is 1 where a link touches.
    """

    command: vec4
    rest: Equilibrium
    friction: Friction
    left: Friction
    pressed: int


@wp.func
def start_rubbed(hand: Hand, base: transform, command: vec4):
    """A finger on a command that touches nothing."""
    free = Rubbed()
    free.command = command
    free.rest = free_equilibrium(free_joints(hand, base, command))
    free.left = start_friction(free.rest.q)
    return free


@wp.func
def drift_of(hand: Hand, base: transform, command: vec4, rest: Equilibrium, now: vec4,
             pressed: int):
    """How joints turn from `rest` on `command` to the command `now` if nothing new is touched."""
    if pressed == 1:
        return predict_joints(command, rest, now, hand.stiffness) - rest.q
    return free_joints(hand, base, now) - rest.q


@wp.func
def next_rubbed(
    scene: Scene, body: int, hand: Hand, base: transform, command: vec4, was: Rubbed, samples: int
):
    """The finger at rest on the next command; `base` is in the body's frame."""
    now = Rubbed()
    now.command = command
    now.rest = was.rest
    now.left = was.left
    now.left.drift = drift_of(hand, base, was.command, was.rest, command, was.pressed)
    start = was.rest.q + now.left.drift
    compared = int(samples)
    for again in range(_PASSES):
        now.friction = now.left
        now.rest = finger_equilibrium(scene, body, hand, base, command, start, now.rest, compared,
                                      now.friction)
        # Its last step may not have been evaluated.
        now.rest = with_friction(
            finger_energy(scene, body, hand, base, command, now.rest.q, now.rest, 0),
            hand.skin, now.friction)
        now.left = note_friction(scene, body, hand, base, now.rest, now.friction)
        # The first pass has the places of the step before.
        if now.left.off == ZERO or (now.left.off < _CLOSE and again > 0):
            break
        start = now.rest.q
        compared = int(0)
    now.left = end_friction(hand, now.left, now.rest.q)
    now.pressed = int(now.left.touching != 0)
    return now


@wp.func
def refine_rubbed(scene: Scene, body: int, hand: Hand, base: transform, was: Rubbed):
    """Where the finger rests when every valley of the distance is searched, friction included."""
    rest = was.rest
    friction = was.friction
    for _pass in range(_REFINEMENTS):
        rest = refine_equilibrium(scene, body, hand, base, was.command, rest, friction)
        again = note_friction(scene, body, hand, base, rest, friction)
        if again.off < _CLOSE:
            break
        friction = again
    return rest
