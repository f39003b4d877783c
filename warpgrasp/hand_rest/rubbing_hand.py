# type: ignore  # Warp functions, which type checkers cannot follow
"""A hand whose fingers meet, with friction between their skin and the body.

What a finger's skin holds depends on how it came there: a finger that closed alone is followed
again from where it touched, and from then on all go step by step together.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import ZERO, real, transform
from warpgrasp.finger.chain_energy import largest_magnitude
from warpgrasp.finger.friction import end_friction, note_friction, start_friction
from warpgrasp.finger.path_record import true_command
from warpgrasp.geometry.scene import Scene
from warpgrasp.hand_rest.hand_balance import balanced_hand
from warpgrasp.hand_rest.hand_equilibrium import hand_energy, hand_equilibrium
from warpgrasp.hand_rest.meetings import base_of, servo_torques, takes_part
from warpgrasp.rubbing.friction_step import lagged, next_rubbed, start_rubbed

_PASSES = wp.constant(30)
_CLOSE = wp.constant(real(1e-3))  # [N]


@wp.func
def rubbed_at(
    scene: Scene, body: int, hand: Any, base: transform, path: Any, grasp: int,
    finger: int, touched: int, step: int, samples: int
):
    """A finger that closed alone and first touched at step `touched` (negative: never), at `step`.
    """
    begin = step
    if touched >= 0 and touched <= step:
        begin = wp.max(touched - 1, 0)
    now = start_rubbed(hand, base, true_command(hand, path, grasp, finger, begin))
    for s in range(begin + 1, step + 1):
        now = next_rubbed(scene, body, hand, base, true_command(hand, path, grasp, finger, s), now,
                          samples)
    return now


@wp.func(inline=False)
def _lagging_hand(
    scene: Scene, body: int, hands: Any, own: int, pose: transform, build: Any,
    command: Any, q: Any, state: Any, i: int, samples: int,
    meetings: Any, frictions: Any, grips: Any
):
    """The hand at rest from joints `q`, by passes with friction lagged."""
    fingers = hands.shape[1]
    for f in range(fingers):
        frictions[i, f] = start_friction(q[f])
    _energy, count = hand_energy(scene, body, hands, own, pose, build, command, q, state, i,
                                 0, 0, samples, 0, meetings, frictions)
    for f in range(hands.shape[1]):
        if takes_part(build, f):
            frictions[i, f] = lagged(
                scene, body, hands[own, f],
                base_of(hands[own, f], pose, f), state[i, f],
                grips[i, f])
    _energy, count = hand_energy(scene, body, hands, own, pose, build, command, q, state, i,
                                 0, 0, 0, 0, meetings, frictions)
    for again in range(_PASSES):
        count = hand_equilibrium(scene, body, hands, own, pose, build, command, state, i,
                                 wp.where(again == 0, samples, 0), meetings, count, frictions)
        now = q - q
        for f in range(hands.shape[1]):
            now[f] = state[i, f].q
        _energy, count = hand_energy(scene, body, hands, own, pose, build, command, now,
                                     state, i, 0, 0, 0, 0, meetings, frictions)
        off = real(0.0)
        for f in range(hands.shape[1]):
            if takes_part(build, f):
                frictions[i, f] = note_friction(
                    scene, body, hands[own, f],
                    base_of(hands[own, f], pose, f), state[i, f],
                    frictions[i, f])
                off = wp.max(off, frictions[i, f].off)
        if off == ZERO or (off < _CLOSE and again > 0):
            break
    for f in range(hands.shape[1]):
        if takes_part(build, f):
            done = end_friction(hands[own, f], frictions[i, f], state[i, f].q)
            grips[i, fingers + f].q = done.q
            grips[i, fingers + f].left = done.left
            grips[i, fingers + f].touching = done.touching
            grips[i, fingers + f].sliding = 0
            grips[i, fingers + f].missed = done.q * ZERO
    return count


@wp.func
def rubbing_hand(
    scene: Scene, body: int, hands: Any, own: int, pose: transform, build: Any,
    command: Any, moves: Any, state: Any, i: int, samples: int,
    meetings: Any, noted: int, frictions: Any,
    grips: Any
):
    """The hand at rest on commands that have moved by `moves`, from the states in the first half of
    row `i` with their `noted` meetings; the grips of a step begin in the first half of `grips`,
    where those of the next are put. Returns the number of meetings.
    """
    fingers = hands.shape[1]
    q = command - command
    for f in range(hands.shape[1]):
        q[f] = state[i, f].q
        grips[i, f].drift = (state[i, f].compliance * (servo_torques(hands[own, f], moves[f]))
                             + state[i, f].q - grips[i, f].q)
        if largest_magnitude(moves[f]) == ZERO:
            grips[i, f].missed = moves[f]
        grips[i, fingers + f] = grips[i, f]
    count = balanced_hand(scene, body, hands, own, pose, build, command, state, i, samples,
                          meetings, noted, grips)
    if count < 0:
        count = _lagging_hand(scene, body, hands, own, pose, build, command, q, state, i,
                              samples, meetings, frictions, grips)
    for f in range(hands.shape[1]):
        if takes_part(build, f):
            grips[i, f] = grips[i, fingers + f]
    return count
