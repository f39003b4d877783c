# type: ignore  # Warp functions, which type checkers cannot follow
"""Fingers that meet: which closings links of a hand may touch in, and how these go on.

`closing_kernel` closes each finger as if the others were not there. Most closings need nothing
else: `near_kernel` finds those in which links never come near one another. In the others all four
fingers are closed together from the step at which they first come near (`meeting_kernel`), step by
step, each stopped by its own readings; a finger that has stopped holds its command and is pushed.
Where nothing is near any more, fingers that nothing has touched end as they did alone.
"""

import warp as wp

from warpgrasp.closing.closing_record import ClosingRow, ClosingTruthRow
from warpgrasp.closing.near_kernel import first_near, pairs_that_may
from warpgrasp.core.dtypes import ZERO, mat44, real, transform, vec4
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.finger.energy import Equilibrium, free_equilibrium
from warpgrasp.finger.equilibrium import finger_equilibrium
from warpgrasp.finger.friction import NO_FRICTION, Friction
from warpgrasp.finger.path_record import LinkStep, PathStep, true_command
from warpgrasp.finger.torque_bounds import stop_reading
from warpgrasp.geometry.scene import Scene, body_is_convex
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.hand_rest.hand_balance import hand_balance
from warpgrasp.hand_rest.hand_equilibrium import hand_energy, hand_equilibrium, move_commands
from warpgrasp.hand_rest.meetings import PALM, HandBuild, Meeting, in_pairs
from warpgrasp.hand_rest.rubbing_hand import rubbed_at, rubbing_hand
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_base, free_joints
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.balance import Grip

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))


@wp.func
def _note_rest(
    truth: wp.array4d[ClosingTruthRow], felt: wp.array4d[ClosingRow], w: int, p: int, g: int,
    f: int, rest: Equilibrium, command: vec4, stiffness: real, stops: bool, s: int, last: int,
    reading: real
):
    truth[w, p, g, f].met = 1
    truth[w, p, g, f].q = rest.q
    truth[w, p, g, f].torque = (command - rest.q) * stiffness
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
        felt[w, p, g, f].difference = reading


