# type: ignore  # Warp functions, which type checkers cannot follow
"""Fingers of a hand of chains that meet: which closings links may touch in, and how these go on.

`chain_closing_kernel` closes each finger as if the others were not there. Here all fingers of a
hand are brought to rest together from the step at which links first come near one another or the
palm, step by step, each stopped by its own readings; a finger that has stopped holds its command
and is pushed. Where nothing is near any more, fingers that nothing has touched end as they did
alone.

Skins of links do not rub. While no finger that moves, or that another one pushes, presses body or
table, where the hand rests depends on its commands alone and not on the way there: steps whose
readings stop nothing are left out.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain, ChainPose, chain_free_joints, vec6
from warpgrasp.chain.torque_sensor_kernel import TorqueSensor, guard_reading
from warpgrasp.chain_closing.chain_closing_kernel import guarded_torque, tip_force, touches
from warpgrasp.chain_closing.chain_near_kernel import first_near
from warpgrasp.chain_closing.chain_record import ChainClosingRow, ChainTruthRow, hand_from_body
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.finger.chain_energy import ChainRest, free_chain
from warpgrasp.finger.chain_friction import ChainFriction
from warpgrasp.finger.equilibrium import finger_equilibrium
from warpgrasp.finger.friction import NO_FRICTION
from warpgrasp.finger.path_record import true_command
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.hand_rest.chain_meetings import (
    FINGERS,
    CapsulePair,
    ChainBuild,
    ChainMeeting,
    hand_angles,
    near_pairs,
)
from warpgrasp.hand_rest.hand_balance import hand_balance
from warpgrasp.hand_rest.hand_equilibrium import hand_energy, hand_equilibrium, move_commands
from warpgrasp.hand_rest.meetings import fingers_met
from warpgrasp.hand_rest.rubbing_hand import rubbed_at, rubbing_hand
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.chain_balance import ChainGrip

_shares = wp.types.vector(length=FINGERS, dtype=real)
_SURE = wp.constant(real(0.7))  # share of a threshold: noise stops no finger that reads less
_SLOW = wp.constant(real(1e-3))  # share of it a step: a rise that may be noise alone
_LONGEST = wp.constant(8)  # steps at once
_NONE = wp.constant(real(1e9))  # [rad]; at no drive
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))


@wp.func
def _hangs_on_commands(
    hands: wp.array2d[Chain], own: int, state: wp.array2d[ChainRest],
    meetings: wp.array2d[ChainMeeting], i: int, count: int, stopped: int
):
    """Whether where a hand rests depends on its commands alone."""
    moved = ~stopped
    for a in range(count):
        moved = moved | fingers_met(meetings[i, a])
    presses = int(0)
    for f in range(hands.shape[1]):
        if (moved & (1 << f)) != 0 and touches(hands[own, f], state[i, f]):
            presses = int(1)
    return presses == 0


@wp.func
def _steps_at_once(
    felt: wp.array4d[ChainClosingRow], truth: wp.array4d[ChainTruthRow], w: int, p: int, g: int,
    alone: int, s: int, gone: int, most: real, before: real
):
    """How many steps to go from step `s` on, of a hand that `gone` steps led from `before` to
    `most` of the threshold; at least one. Of `alone`, a bit each, none is taken past the step
    before it touches, or that it stops at, closing alone."""
    rise = wp.max((most - before) / real(gone), _SLOW)
    steps = wp.min(wp.min(2 * gone, _LONGEST), int((_SURE - most) / rise))
    for f in range(felt.shape[3]):
        if (alone & (1 << f)) != 0:
            if truth[w, p, g, f].touched > s:
                steps = wp.min(steps, truth[w, p, g, f].touched - 1 - s)
            steps = wp.min(steps, felt[w, p, g, f].step - s)
    return wp.max(steps, 1)


@wp.kernel(enable_backward=False, module="warpgrasp.chain_closing.chain_closing_kernels")
def chain_meeting_kernel(
    first: int,
    has_lanes: wp.bool,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Chain],
    believed: wp.array2d[Chain],
    sensors: wp.array2d[TorqueSensor],
    palm: wp.array2d[vec3],
    palm_balls: wp.array[vec4],
    pairs: wp.array[CapsulePair],
    order: wp.array3d[int],
    slack: wp.array3d[real],
    # Closing in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[vec6],
    come: wp.array4d[real],
    command_count: wp.array[int],
    place: wp.array[wp.vec3i],
    near: wp.array[int],
    # Scratch:
    state: wp.array2d[ChainRest],
    meetings: wp.array2d[ChainMeeting],
    ends: wp.array3d[vec3],
    balls: wp.array2d[vec4],
    listed: wp.array2d[int],
    come_since: wp.array2d[real],
    come_to: wp.array2d[vec6],
    due: wp.array2d[real],
    poses: wp.array2d[ChainPose],
    posed: wp.array2d[vec6],
    frictions: wp.array2d[ChainFriction],
    grips: wp.array2d[ChainGrip],
    # Made right:
    felt: wp.array4d[ChainClosingRow],
    truth: wp.array4d[ChainTruthRow],
    ended: wp.array4d[ChainGrip],
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
    build.has_lanes = has_lanes
    build.palm = palm
    build.palm_balls = palm_balls
    build.pairs = pairs
    build.ends = ends
    build.balls = balls
    build.listed = listed
    build.come = come_since
    build.come_to = come_to
    build.due = due
    build.poses = poses
    build.posed = posed
    for f in range(fingers):
        posed[i, f] = vec6(_NONE, ZERO, ZERO, ZERO, ZERO, ZERO)
    build.up = wp.quat_rotate_inv(wp.transform_get_rotation(base), vec3(ZERO, ZERO, ONE))
    build.order = order
    build.slack = slack
    build.world = w % order.shape[0]
    build.grasp = g
    fresh = int(1)
    gone = int(1)  # steps at once
    most_before = real(0.0)
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
                if row.status == _NO_CONTACT and row.step < last:
                    stopped = stopped | (1 << f)  # it stays open
                command[f] = true_command(hand, path, g, f, before)
                rest = free_chain(chain_free_joints(hand, base, command[f]))
                begun = truth[w, p, g, f].touched
                if hand.friction > ZERO and s > row.step and truth[w, p, g, f].link == 0 and (
                        truth[w, p, g, f].met == 0):
                    grips[i, f] = ended[w, p, g, f]  # it pressed where it stopped
                elif hand.friction > ZERO:
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
            build = near_pairs(hands, own, build, command, q, hand_angles(), i, 1)
            if hands[own, 0].friction > ZERO:
                count = hand_balance(scene, which, hands, own, base, build, command, q, state, i, 0,
                                     0, LINK_SAMPLES, 0, meetings, 0, grips)
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
        now_at = hand_angles()
        for f in range(fingers):
            now_at[f] = state[i, f].q
        build = near_pairs(hands, own, build, command, now_at, moves, i, 0)
        move_commands(hands, own, build, moves, state, i)
        if hands[own, 0].friction > ZERO:
            count = rubbing_hand(scene, which, hands, own, base, build, command, moves, state, i,
                                 LINK_SAMPLES, meetings, count, frictions, grips)
        else:
            count = hand_equilibrium(scene, which, hands, own, base, build, command, state, i,
                                     LINK_SAMPLES, meetings, count, frictions)
        met = int(touched)
        for a in range(count):
            if meetings[i, a].depth > ZERO:
                met = met | (fingers_met(meetings[i, a]) & ~stopped)
        surely = _hangs_on_commands(hands, own, state, meetings, i, count, stopped)
        share = _shares()  # of the threshold
        reading = _shares()
        most = real(0.0)
        for f in range(fingers):
            if (met & ~stopped & (1 << f)) != 0:
                hand = hands[own, f]
                drawn = guard_reading(
                    sensors[own_sensor, f], hand.drives,
                    guarded_torque(hand, believed[0, f], base, command[f], state[i, f].q),
                    tip_force(hand, state[i, f]),
                    path[g, f, s] - path[g, f, wp.max(s - 1, 0)],
                    counter_key(counter_key(counter_key(stream, f), _TENSION_STEP), s))
                share[f] = drawn[0]
                reading[f] = drawn[1]
                most = wp.max(most, drawn[0])
        if gone > 1 and (most > _SURE or not surely):
            # A step that was left out may have stopped a finger, or pressed it: they are taken.
            s -= gone - 1
            gone = int(1)
            continue
        touched = int(met)
        for f in range(fingers):
            if (stopped & (1 << f)) == 0:
                hand = hands[own, f]
                rest = state[i, f]
                at = command[f]
                # What nothing has touched stops where it did alone: this equilibrium differs in
                # its last digits, which may decide a reading at the threshold.
                stops = felt[w, p, g, f].status == _CONTACT and s >= felt[w, p, g, f].step
                if (touched & (1 << f)) != 0:
                    stops = share[f] > ONE
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
                        felt[w, p, g, f].reading = reading[f]
                    for a in range(count):
                        if meetings[i, a].one == f or meetings[i, a].two == f:
                            truth[w, p, g, f].self_depth = wp.max(
                                truth[w, p, g, f].self_depth, meetings[i, a].depth)
        for f in range(fingers):
            if s >= felt[w, p, g, f].step:
                truth[w, p, g, f].rest = state[i, f].q
        if stopped == (1 << fingers) - 1:
            break
        steps = int(1)
        if surely and most < _SURE:
            steps = wp.min(wp.max(last - s, 1), _steps_at_once(
                felt, truth, w, p, g, ((1 << fingers) - 1) & ~stopped & ~touched, s, gone, most,
                most_before))
        if (touched & ~stopped) == 0 and s < last:
            # Those that go on have met nothing: each goes on alone until links are near again.
            steps = int(1)
            ahead = first_near(hands, base, path, come, build, felt, truth, w, p, g, i, s + 1, last)
            if ahead > s + 1:
                steps = ahead - s
                fresh = int(1)
        gone = wp.where(fresh == 1, 1, steps)
        most_before = real(most)
        s += steps
