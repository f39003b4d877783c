# type: ignore  # Warp functions, which type checkers cannot follow
"""The rest of a hand whose fingers meet and whose skin rubs, by Newton's method.

Each finger's torques are those of its `balance`; links that meet add theirs as in
`hand_equilibrium`, by the same small system. Steps are taken whole.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, transform
from warpgrasp.finger.chain_energy import largest_magnitude
from warpgrasp.geometry.scene import Scene
from warpgrasp.hand_rest.far_balance import far_balance
from warpgrasp.hand_rest.hand_equilibrium import largest_step, newton_step, stands
from warpgrasp.hand_rest.meetings import base_of, find_meetings, fingers_met, takes_part
from warpgrasp.rubbing.balance import finger_balance

_ITERATIONS = wp.constant(16)
_LAST = wp.constant(real(2e-5))  # [rad]; a Newton step that is taken without another evaluation
_GROWN = wp.constant(real(2.0))  # steps that lengthen so much lead nowhere


@wp.func
def _expect(at: Any):
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
    scene: Scene, body: int, hands: Any, own: int, pose: transform, build: Any,
    command: Any, q: Any, state: Any, i: int, slot: int,
    last: int, samples: int, begins: int, meetings: Any,
    noted: int, grips: Any
):
    """Balances of the fingers at joints `q` (a row each), into row `i` of `state` from `slot` on,
    with their grips in the second half of row `i` of `grips`, whose first half are those the step
    began with; returns the number of meetings. The states from `last` on are of joints near by,
    with `noted` meetings: what one of them holds does not go its own step.
    Fingers that take no part are left out; the state of one that stands still is kept.
    """
    fingers = hands.shape[1]
    held = int(0)
    for a in range(noted):
        if meetings[i, a].depth > ZERO:
            held = held | fingers_met(meetings[i, a])
    for f in range(fingers):
        if not takes_part(build, f):
            continue
        if slot != last and stands(state, i, last + f, q[f]):
            state[i, slot + f] = state[i, last + f]
        else:
            hand = hands[own, f]
            base = base_of(hand, pose, f)
            if far_balance(hand, base, build, f, command[f], q[f], state, i, slot + f, last + f,
                           grips, fingers + f):
                continue
            at = finger_balance(scene, body, hand, base, command[f], q[f], state[i, last + f],
                                grips[i, f], grips[i, fingers + f], samples, begins)
            state[i, slot + f] = at.rest
            if (held & (1 << f)) == 0:
                state[i, slot + f] = _expect(at)
            grips[i, fingers + f] = at.grip
    return find_meetings(hands, own, build, q, meetings, i)


@wp.func(inline=False)
def balanced_hand(
    scene: Scene, body: int, hands: Any, own: int, pose: transform, build: Any,
    command: Any, state: Any, i: int, samples: int,
    meetings: Any, noted: int, grips: Any
):
    """The hand at rest on commands (a row each finger), from the states in the first half of row
    `i` with their `noted` meetings; see `hand_equilibrium.move_commands`. The result is left there,
    and its grips in their second half; returns the number of meetings, negative where no rest was
    found."""
    fingers = hands.shape[1]
    stiffness = hands[own, 0].skin * HALF
    slot = int(0)
    count = int(noted)
    settled = int(0)
    longest = real(0.0)
    q = command - command
    for f in range(hands.shape[1]):
        q[f] = state[i, f].q
    foreseen = q - q
    for iteration in range(_ITERATIONS):
        step = newton_step(q, build, state, i, slot, meetings, count, stiffness, fingers)
        long = largest_step(step, fingers)
        if iteration > 0 and long < _LAST:
            q += step
            for f in range(hands.shape[1]):
                state[i, slot + f].q = q[f]
            settled = int(1)
            break
        if iteration > 1 and long > _GROWN * longest:
            break
        if iteration > 0:
            # Fingers that are all but there wait for the others, and go their step at the end.
            for f in range(hands.shape[1]):
                if largest_magnitude(step[f]) < _LAST:
                    step[f] = step[f] - step[f]
        q += step
        if iteration == 0:
            foreseen = q
            for f in range(hands.shape[1]):
                q[f] = q[f] + grips[i, f].missed
        longest = real(long)
        count = hand_balance(scene, body, hands, own, pose, build, command, q, state, i,
                             fingers - slot, slot, wp.where(iteration == 0, samples, 0),
                             int(iteration == 0), meetings, count, grips)
        slot = fingers - slot
    if settled == 0:
        return -1
    for f in range(hands.shape[1]):
        if takes_part(build, f):
            if slot == fingers:
                state[i, f] = state[i, fingers + f]
            grips[i, fingers + f].missed = (q[f] - foreseen[f]) * wp.where(
                grips[i, f].touching == grips[i, fingers + f].touching
                and grips[i, f].sliding == grips[i, fingers + f].sliding, ONE, ZERO)
    return count