@wp.kernel(enable_backward=False, module="warpgrasp.closing.closing_kernels")
def meeting_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Hand],
    sensors: wp.array2d[TendonSensor],
    mount: real,
    # Closing in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[PathStep],
    links: wp.array4d[LinkStep],
    command_count: wp.array[int],
    place: wp.array[wp.vec3i],
    near: wp.array3d[int],
    # Scratch:
    state: wp.array2d[Equilibrium],
    meetings: wp.array2d[Meeting],
    frictions: wp.array2d[Friction],
    grips: wp.array2d[Grip],
    # Made right:
    felt: wp.array4d[ClosingRow],
    truth: wp.array4d[ClosingTruthRow],
):
    """A hand whose links may touch one another; `place` says which."""
    i = wp.tid() + first
    w = place[i][0]
    p = place[i][1]
    g = place[i][2]
    own = w % hands.shape[0]
    own_sensor = w % sensors.shape[0]
    which = body[w % body.shape[0]]
    pose = wp.transform_multiply(wp.transform_inverse(body_pose[w]), hand_pose[w, p])
    last = command_count[g] - 1
    k = hands[own, 0].stiffness
    samples = wp.where(body_is_convex(scene, which), 0, LINK_SAMPLES)
    stream = counter_key(counter_key(key[w], probe_number[w, p]), g)

    s = near[w, p, g]
    pairs = pairs_that_may(hands, sensors, own, own_sensor, path, felt, truth, w, p, g)
    build = HandBuild()
    build.mount = mount
    build.pairs = pairs
    touched = int(0)  # fingers that another one, or the palm, has touched: a bit each
    stopped = int(0)
    count = int(0)
    command = mat44()
    fresh = int(1)
    while s <= last:
        if fresh == 1:
            # From where each finger, closing alone, was a step before.
            fresh = int(0)
            stopped = int(0)
            q = mat44()
            for f in range(4):
                if not in_pairs(pairs, f):
                    stopped = stopped | (1 << f)  # it closes alone
                    continue
                hand = hands[own, f]
                base = wp.transform_multiply(pose, finger_base(hand, f))
                row = felt[w, p, g, f]
                before = wp.min(wp.max(s - 1, 0), row.step)
                if row.status == _NO_CONTACT and row.step < last:
                    stopped = stopped | (1 << f)  # it stays open
                command[f] = true_command(hand, path, g, f, before)
                rest = free_equilibrium(free_joints(hand, base, command[f]))
                begun = truth[w, p, g, f].touched
                if hand.friction > ZERO:
                    rubbed = rubbed_at(scene, which, hand, base, path, g, f, begun, before,
                                       samples)
                    rest = rubbed.rest
                    grips[i, f] = rubbed.grip
                if s > row.step:
                    rest = free_equilibrium(truth[w, p, g, f].q)
                    if row.status == _CONTACT:
                        stopped = stopped | (1 << f)
                elif hand.friction == ZERO and begun >= 0 and before >= begun:
                    rest = finger_equilibrium(scene, which, hand, base, command[f], rest.q, rest,
                                              samples, NO_FRICTION)
                state[i, f] = rest
                q[f] = rest.q
            if hands[own, 0].friction > ZERO:
                count = hand_balance(scene, which, hands, own, pose, build, command, q,
                                     state, i, 0, 0, samples, 0, meetings, 0, grips)
                for f in range(4):
                    grips[i, f] = grips[i, 4 + f]
            else:
                _begun, count = hand_energy(scene, which, hands, own, pose, build, command, q,
                                            state, i, 0, 0, samples, 0, meetings,
                                            frictions)
        moves = mat44()
        for f in range(4):
            if (stopped & (1 << f)) == 0:
                now = true_command(hands[own, f], path, g, f, s)
                moves[f] = now - command[f]
                command[f] = now
        move_commands(hands, own, build, moves, state, i)
        if hands[own, 0].friction > ZERO:
            count = rubbing_hand(scene, which, hands, own, pose, build, command, moves,
                                 state, i, samples, meetings, count, frictions, grips)
        else:
            count = hand_equilibrium(scene, which, hands, own, pose, build, command, state,
                                     i, samples, meetings, count, frictions)
        touches = int(0)
        for a in range(count):
            if meetings[i, a].depth > ZERO:
                touches = touches | (1 << meetings[i, a].one)
                if meetings[i, a].two != PALM:
                    touches = touches | (1 << meetings[i, a].two)
        touched = touched | (touches & ~stopped)
        for f in range(4):
            if (stopped & (1 << f)) != 0:
                continue
            delta = command[f] - true_command(hands[own, f], path, g, f, wp.max(s - 1, 0))
            reading = stop_reading(
                sensors[own_sensor, f], (command[f] - state[i, f].q) * k, delta,
                counter_key(counter_key(counter_key(stream, f), _TENSION_STEP), s))
            stops = wp.abs(reading) > sensors[own_sensor, f].threshold
            if (touched & (1 << f)) == 0:
                # It stops where it did alone: this equilibrium differs in its last digits, which
                # may decide a reading at the threshold.
                stops = felt[w, p, g, f].status == _CONTACT and s >= felt[w, p, g, f].step
            if stops:
                stopped = stopped | (1 << f)
            if (touched & (1 << f)) != 0:
                # It is read where it stops; what pushes it later comes too late for that.
                _note_rest(truth, felt, w, p, g, f, state[i, f], command[f], k, stops, s, last,
                           reading)
                for a in range(count):
                    if meetings[i, a].one == f or meetings[i, a].two == f:
                        truth[w, p, g, f].self_depth = wp.max(
                            truth[w, p, g, f].self_depth, meetings[i, a].depth)
        for f in range(4):
            if in_pairs(pairs, f) and s >= felt[w, p, g, f].step:
                truth[w, p, g, f].rest = state[i, f].q
        if stopped == 15:
            break
        s += 1
        if (touched & ~stopped) == 0 and s <= last:
            # Those that go on have met nothing: each goes on alone until links are near again.
            ahead = first_near(hands, sensors, own, own_sensor, pose, mount, path, links, felt,
                               truth, w, p, g, pairs, s, last)
            if ahead > s:
                s = ahead
                fresh = int(1)
