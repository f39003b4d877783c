# type: ignore  # Warp functions, which type checkers cannot follow
"""A hand whose fingers meet, with friction between their skin and the body.

What a finger's skin holds depends on how it came there: a finger that closed alone is followed
again from where it touched, and from then on all four go step by step together.
"""

import warp as wp

from warpgrasp.closing.hand_balance import balanced_hand
from warpgrasp.closing.hand_equilibrium import Meeting, hand_energy, hand_equilibrium, in_pairs
from warpgrasp.core.dtypes import ZERO, mat44, real, transform
from warpgrasp.finger.energy import Equilibrium, largest_magnitude
from warpgrasp.finger.friction import Friction, end_friction, note_friction, start_friction
from warpgrasp.finger.path_record import PathStep, true_command
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_base
from warpgrasp.rubbing.balance import Grip
from warpgrasp.rubbing.friction_step import lagged, next_rubbed, start_rubbed

_PASSES = wp.constant(30)
_CLOSE = wp.constant(real(1e-3))  # [N]


@wp.func
def rubbed_at(
    scene: Scene, body: int, hand: Hand, base: transform, path: wp.array3d[PathStep], grasp: int,
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


@wp.func
def _lagging_hand(
    scene: Scene, body: int, hands: wp.array2d[Hand], own: int, pose: transform, mount: real,
    command: mat44, q: mat44, pairs: int, state: wp.array2d[Equilibrium], i: int, samples: int,
    meetings: wp.array2d[Meeting], frictions: wp.array2d[Friction], grips: wp.array2d[Grip]
):
    """The hand at rest from joints `q`, by passes with friction lagged."""
    for f in range(4):
        frictions[i, f] = start_friction(q[f])
    _energy, count = hand_energy(scene, body, hands, own, pose, mount, command, q, pairs, state, i,
                                 0, 0, samples, 0, meetings, frictions)
    for f in range(4):
        if in_pairs(pairs, f):
            frictions[i, f] = lagged(
                scene, body, hands[own, f],
                wp.transform_multiply(pose, finger_base(hands[own, f], f)), state[i, f],
                grips[i, f])
    _energy, count = hand_energy(scene, body, hands, own, pose, mount, command, q, pairs, state, i,
                                 0, 0, 0, 0, meetings, frictions)
    for again in range(_PASSES):
        count = hand_equilibrium(scene, body, hands, own, pose, mount, command, pairs, state, i,
                                 wp.where(again == 0, samples, 0), meetings, count, frictions)
        now = mat44()
        for f in range(4):
            now[f] = state[i, f].q
        _energy, count = hand_energy(scene, body, hands, own, pose, mount, command, now, pairs,
                                     state, i, 0, 0, 0, 0, meetings, frictions)
        off = real(0.0)
        for f in range(4):
            if in_pairs(pairs, f):
                frictions[i, f] = note_friction(
                    scene, body, hands[own, f],
                    wp.transform_multiply(pose, finger_base(hands[own, f], f)), state[i, f],
                    frictions[i, f])
                off = wp.max(off, frictions[i, f].off)
        if off == ZERO or (off < _CLOSE and again > 0):
            break
    for f in range(4):
        if in_pairs(pairs, f):
            done = end_friction(hands[own, f], frictions[i, f], state[i, f].q)
            grips[i, 4 + f].q = done.q
            grips[i, 4 + f].left = done.left
            grips[i, 4 + f].touching = done.touching
            grips[i, 4 + f].sliding = 0
            grips[i, 4 + f].missed = done.q * ZERO
    return count


@wp.func
def rubbing_hand(
    scene: Scene, body: int, hands: wp.array2d[Hand], own: int, pose: transform, mount: real,
    command: mat44, moves: mat44, pairs: int, state: wp.array2d[Equilibrium], i: int, samples: int,
    meetings: wp.array2d[Meeting], noted: int, frictions: wp.array2d[Friction],
    grips: wp.array2d[Grip]
):
    """The hand at rest on commands that have moved by `moves`, from the states in slots 0 to 3 of
    row `i` with their `noted` meetings; the grips of a step begin in slots 0 to 3 of `grips`, where
    those of the next are put. Returns the number of meetings.
    """
    q = mat44()
    for f in range(4):
        q[f] = state[i, f].q
        grips[i, f].drift = (state[i, f].compliance * (moves[f] * hands[own, f].stiffness)
                             + state[i, f].q - grips[i, f].q)
        if largest_magnitude(moves[f]) == ZERO:
            grips[i, f].missed = moves[f]
        grips[i, 4 + f] = grips[i, f]
    count = balanced_hand(scene, body, hands, own, pose, mount, command, pairs, state, i, samples,
                          meetings, noted, grips)
    if count < 0:
        count = _lagging_hand(scene, body, hands, own, pose, mount, command, q, pairs, state, i,
                              samples, meetings, frictions, grips)
    for f in range(4):
        if in_pairs(pairs, f):
            grips[i, f] = grips[i, 4 + f]
    return count
