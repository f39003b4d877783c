# type: ignore  # Warp functions, which type checkers cannot follow
"""The equilibrium of a hand whose fingers touch one another or the palm.

The energy is that of the fingers (`finger.energy`) and of the skin between them,

    E(q) = sum over fingers E_f(q_f) + sum over pairs of links 1/2 k/2 max(0, r1 + r2 - d(q))^2

with d the distance of two links' axes; two skins give in series, and do not rub. Palm and wrist are
capsules too. Newton steps: each finger's inverse Hessian is known, and what links do to one another
adds a term of rank one each, whose forces solve a small system (Woodbury).

Hands are the Utah-MIT's, with joints of fingers as rows of a mat44, or of chains, of `hand_angles`.
What differs is overloaded: `finger_energy`, and what `meetings` and `chain_meetings` define. Its
`build` is what else they need of the hand.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, transform
from warpgrasp.finger.chain_energy import finger_energy, largest_magnitude, with_friction
from warpgrasp.geometry.scene import Scene
from warpgrasp.hand_rest.meetings import (
    MEETINGS,
    PALM,
    base_of,
    find_meetings,
    servo_torques,
    takes_part,
)

_ITERATIONS = wp.constant(40)
_HALVINGS = wp.constant(14)
_PASSES = wp.constant(6)
_LAST = wp.constant(real(2e-5))  # [rad]; a Newton step that is taken without another evaluation
_STILL = wp.constant(real(1e-7))  # [rad]; less is not gone
_mat = wp.types.matrix(shape=(MEETINGS, MEETINGS), dtype=real)
_vec = wp.types.vector(length=MEETINGS, dtype=real)


@wp.func
def _shared(a: Any, b: Any):
    """How far the force of meeting `b` moves the links of meeting `a` apart [m/N]."""
    total = real(0.0)
    if a.one == b.one:
        total += wp.dot(a.by_one, b.give_one)
    if a.one == b.two:
        total += wp.dot(a.by_one, b.give_two)
    if a.two == b.one:
        total += wp.dot(a.by_two, b.give_one)
    if a.two == b.two and a.two != PALM:
        total += wp.dot(a.by_two, b.give_two)
    return total


@wp.func(inline=False)
def _solved(system: _mat, right: _vec, count: int):
    """The solution of a system whose pivots are on its diagonal, by elimination."""
    a = system
    y = right
    for k in range(count):
        for r in range(k + 1, count):
            share = a[r, k] / a[k, k]
            for c in range(k, count):
                a[r, c] = a[r, c] - share * a[k, c]
            y[r] = y[r] - share * y[k]
    for back in range(count):
        k = count - 1 - back
        for c in range(k + 1, count):
            y[k] = y[k] - a[k, c] * y[c]
        y[k] = y[k] / a[k, k]
    return y


@wp.func(inline=False)
def meeting_forces(
    state: Any, i: int, slot: int, meetings: Any, count: int,
    stiffness: real
):
    """Forces of the meetings after a Newton step [N]: links push, and never pull."""
    bears = int(0)
    all = _mat()
    apart = _vec()  # by the fingers' own Newton steps
    for a in range(count):
        one = slot + meetings[i, a].one
        meetings[i, a].give_one = state[i, one].compliance * meetings[i, a].by_one
        # With friction a compliance is not symmetric.
        apart[a] = -wp.dot(meetings[i, a].by_one, state[i, one].compliance * state[i, one].gradient)
        if meetings[i, a].two != PALM:
            two = slot + meetings[i, a].two
            meetings[i, a].give_two = state[i, two].compliance * meetings[i, a].by_two
            apart[a] = apart[a] - wp.dot(meetings[i, a].by_two,
                                         state[i, two].compliance * state[i, two].gradient)
        if meetings[i, a].depth > ZERO:
            bears = bears | (1 << a)
        for b in range(a + 1):
            all[a, b] = _shared(meetings[i, a], meetings[i, b])
            all[b, a] = _shared(meetings[i, b], meetings[i, a])
    force = _vec()
    for _pass in range(_PASSES):
        system = _mat()
        right = _vec()
        for a in range(count):
            system[a, a] = ONE
            if (bears & (1 << a)) != 0:
                right[a] = meetings[i, a].depth - apart[a]
                for b in range(count):
                    if (bears & (1 << b)) != 0:
                        system[a, b] = all[a, b]
                system[a, a] = system[a, a] + ONE / stiffness
        force = _solved(system, right, count)
        others = int(0)
        for a in range(count):
            if (bears & (1 << a)) != 0:
                if force[a] > ZERO:
                    others = others | (1 << a)
            else:
                away = apart[a]
                for b in range(count):
                    away += all[a, b] * force[b]
                if meetings[i, a].depth - away > ZERO:
                    others = others | (1 << a)
        if others == bears:
            break
        bears = others
    for a in range(count):
        force[a] = wp.max(force[a], ZERO)
    return force


@wp.func
def stands(state: Any, i: int, slot: int, q: Any):
    """Whether a finger's joints are those of its state."""
    return largest_magnitude(q - state[i, slot].q) == ZERO


