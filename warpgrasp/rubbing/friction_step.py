# type: ignore  # Warp functions, which type checkers cannot follow
"""A step of the command of a finger whose skin rubs: its rest, and how its skin is stretched then.

Newton's method on the balance of torques finds nearly all rests (`balance_newton`). Where it does
not, friction is lagged (`friction`), which takes several times as long.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import ZERO, real, struct, transform, vec4
from warpgrasp.finger.chain_energy import finger_energy, largest_magnitude, with_friction
from warpgrasp.finger.energy import Equilibrium, free_equilibrium
from warpgrasp.finger.equilibrium import finger_equilibrium
from warpgrasp.finger.equilibrium_refine import refine_equilibrium
from warpgrasp.finger.friction import (
    end_friction,
    note_friction,
    start_friction,
)
from warpgrasp.finger.torque_bounds import predict_joints
from warpgrasp.geometry.scene import Scene, body_is_convex
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, free_joints
from warpgrasp.rubbing.balance import Grip, finger_balance, off_balance, start_grip
from warpgrasp.rubbing.balance_newton import balanced_finger

_PASSES = wp.constant(30)
_REFINEMENTS = wp.constant(4)
_CLOSE = wp.constant(real(1e-3))  # [N]; a hundredth of a tendon's noise, by any lever
_LEVEL = wp.constant(real(1e-6))  # slope [N m]


@struct
class Rubbed:
    """A finger at rest on a command, with friction.

    `grip` is what the step there began with, `left` what the next one begins with. `pressed` is 1
    where a link touches. `missed` is how far the joints rest from where they were foreseen to
    first order [rad], where the contacts did what they had done in the step before: the next step
    will miss as much.
    """

    command: vec4
    rest: Equilibrium
    grip: Grip
    left: Grip
    pressed: int
    missed: vec4


@wp.func
def start_rubbed(hand: Hand, base: transform, command: vec4):
    """A finger on a command that touches nothing."""
    free = Rubbed()
    free.command = command
    free.rest = free_equilibrium(free_joints(hand, base, command))
    free.grip = start_grip(free.rest.q)
    free.left = free.grip
    return free


@wp.func
def predicted(hand: Hand, command: vec4, rest: Equilibrium, other: vec4):
    """Joints on another command to first order, from `rest` on `command`."""
    return predict_joints(command, rest, other, hand.stiffness)


@wp.func
def drift_of(hand: Any, base: transform, command: Any, rest: Any, now: Any, pressed: int):
    """How joints turn from `rest` on `command` to the command `now` if nothing new is touched."""
    if pressed == 1:
        return predicted(hand, command, rest, now) - rest.q
    return free_joints(hand, base, now) - rest.q


@wp.func
def _begun(grip: Any):
    friction = start_friction(grip.q)
    friction.drift = grip.drift
    friction.left = grip.left
    friction.touching = grip.touching
    return friction


@wp.func
def lagged(
    scene: Scene, body: int, hand: Any, base: transform, rest: Any, grip: Any
):
    """The contacts at `rest` as `note_friction` notes them, in a step that begins with `grip`."""
    return note_friction(scene, body, hand, base, rest, _begun(grip))


@wp.func
def lagged_rest(
    scene: Scene, body: int, hand: Any, base: transform, command: Any, was: Any, grip: Any,
    samples: int
):
    """The finger at rest on a command, by passes with friction lagged."""
    now = off_balance(was.rest, grip)
    now.grip.missed = grip.missed - grip.missed
    now.grip.drift = now.grip.missed
    now.grip.sliding = 0
    friction = _begun(grip)
    if was.pressed == 1:
        friction = lagged(scene, body, hand, base, was.rest, grip)
    start = was.rest.q + grip.drift
    for again in range(_PASSES):
        now.rest = finger_equilibrium(scene, body, hand, base, command, start, now.rest,
                                      wp.where(again == 0, samples, 0), friction)
        # Its last step may not have been evaluated.
        now.rest = with_friction(
            finger_energy(scene, body, hand, base, command, now.rest.q, now.rest, 0),
            hand.skin, friction)
        friction = note_friction(scene, body, hand, base, now.rest, friction)
        # The first pass has the places of the step before.
        if friction.off == ZERO or (friction.off < _CLOSE and again > 0):
            break
        start = now.rest.q
    friction = end_friction(hand, friction, now.rest.q)
    now.grip.q = friction.q
    now.grip.left = friction.left
    now.grip.touching = friction.touching
    return now


@wp.func
def next_rubbed(
    scene: Scene, body: int, hand: Any, base: transform, command: Any, was: Any, samples: int
):
    """The finger at rest on the next command; `base` is in the body's frame."""
    now = was
    now.command = command
    turn = drift_of(hand, base, was.command, was.rest, command, was.pressed)
    now.grip = was.left
    now.grip.drift = was.rest.q + turn - was.left.q
    found = balanced_finger(scene, body, hand, base, command, was.rest.q + turn + was.missed,
                            was.rest, now.grip, samples)
    if found.settled == 0:
        found = lagged_rest(scene, body, hand, base, command, was, now.grip, samples)
    now.rest = found.rest
    now.left = found.grip
    now.pressed = int(now.left.touching != 0)
    now.missed = turn - turn
    if found.settled == 1 and now.left.touching == was.left.touching and (
            now.left.sliding == was.left.sliding):
        now.missed = now.rest.q - was.rest.q - turn
    return now


@wp.func
def refine_rubbed(scene: Scene, body: int, hand: Any, base: transform, was: Any):
    """Where the finger rests when every valley of the distance is searched, friction included."""
    at = finger_balance(scene, body, hand, base, was.command, was.rest.q, was.rest, was.grip,
                        was.grip, 0, 0)
    rest = at.rest
    if body_is_convex(scene, body) and largest_magnitude(rest.gradient) < _LEVEL:
        return rest
    friction = lagged(scene, body, hand, base, rest, was.grip)
    for _pass in range(_REFINEMENTS):
        rest = refine_equilibrium(scene, body, hand, base, was.command, rest, friction)
        again = note_friction(scene, body, hand, base, rest, friction)
        if again.off < _CLOSE:
            break
        friction = again
    return rest
