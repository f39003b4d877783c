# type: ignore  # Warp functions, which type checkers cannot follow
"""The equilibrium of a hand whose fingers touch one another or the palm.

The energy is that of the four fingers (`energy`) and of the skin between them,

    E(q) = sum over fingers E_f(q_f) + sum over pairs of links 1/2 k/2 max(0, 2 r - d(q))^2

with d the distance of two links' axes; two skins give in series, and do not rub. Palm and wrist are
capsules too. Newton steps: each finger's inverse Hessian is known, and what links do to one another
adds a term of rank one each, whose forces solve a small system (Woodbury).
"""

import warp as wp

from warpgrasp.closing.link_gap import above_palm, link_end, links_within, palm_capsule
from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat44, real, struct, transform, vec4
from warpgrasp.finger.energy import Equilibrium, finger_energy, largest_magnitude
from warpgrasp.finger.friction import Friction, with_friction
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_pair import segment_pair
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    Hand,
    finger_base,
    finger_jacobian,
    finger_pose,
    link_start,
)

MEETINGS = 8
"""Places where links of a hand touch one another that are resolved; there are hardly three."""
_MEETINGS = wp.constant(MEETINGS)
_PALM = wp.constant(4)  # in the place of a finger
_NEAR = wp.constant(real(2e-3))  # [m]: links nearer than this may meet in a step
_ITERATIONS = wp.constant(40)
_HALVINGS = wp.constant(14)
_PASSES = wp.constant(6)
_LAST = wp.constant(real(2e-5))  # [rad]; a Newton step that is taken without another evaluation
_STILL = wp.constant(real(1e-7))  # [rad]; less is not gone
_mat = wp.types.matrix(shape=(MEETINGS, MEETINGS), dtype=real)
_vec = wp.types.vector(length=MEETINGS, dtype=real)


@struct
class Meeting:
    """Two links that touch or are near: how deep [m], and how their distance changes with the
    joints of each finger [m/rad]; `two` is 4 for the palm."""

    one: int
    two: int
    link: int
    depth: real
    by_one: vec4
    by_two: vec4
    give_one: vec4
    """How far a newton between them turns the joints of each [rad/N]."""
    give_two: vec4


@wp.func
def pair_bit(one: int, two: int):
    """The bit of a pair of fingers, `one` < `two`, or of a finger and the palm, `two` 4."""
    return 1 << (5 * one + two)


@wp.func
def in_pairs(pairs: int, finger: int):
    """Whether a finger is one of any pair."""
    mine = pairs & (31 << (5 * finger))
    for one in range(finger):
        mine = mine | (pairs & pair_bit(one, finger))
    return mine != 0


@wp.func
def _note(
    meetings: wp.array2d[Meeting], i: int, count: int, one: int, two: int, link: int, depth: real,
    by_one: vec4, by_two: vec4
):
    if count < _MEETINGS:
        meetings[i, count].one = one
        meetings[i, count].two = two
        meetings[i, count].link = link
        meetings[i, count].depth = depth
        meetings[i, count].by_one = by_one
        meetings[i, count].by_two = by_two
        return count + 1
    return count


@wp.func
def find_meetings(
    hands: wp.array2d[Hand], own: int, mount: real, q: mat44, pairs: int,
    meetings: wp.array2d[Meeting], i: int
):
    """Notes the pairs of links that touch or are near, in row `i`; returns their number.

    `pairs` has a bit for each pair of fingers that may meet, see `pair_bit`.
    """
    count = int(0)
    for one in range(4):
        if (pairs & (31 << (5 * one))) == 0:
            continue
        hand = hands[own, one]
        f = finger_pose(hand, finger_base(hand, one), q[one])
        for two in range(one + 1, 4):
            if (pairs & pair_bit(one, two)) == 0:
                continue
            other = hands[own, two]
            g = finger_pose(other, finger_base(other, two), q[two])
            both = hand.link_radius + other.link_radius
            for a in range(3):
                for b in range(3):
                    if not links_within(hand, f, a, other, g, b, _NEAR):
                        continue
                    near = segment_pair(link_start(f, a), link_end(f, a), link_start(g, b),
                                        link_end(g, b))
                    if near.apart < both + _NEAR:
                        count = _note(meetings, i, count, one, two, a, both - near.apart,
                                      finger_jacobian(f, a, near.one, near.way),
                                      finger_jacobian(g, b, near.two, -near.way))
        if (pairs & pair_bit(one, _PALM)) == 0:
            continue
        thick = hand.palm_thickness * HALF
        for a in range(1, 3):
            if above_palm(hand, f, a, _NEAR):
                continue
            for bar in range(4):
                near = segment_pair(
                    link_start(f, a), link_end(f, a), palm_capsule(hand, mount, bar, 0),
                    palm_capsule(hand, mount, bar, 1))
                if near.apart < hand.link_radius + thick + _NEAR:
                    count = _note(meetings, i, count, one, _PALM, a,
                                  hand.link_radius + thick - near.apart,
                                  finger_jacobian(f, a, near.one, near.way),
                                  vec4(ZERO, ZERO, ZERO, ZERO))
    return count


