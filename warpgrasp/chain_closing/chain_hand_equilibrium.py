# type: ignore  # Warp functions, which type checkers cannot follow
"""The equilibrium of a hand of chains whose fingers touch one another or the palm.

By the mathematics of `closing.hand_equilibrium`: the energies of the fingers and of the skin
between them, Newton steps in which what links do to one another adds terms of rank one (Woodbury).
All fingers of a hand take part.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain, vec6
from warpgrasp.chain_closing.chain_meetings import (
    MEETINGS,
    CapsulePair,
    ChainMeeting,
    angles_of,
    find_chain_meetings,
    hand_angles,
)
from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, transform, vec3
from warpgrasp.finger.chain_energy import ChainRest, finger_energy, largest_magnitude
from warpgrasp.geometry.scene import Scene

_MEETINGS = wp.constant(MEETINGS)
_NEAR = wp.constant(real(2e-3))  # [m]: links nearer than this may meet in a step
_ITERATIONS = wp.constant(40)
_HALVINGS = wp.constant(14)
_PASSES = wp.constant(6)
_STILL = wp.constant(real(1e-7))  # [rad]; less is not gone
_LAST = wp.constant(real(2e-5))  # [rad]; a Newton step that is taken without another evaluation
_mat = wp.types.matrix(shape=(MEETINGS, MEETINGS), dtype=real)
_vec = wp.types.vector(length=MEETINGS, dtype=real)


@wp.func
def with_angles(q: hand_angles, finger: int, own: vec6):
    """`q` with the drives of a finger."""
    changed = q
    for d in range(6):
        changed[finger, d] = own[d]
    return changed


@wp.func
def _shared(a: ChainMeeting, b: ChainMeeting):
    """How far the force of meeting `b` moves the links of meeting `a` apart [m/N]."""
    total = real(0.0)
    if a.one == b.one:
        total += wp.dot(a.by_one, b.give_one)
    if a.one == b.two:
        total += wp.dot(a.by_one, b.give_two)
    if a.two == b.one:
        total += wp.dot(a.by_two, b.give_one)
    if a.two == b.two and a.two >= 0:
        total += wp.dot(a.by_two, b.give_two)
    return total


@wp.func
def _solved(system: _mat, right: _vec, count: int):
    """The solution of a symmetric positive system, by elimination."""
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


@wp.func
def _forces(
    state: wp.array2d[ChainRest], i: int, slot: int, meetings: wp.array2d[ChainMeeting],
    count: int, stiffness: real
):
    """Forces of the meetings after a Newton step [N]: links push, and never pull."""
    bears = int(0)
    all = _mat()
    apart = _vec()  # by the fingers' own Newton steps
    for a in range(count):
        one = slot + meetings[i, a].one
        meetings[i, a].give_one = state[i, one].compliance * meetings[i, a].by_one
        apart[a] = -wp.dot(meetings[i, a].give_one, state[i, one].gradient)
        if meetings[i, a].two >= 0:
            two = slot + meetings[i, a].two
            meetings[i, a].give_two = state[i, two].compliance * meetings[i, a].by_two
            apart[a] = apart[a] - wp.dot(meetings[i, a].give_two, state[i, two].gradient)
        if meetings[i, a].depth > ZERO:
            bears = bears | (1 << a)
        for b in range(a + 1):
            all[a, b] = _shared(meetings[i, a], meetings[i, b])
            all[b, a] = all[a, b]
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
def chains_energy(
    scene: Scene, body: int, hands: wp.array2d[Chain], own: int, pose: transform,
    command: hand_angles, q: hand_angles, palm: wp.array2d[vec3], pairs: wp.array[CapsulePair],
    state: wp.array2d[ChainRest], i: int, slot: int, last: int,
    samples: int, ends: wp.array3d[vec3], meetings: wp.array2d[ChainMeeting]
):
    """Energies of the fingers, into row `i` of `state` from `slot` on, and of what they do to one
    another; returns their sum [J] and the number of meetings. `pose` is the hand's in the body's
    frame; the states from `last` on are of drives near by. That of a finger that stands still is
    kept.
    """
    total = real(0.0)
    for f in range(hands.shape[1]):
        at = angles_of(q, f)
        if slot != last and largest_magnitude(at - state[i, last + f].q) == ZERO:
            state[i, slot + f] = state[i, last + f]
        else:
            state[i, slot + f] = finger_energy(scene, body, hands[own, f], pose,
                                               angles_of(command, f), at, state[i, last + f],
                                               samples)
        total += state[i, slot + f].energy
    count = find_chain_meetings(hands, own, q, palm, pairs, _NEAR, ends, meetings, i)
    for a in range(count):
        depth = wp.max(meetings[i, a].depth, ZERO)
        total += real(0.25) * hands[own, 0].skin * depth * depth
    return total, count


@wp.func
def chains_equilibrium(
    scene: Scene, body: int, hands: wp.array2d[Chain], own: int, pose: transform,
    command: hand_angles, palm: wp.array2d[vec3], pairs: wp.array[CapsulePair],
    state: wp.array2d[ChainRest], i: int, samples: int,
    ends: wp.array3d[vec3], meetings: wp.array2d[ChainMeeting], noted: int
):
    """The hand's equilibrium for commands, from the states in the first slots of row `i`, whose
    gradients are those of the commands, with their `noted` meetings. The result is left there;
    returns the number of meetings.

    The first step is always gone, since the valleys of the distance are chosen after it, with
    `samples` compared; then the energy never rises.
    """
    fingers = hands.shape[1]
    stiffness = hands[own, 0].skin * HALF
    slot = int(0)
    best = real(0.0)
    count = int(noted)
    fresh = int(1)  # whether the meetings noted are those of the drives
    q = hand_angles()
    for f in range(fingers):
        q = with_angles(q, f, state[i, f].q)
    for iteration in range(_ITERATIONS):
        force = _forces(state, i, slot, meetings, count, stiffness)
        step = hand_angles()
        longest = real(0.0)
        for f in range(fingers):
            pull = state[i, slot + f].gradient
            for a in range(count):
                if meetings[i, a].one == f:
                    pull -= meetings[i, a].by_one * force[a]
                elif meetings[i, a].two == f:
                    pull -= meetings[i, a].by_two * force[a]
            turn = -(state[i, slot + f].compliance * pull)
            if largest_magnitude(turn) >= _STILL:
                longest = wp.max(longest, largest_magnitude(turn))
                step = with_angles(step, f, turn)
        if iteration > 0 and longest < _LAST:
            q += step
            for f in range(fingers):
                state[i, slot + f].q = angles_of(q, f)
            break
        scale = real(1.0)
        found = int(0)
        for _halving in range(_HALVINGS):
            energy, met = chains_energy(
                scene, body, hands, own, pose, command, q + step * scale, palm, pairs, state, i,
                fingers - slot, slot, wp.where(iteration == 0, samples, 0), ends, meetings)
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
    if slot > 0:
        for f in range(fingers):
            state[i, f] = state[i, fingers + f]
    if fresh == 0:
        count = find_chain_meetings(hands, own, q, palm, pairs, _NEAR, ends,
                                    meetings, i)
    return count
