# type: ignore  # Warp functions, which type checkers cannot follow
"""Fingers of a hand of chains that meet: which closings links may touch in, and how these go on.

`chain_closing_kernel` closes each finger as if the others were not there. Here all fingers of a
hand are brought to rest together from the step at which links first come near one another or the
palm, step by step, each stopped by its own readings; a finger that has stopped holds its command
and is pushed. Where nothing is near any more, fingers that nothing has touched end as they did
alone.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain, chain_free_joints, vec6
from warpgrasp.chain.torque_sensor_kernel import TorqueSensor, guard_reading
from warpgrasp.chain_closing.chain_closing_kernel import guarded_torque, tip_force
from warpgrasp.chain_closing.chain_meetings import (
    CapsulePair,
    ChainBuild,
    ChainMeeting,
    hand_angles,
    hand_room,
    least_gap,
    place_capsules,
)
from warpgrasp.chain_closing.chain_record import ChainClosingRow, ChainTruthRow, hand_from_body
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec3
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.finger.chain_energy import ChainRest, free_chain
from warpgrasp.finger.chain_friction import ChainFriction
from warpgrasp.finger.equilibrium import finger_equilibrium
from warpgrasp.finger.friction import NO_FRICTION
from warpgrasp.finger.path_record import true_command
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.hand_rest.hand_balance import hand_balance
from warpgrasp.hand_rest.hand_equilibrium import hand_energy, hand_equilibrium, move_commands
from warpgrasp.hand_rest.rubbing_hand import rubbed_at, rubbing_hand
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.chain_balance import ChainGrip

wp.set_module_options({"max_unroll": 1})
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))
_ROUGH = wp.constant(real(1e-4))  # [m]: `chain_free_joints` is of second order
_TWO = wp.constant(real(2.0))


@wp.func
def _stray(row: ChainClosingRow, true: ChainTruthRow, s: int):
    """How far a finger that closes alone may be from where `_angles_at` has it [m]."""
    if s >= row.step:
        return ZERO
    if true.touched < 0 or s < true.touched:
        return _ROUGH
    return _ROUGH + true.strayed


@wp.func
def _angles_at(
    hand: Chain, base: transform, path: wp.array3d[vec6], row: ChainClosingRow,
    true: ChainTruthRow, g: int, finger: int, s: int
):
    """Drives of a finger that closes alone: where it rests, or where its command would have it."""
    if s >= row.step:
        return true.q
    return chain_free_joints(hand, base, path[g, finger, s] - hand.offset)


@wp.func
def first_near(
    hands: wp.array2d[Chain], own: int, base: transform, path: wp.array3d[vec6],
    swept: wp.array3d[real], build: ChainBuild, felt: wp.array4d[ChainClosingRow],
    truth: wp.array4d[ChainTruthRow], w: int, p: int, g: int, i: int, begin: int, last: int
):
    """The first step from `begin` on at which links of a hand may touch, `last` + 1 if none.

    Distances are looked at while they cannot have been used up (conservative advancement); `swept`
    bounds how far any place of a finger has come. Pairs that are both at rest before `begin` are
    left out.
    """
    fingers = hands.shape[1]
    end = int(0)
    for f in range(fingers):
        end = wp.max(end, felt[w, p, g, f].step)
    s = int(begin)
    seen = begin - 1  # the step looked at before
    while s <= last:
        q = hand_angles()
        for f in range(fingers):
            q[f] = _angles_at(hands[own, f], base, path, felt[w, p, g, f], truth[w, p, g, f], g, f,
                              s)
        place_capsules(hands, own, q, build.ends, i)
        off = hand_room()
        moving = int(0)
        strays = int(end)  # from where a finger may be off farther
        for f in range(fingers):
            off[f] = _stray(felt[w, p, g, f], truth[w, p, g, f], s)
            if felt[w, p, g, f].step > seen:
                moving = moving | (1 << f)
            if truth[w, p, g, f].touched > s:
                strays = wp.min(strays, truth[w, p, g, f].touched)
        room = least_gap(build, i, off, moving)
        if room <= ZERO:
            return s
        if s >= end:
            return last + 1
        seen = int(s)
        ahead = s + 1
        while ahead < strays:
            come = real(0.0)
            for f in range(fingers):
                stop = felt[w, p, g, f].step
                come = wp.max(come, swept[g, f, wp.min(ahead + 1, stop)]
                              - swept[g, f, wp.min(s, stop)])
            if come * _TWO >= room:
                break
            ahead += 1
        s = int(ahead)
    return last + 1


@wp.kernel(enable_backward=False)
def chain_near_kernel(
    first: int,
    # Robot:
    hands: wp.array2d[Chain],
    palm: wp.array2d[vec3],
    pairs: wp.array[CapsulePair],
    # Closing in:
    body_pose: wp.array[transform],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[vec6],
    swept: wp.array3d[real],
    command_count: wp.array[int],
    place: wp.array[wp.vec3i],
    felt: wp.array4d[ChainClosingRow],
    truth: wp.array4d[ChainTruthRow],
    # Scratch:
    ends: wp.array3d[vec3],
    # Out:
    near: wp.array[int],
):
    """The step at which links of a hand first come near one another; -1 where they never do."""
    i = wp.tid() + first
    w = place[i][0]
    last = command_count[place[i][2]] - 1
    base = hand_from_body(body_pose, hand_pose, w, place[i][1])
    build = ChainBuild()
    build.palm = palm
    build.pairs = pairs
    build.ends = ends
    near[i] = first_near(hands, w % hands.shape[0], base, path, swept, build, felt, truth, w,
                         place[i][1], place[i][2], i, 0, last)
    if near[i] > last:
        near[i] = -1


@wp.kernel(enable_backward=False)
def chain_meeting_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Chain],
    believed: wp.array2d[Chain],
    sensors: wp.array2d[TorqueSensor],
    palm: wp.array2d[vec3],
    pairs: wp.array[CapsulePair],
    # Closing in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[vec6],
    swept: wp.array3d[real],
    command_count: wp.array[int],
    place: wp.array[wp.vec3i],
    near: wp.array[int],
    # Scratch:
    state: wp.array2d[ChainRest],
    meetings: wp.array2d[ChainMeeting],
    ends: wp.array3d[vec3],
    frictions: wp.array2d[ChainFriction],
    grips: wp.array2d[ChainGrip],
    # Made right:
    felt: wp.array4d[ChainClosingRow],
    truth: wp.array4d[ChainTruthRow],
):
    """A hand whose links may touch one another; `place` says which."""
    i = wp.tid() + first
    w = place[i][0]
    p = place[i][1]
    g = place[i][2]
    own = w % hands.shape[0]
    own_sensor = w % sensors.shape[0]
    which = body[w % body.shape[0]]
    base = hand_from_body(body_pose, hand_pose, w, p)
    fingers = hands.shape[1]
    last = command_count[g] - 1
    stream = counter_key(counter_key(key[w], probe_number[w, p]), g)
    s = near[i]
    touched = int(0)  # fingers that another one, or the palm, has touched: a bit each
    stopped = int(0)
    count = int(0)
    command = hand_angles()
    build = ChainBuild()
    build.palm = palm
    build.pairs = pairs
    build.ends = ends
    fresh = int(1)
    while s <= last:
        if fresh == 1:
            # From where each finger, closing alone, was a step before.
            fresh = int(0)
            stopped = int(0)
            q = hand_angles()
            for f in range(fingers):
                hand = hands[own, f]
                row = felt[w, p, g, f]
                before = wp.min(wp.max(s - 1, 0), row.step)
                command[f] = true_command(hand, path, g, f, before)
                rest = free_chain(chain_free_joints(hand, base, command[f]))
                begun = truth[w, p, g, f].touched
                if hand.friction > ZERO:
                    rubbed = rubbed_at(scene, which, hand, base, path, g, f, begun, before,
                                       LINK_SAMPLES)
                    rest = rubbed.rest
                    grips[i, f] = rubbed.grip
                if s > row.step:
                    rest = free_chain(truth[w, p, g, f].q)
                    if row.status == _CONTACT:
                        stopped = stopped | (1 << f)
                elif hand.friction == ZERO and begun >= 0 and before >= begun:
                    rest = finger_equilibrium(scene, which, hand, base, command[f], rest.q, rest,
                                              LINK_SAMPLES, NO_FRICTION)
                state[i, f] = rest
                q[f] = rest.q
            if hands[own, 0].friction > ZERO:
                count = hand_balance(scene, which, hands, own, base, build, command, q, state, i, 0,
                                     0, LINK_SAMPLES, 0, meetings, grips)
                for f in range(fingers):
                    grips[i, f] = grips[i, fingers + f]
            else:
                _begun, count = hand_energy(scene, which, hands, own, base, build, command, q,
                                            state, i, 0, 0, LINK_SAMPLES, 0, meetings, frictions)
        moves = hand_angles()
        for f in range(fingers):
            if (stopped & (1 << f)) == 0:
                now = true_command(hands[own, f], path, g, f, s)
                moves[f] = now - command[f]
                command[f] = now
        move_commands(hands, own, build, moves, state, i)
        if hands[own, 0].friction > ZERO:
            count = rubbing_hand(scene, which, hands, own, base, build, command, moves, state, i,
                                 LINK_SAMPLES, meetings, count, frictions, grips)
        else:
            count = hand_equilibrium(scene, which, hands, own, base, build, command, state, i,
                                     LINK_SAMPLES, meetings, count, frictions)
        for a in range(count):
            if meetings[i, a].depth > ZERO:
                for f in range(fingers):
                    if (stopped & (1 << f)) == 0 and (
                            meetings[i, a].one == f or meetings[i, a].two == f):
                        touched = touched | (1 << f)
        for f in range(fingers):
            if (stopped & (1 << f)) == 0:
                hand = hands[own, f]
                rest = state[i, f]
                at = command[f]
                drawn = guard_reading(
                    sensors[own_sensor, f], hand.drives,
                    guarded_torque(hand, believed[0, f], base, at, rest.q), tip_force(hand, rest),
                    path[g, f, s] - path[g, f, wp.max(s - 1, 0)],
                    counter_key(counter_key(counter_key(stream, f), _TENSION_STEP), s))
                stops = drawn[0] > ONE
                if (touched & (1 << f)) == 0:
                    # It stops where it did alone: this equilibrium differs in its last digits,
                    # which may decide a reading at the threshold.
                    stops = felt[w, p, g, f].status == _CONTACT and s >= felt[w, p, g, f].step
                if stops:
                    stopped = stopped | (1 << f)
                if (touched & (1 << f)) != 0:
                    # It is read where it stops; what pushes it later comes too late for that.
                    truth[w, p, g, f].met = 1
                    truth[w, p, g, f].q = rest.q
                    truth[w, p, g, f].torque = wp.cw_mul(at - rest.q, hand.stiffness)
                    truth[w, p, g, f].along = rest.along
                    truth[w, p, g, f].bend = rest.bend
                    truth[w, p, g, f].depth = rest.depth
                    truth[w, p, g, f].self_depth = ZERO
                    truth[w, p, g, f].link = -1
                    felt[w, p, g, f].status = _NO_CONTACT
                    felt[w, p, g, f].step = last
                    if stops:
                        truth[w, p, g, f].link = 0
                        felt[w, p, g, f].status = _CONTACT
                        felt[w, p, g, f].step = s
                        felt[w, p, g, f].reading = drawn[1]
                    for a in range(count):
                        if meetings[i, a].one == f or meetings[i, a].two == f:
                            truth[w, p, g, f].self_depth = wp.max(
                                truth[w, p, g, f].self_depth, meetings[i, a].depth)
        for f in range(fingers):
            if s >= felt[w, p, g, f].step:
                truth[w, p, g, f].rest = state[i, f].q
        if stopped == (1 << fingers) - 1:
            break
        s += 1
        if (touched & ~stopped) == 0 and s <= last:
            # Those that go on have met nothing: each goes on alone until links are near again.
            ahead = first_near(hands, own, base, path, swept, build, felt, truth, w, p, g, i, s,
                               last)
            if ahead > s:
                s = ahead
                fresh = int(1)