@wp.func
def _shared(a: Meeting, b: Meeting):
    """How far the force of meeting `b` moves the links of meeting `a` apart [m/N]."""
    total = real(0.0)
    if a.one == b.one:
        total += wp.dot(a.by_one, b.give_one)
    if a.one == b.two:
        total += wp.dot(a.by_one, b.give_two)
    if a.two == b.one:
        total += wp.dot(a.by_two, b.give_one)
    if a.two == b.two and a.two != _PALM:
        total += wp.dot(a.by_two, b.give_two)
    return total


@wp.func
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


@wp.func
def meeting_forces(
    state: wp.array2d[Equilibrium], i: int, slot: int, meetings: wp.array2d[Meeting], count: int,
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
        if meetings[i, a].two != _PALM:
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
def stands(state: wp.array2d[Equilibrium], i: int, slot: int, q: vec4):
    """Whether a finger's joints are those of its state."""
    return largest_magnitude(q - state[i, slot].q) == ZERO


@wp.func
def hand_energy(
    scene: Scene, body: int, hands: wp.array2d[Hand], own: int, pose: transform, mount: real,
    command: mat44, q: mat44, pairs: int, state: wp.array2d[Equilibrium], i: int, slot: int,
    last: int, samples: int, keep: int, meetings: wp.array2d[Meeting],
    frictions: wp.array2d[Friction]
):
    """Energies of the fingers, into row `i` of `state` from `slot` on, and of what they do to one
    another; returns their sum [J] and the number of meetings. `pose` is the hand's in the body's
    frame; the states from `last` on are of joints near by. Row `i` of `frictions` is that of their
    contacts with the body; it is not read without friction. Fingers in none of `pairs` are left
    out, and with `keep` 1 the state of one that stands still is kept.
    """
    total = real(0.0)
    for f in range(4):
        if not in_pairs(pairs, f):
            continue
        hand = hands[own, f]
        if keep == 1 and stands(state, i, last + f, q[f]):
            state[i, slot + f] = state[i, last + f]
        else:
            state[i, slot + f] = finger_energy(
                scene, body, hand, wp.transform_multiply(pose, finger_base(hand, f)), command[f],
                q[f], state[i, last + f], samples)
            if hand.friction > ZERO:
                state[i, slot + f] = with_friction(state[i, slot + f], hand.skin, frictions[i, f])
        total += state[i, slot + f].energy
    count = find_meetings(hands, own, mount, q, pairs, meetings, i)
    for a in range(count):
        depth = wp.max(meetings[i, a].depth, ZERO)
        total += real(0.25) * hands[own, 0].skin * depth * depth
    return total, count


@wp.func
def newton_step(
    state: wp.array2d[Equilibrium], i: int, slot: int, meetings: wp.array2d[Meeting], count: int,
    stiffness: real, pairs: int
):
    """How far a Newton step turns the joints of each finger, a row each; a finger that is all but
    at rest stays where it is."""
    force = meeting_forces(state, i, slot, meetings, count, stiffness)
    step = mat44()
    for f in range(4):
        if not in_pairs(pairs, f):
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
def largest_step(step: mat44):
    """The largest absolute value of a step."""
    largest = real(0.0)
    for f in range(4):
        largest = wp.max(largest, largest_magnitude(step[f]))
    return largest


@wp.func
def move_commands(
    hands: wp.array2d[Hand], own: int, moves: mat44, pairs: int, state: wp.array2d[Equilibrium],
    i: int
):
    """States in slots 0 to 3 of row `i` at the same joints with commands moved by `moves` [rad], a
    row each finger: only the servos' part of the gradient changes."""
    for f in range(4):
        if in_pairs(pairs, f):
            pull = moves[f] * hands[own, f].stiffness
            state[i, f].drive -= pull
            state[i, f].gradient -= pull


@wp.func
def hand_equilibrium(
    scene: Scene, body: int, hands: wp.array2d[Hand], own: int, pose: transform, mount: real,
    command: mat44, pairs: int, state: wp.array2d[Equilibrium], i: int, samples: int,
    meetings: wp.array2d[Meeting], noted: int, frictions: wp.array2d[Friction]
):
    """The hand's equilibrium for commands (a row each finger), from the states in slots 0 to 3 of
    row `i` with their `noted` meetings; see `move_commands`. The result is left there; returns the
    number of meetings.

    The first step is always gone, since the valleys of the distance are chosen after it, with
    `samples` compared; then the energy never rises.
    """
    stiffness = hands[own, 0].skin * HALF
    slot = int(0)
    best = real(0.0)
    count = int(noted)
    # Friction may have changed since the states were found.
    rubs = hands[own, 0].friction > ZERO
    fresh = int(1)  # whether the meetings noted are those of the joints
    q = mat44()
    for f in range(4):
        q[f] = state[i, f].q
    for iteration in range(_ITERATIONS):
        step = newton_step(state, i, slot, meetings, count, stiffness, pairs)
        if iteration > 0 and largest_step(step) < _LAST:
            q += step
            for f in range(4):
                state[i, slot + f].q = q[f]
            break
        scale = real(1.0)
        found = int(0)
        for _halving in range(_HALVINGS):
            energy, met = hand_energy(scene, body, hands, own, pose, mount, command,
                                      q + step * scale, pairs, state, i, 4 - slot, slot,
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
        slot = 4 - slot
    if slot == 4:
        for f in range(4):
            if in_pairs(pairs, f):
                state[i, f] = state[i, 4 + f]
    if fresh == 0:
        count = find_meetings(hands, own, mount, q, pairs, meetings, i)
    return count
