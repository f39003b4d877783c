# type: ignore  # Warp functions, which type checkers cannot follow
"""The rest of a hand whose fingers meet and whose skin rubs, by Newton's method.

Each finger's torques are those of its `balance`; links that meet add theirs as in
`hand_equilibrium`, by the same small system. Steps are taken whole.
"""

import warp as wp

from warpgrasp.closing.hand_equilibrium import (
    Meeting,
    find_meetings,
    in_pairs,
    largest_step,
    newton_step,
    stands,
)
from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat44, real, transform, vec4
from warpgrasp.finger.energy import Equilibrium, largest_magnitude
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_base
from warpgrasp.rubbing.balance import Balance, Grip, finger_balance

_ITERATIONS = wp.constant(16)
_LAST = wp.constant(real(2e-5))  # [rad]; a Newton step that is taken without another evaluation
_GROWN = wp.constant(real(2.0))  # steps that lengthen so much lead nowhere


@wp.func
def _expect(at: Balance):
    """Its rest with a link that is near counted as pressed, where the finger's own step presses it.
    """
    rest = at.rest
    expected = at.rest
    way = -(rest.compliance * rest.gradient)
    if rest.near_depth - wp.dot(rest.near, way) > ZERO:
        expected.gradient -= at.near_slope * rest.near_depth
        yields = rest.compliance * at.near_slope
        expected.compliance -= wp.outer(yields, rest.near * rest.compliance) / (
            ONE + wp.dot(rest.near, yields))
    return expected


@wp.func
def hand_balance(
    scene: Scene, body: int, hands: wp.array2d[Hand], own: int, pose: transform, mount: real,
    command: mat44, q: mat44, pairs: int, state: wp.array2d[Equilibrium], i: int, slot: int,
    last: int, samples: int, begins: int, meetings: wp.array2d[Meeting],
    grips: wp.array2d[Grip]
):
    """Balances of the fingers at joints `q` (a row each), into row `i` of `state` from `slot` on,
    with their grips from 4 on in row `i` of `grips`, whose first four are those the step began
    with; returns the number of meetings. The states from `last` on are of joints near by. Fingers
    in none of `pairs` are left out; the state of one that stands still is kept.
    """
    for f in range(4):
        if not in_pairs(pairs, f):
            continue
        if slot != last and stands(state, i, last + f, q[f]):
            state[i, slot + f] = state[i, last + f]
        else:
            hand = hands[own, f]
            at = finger_balance(
                scene, body, hand, wp.transform_multiply(pose, finger_base(hand, f)), command[f],
                q[f], state[i, last + f], grips[i, f], grips[i, 4 + f], samples, begins)
            state[i, slot + f] = _expect(at)
            grips[i, 4 + f] = at.grip
    return find_meetings(hands, own, mount, q, pairs, meetings, i)


@wp.func
def balanced_hand(
    scene: Scene, body: int, hands: wp.array2d[Hand], own: int, pose: transform, mount: real,
    command: mat44, pairs: int, state: wp.array2d[Equilibrium], i: int, samples: int,
    meetings: wp.array2d[Meeting], noted: int, grips: wp.array2d[Grip]
):
    """The hand at rest on commands (a row each finger), from the states in slots 0 to 3 of row `i`
    with their `noted` meetings; see `hand_equilibrium.move_commands`. The result is left there, and
    its grips from 4 on; returns the number of meetings, negative where no rest was found."""
    stiffness = hands[own, 0].skin * HALF
    slot = int(0)
    count = int(noted)
    settled = int(0)
    longest = real(0.0)
    q = mat44()
    for f in range(4):
        q[f] = state[i, f].q
    foreseen = mat44()
    still = vec4(ZERO, ZERO, ZERO, ZERO)
    for iteration in range(_ITERATIONS):
        step = newton_step(state, i, slot, meetings, count, stiffness, pairs)
        long = largest_step(step)
        if iteration > 0 and long < _LAST:
            q += step
            for f in range(4):
                state[i, slot + f].q = q[f]
            settled = int(1)
            break
        if iteration > 1 and long > _GROWN * longest:
            break
        if iteration > 0:
            # Fingers that are all but there wait for the others, and go their step at the end.
            for f in range(4):
                if largest_magnitude(step[f]) < _LAST:
                    step[f] = still
        q += step
        if iteration == 0:
            foreseen = q
            for f in range(4):
                q[f] = q[f] + grips[i, f].missed
        longest = real(long)
        count = hand_balance(scene, body, hands, own, pose, mount, command, q, pairs, state, i,
                             4 - slot, slot, wp.where(iteration == 0, samples, 0),
                             int(iteration == 0), meetings, grips)
        slot = 4 - slot
    if settled == 0:
        return -1
    for f in range(4):
        if in_pairs(pairs, f):
            if slot == 4:
                state[i, f] = state[i, 4 + f]
            grips[i, 4 + f].missed = (q[f] - foreseen[f]) * wp.where(
                grips[i, f].touching == grips[i, 4 + f].touching
                and grips[i, f].sliding == grips[i, 4 + f].sliding, ONE, ZERO)
    return count