@wp.func(inline=False)
def hand_energy(
    scene: Scene, body: int, hands: Any, own: int, pose: transform, build: Any,
    command: Any, q: Any, state: Any, i: int, slot: int,
    last: int, samples: int, keep: int, meetings: Any,
    frictions: Any
):
    """Energies of the fingers, into row `i` of `state` from `slot` on, and of what they do to one
    another; returns their sum [J] and the number of meetings. `pose` is the hand's in the body's
    frame; the states from `last` on are of joints near by. Row `i` of `frictions` is that of their
    contacts with the body; it is not read without friction. Fingers that take no part are left
    out, and with `keep` 1 the state of one that stands still is kept.
    """
    total = real(0.0)
    for f in range(hands.shape[1]):
        if not takes_part(build, f):
            continue
        hand = hands[own, f]
        if keep == 1 and stands(state, i, last + f, q[f]):
            state[i, slot + f] = state[i, last + f]
        else:
            state[i, slot + f] = finger_energy(
                scene, body, hand, base_of(hand, pose, f), command[f],
                q[f], state[i, last + f], samples)
            if hand.friction > ZERO:
                state[i, slot + f] = with_friction(state[i, slot + f], hand.skin, frictions[i, f])
        total += state[i, slot + f].energy
    count = find_meetings(hands, own, build, q, meetings, i)
    for a in range(count):
        depth = wp.max(meetings[i, a].depth, ZERO)
        total += real(0.25) * hands[own, 0].skin * depth * depth
    return total, count


@wp.func
def newton_step(
    q: Any, build: Any, state: Any, i: int, slot: int, meetings: Any, count: int, stiffness: real,
    fingers: int
):
    """How far a Newton step turns the joints `q` of each finger, a row each; a finger that is all
    but at rest stays where it is."""
    force = meeting_forces(state, i, slot, meetings, count, stiffness)
    step = q - q
    for f in range(fingers):
        if not takes_part(build, f):
            continue
        pull = state[i, slot + f].gradient
        for a in range(count):
            if meetings[i, a].one == f:
                pull -= meetings[i, a].by_one * force[a]
            elif meetings[i, a].two == f:
                pull -= meetings[i, a].by_two * force[a]
        turn = -(state[i, slot + f].compliance * pull)
        step[f] = turn * wp.where(largest_magnitude(turn) < _STILL, ZERO, ONE)
    return step


@wp.func
def largest_step(step: Any, fingers: int):
    """The largest absolute value of a step."""
    largest = real(0.0)
    for f in range(fingers):
        largest = wp.max(largest, largest_magnitude(step[f]))
    return largest


@wp.func
def move_commands(
    hands: Any, own: int, build: Any, moves: Any, state: Any,
    i: int
):
    """States in the first half of row `i` at the same joints with commands moved by `moves` [rad],
    a row each finger: only the servos' part of the gradient changes."""
    for f in range(hands.shape[1]):
        if takes_part(build, f):
            pull = servo_torques(hands[own, f], moves[f])
            state[i, f].drive -= pull
            state[i, f].gradient -= pull


@wp.func(inline=False)
def hand_equilibrium(
    scene: Scene, body: int, hands: Any, own: int, pose: transform, build: Any,
    command: Any, state: Any, i: int, samples: int,
    meetings: Any, noted: int, frictions: Any
):
    """The hand's equilibrium for commands (a row each finger), from the states in the first half
    of row `i` with their `noted` meetings; see `move_commands`. The result is left there; returns
    the number of meetings.

    The first step is always gone, since the valleys of the distance are chosen after it, with
    `samples` compared; then the energy never rises.
    """
    fingers = hands.shape[1]
    stiffness = hands[own, 0].skin * HALF
    slot = int(0)
    best = real(0.0)
    count = int(noted)
    # Friction may have changed since the states were found.
    rubs = hands[own, 0].friction > ZERO
    fresh = int(1)  # whether the meetings noted are those of the joints
    q = command - command
    for f in range(hands.shape[1]):
        q[f] = state[i, f].q
    for iteration in range(_ITERATIONS):
        step = newton_step(q, build, state, i, slot, meetings, count, stiffness, fingers)
        if iteration > 0 and largest_step(step, fingers) < _LAST:
            q += step
            for f in range(hands.shape[1]):
                state[i, slot + f].q = q[f]
            break
        scale = real(1.0)
        found = int(0)
        for _halving in range(_HALVINGS):
            energy, met = hand_energy(scene, body, hands, own, pose, build, command,
                                      q + step * scale, state, i, fingers - slot, slot,
                                      wp.where(iteration == 0, samples, 0),
                                      wp.where(iteration > 0 or not rubs, 1, 0), meetings,
                                      frictions)
            if iteration == 0 or energy < best:
                best = energy
                count = met
                found = int(1)
                break
            scale *= HALF
        if found == 0:
            fresh = int(0)
            break
        q += step * scale
        slot = fingers - slot
    if slot == fingers:
        for f in range(hands.shape[1]):
            if takes_part(build, f):
                state[i, f] = state[i, fingers + f]
    if fresh == 0:
        count = find_meetings(hands, own, build, q, meetings, i)
    return count
