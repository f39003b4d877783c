# type: ignore  # Warp functions, which type checkers cannot follow
"""The rest of a finger whose skin rubs, by Newton's method on its balance of torques.

There is no energy that could fall, and contacts that come, go, stick or slide change the matrix
from step to step (semismooth Newton, Qi and Sun 1993), so that the torques off balance may rise for
a step. Steps are therefore taken whole, and later halved where they do not shorten. What is near
and would be pressed is foreseen (`newton_turn`).
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, transform
from warpgrasp.finger.chain_energy import finger_length, largest_magnitude, loosened
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.utah_mit_hand_kernel import beyond_stops
from warpgrasp.rubbing.balance import finger_balance, off_balance

_ITERATIONS = wp.constant(16)
_GRADIENT = wp.constant(real(1e-6))  # [N m]; 0.2 mN on a tendon, a 300th of the converter's step
_LAST = wp.constant(real(2e-5))  # [rad]; to a tendon's reading a tenth of a converter's step
_LEFT = wp.constant(real(3e-6))  # [N m]
_DAMPED = wp.constant(4)  # from this iteration on steps that do not shorten are halved:
_SHORTER = wp.constant(real(0.25))  # in square
_AWAY = wp.constant(real(0.05))  # [rad]; a rest so far off may be another one
_CREEP = wp.constant(real(0.1))  # share of a step gained by it; a right matrix gains all
_JOINTS = wp.constant(real(4.0))  # each turns all of the finger beyond it


@wp.func
def newton_turn(hand: Any, at: Any):
    """How a Newton step turns the joints, with a place that is near and stops where it would press
    them."""
    rest = at.rest
    turn = -(rest.compliance * rest.gradient)
    bite = rest.near_depth - wp.dot(rest.near, turn)
    if bite > ZERO:
        yields = rest.compliance * at.near_slope
        turn += yields * (bite / (ONE + wp.dot(rest.near, yields)))
    if hand.stop > ZERO:
        past = beyond_stops(hand, rest.q)
        over = beyond_stops(hand, rest.q + turn)
        for j in range(len(turn)):
            if over[j] != ZERO and past[j] == ZERO:
                column = turn - turn
                for i in range(len(turn)):
                    column[i] = rest.compliance[i, j]
                turn -= column * (over[j] / (ONE / hand.stop + column[j]))
    return turn


@wp.func(inline=False)
def balanced_finger(
    scene: Scene, body: int, hand: Any, base: transform, command: Any, start: Any,
    last: Any, grip: Any, samples: int
):
    """The finger at rest on a command, from joints `start`; `settled` is 0 where none was found.

    Arguments are those of `finger_balance`. Where the last step was not evaluated, the grip is that
    before it, with its joints, and depths are upper bounds.
    """
    now = off_balance(last, grip)
    step = start - last.q
    way = start - start
    for k in range(_ITERATIONS):
        now = finger_balance(scene, body, hand, base, command, now.rest.q + step, now.rest,
                             grip, now.grip, wp.where(k == 0, samples, 0), int(k == 0))
        turned = step
        step = newton_turn(hand, now)
        level = largest_magnitude(now.rest.gradient)
        last_step = largest_magnitude(step)
        # What is left once the step is gone, by how much shorter it is than the one before.
        if now.forced == 0 and (level < _GRADIENT or (
                last_step < _LAST and level * last_step < _LEFT * largest_magnitude(turned))):
            now.rest.q += step
            now.rest = loosened(now.rest, last_step * _JOINTS * finger_length(hand))
            now.settled = int(largest_magnitude(now.rest.q - start) < _AWAY)
            break
        change = step - way
        way = step
        # How much of a step is gained by going it: 1 where the matrix is right.
        share = -wp.dot(change, turned) / wp.dot(turned, turned)
        if k >= 2 and now.forced == 0 and share > _CREEP and share < ONE - _CREEP:
            step -= (turned + change) * (wp.dot(step, change) / wp.dot(change, change))
        elif k >= _DAMPED and wp.dot(step, step) > _SHORTER * wp.dot(turned, turned):
            step = step * HALF
    return now
