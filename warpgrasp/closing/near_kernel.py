# type: ignore  # Warp functions, which type checkers cannot follow
"""Which fingers of a hand may meet, and from which step on.

Fingers that close alone are followed on their commands. Bounds of how far they come, tabulated with
the path, leave out most pairs at once; the others are looked at as seldom as their motion allows.
How far a finger that presses may be off its commands is an estimate: what its guarded joints can
lag, and 4 mm for abduction, which nothing guards.
"""

import warp as wp

from warpgrasp.closing.closing_record import ClosingRow, ClosingTruthRow
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec4
from warpgrasp.finger.path_record import LinkStep, PathStep, true_command
from warpgrasp.hand_rest.link_gap import finger_gap, palm_gap
from warpgrasp.hand_rest.meetings import pair_bit
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    Hand,
    finger_base,
    finger_length,
    finger_pose,
    free_joints,
)
from warpgrasp.probe_status import ProbeStatus

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_ROUGH = wp.constant(real(1e-4))  # [m]: `free_joints` is of first order
_GIVE = wp.constant(real(4e-3))  # [m]: what abduction, which nothing guards, gives


@wp.func
def _stray(hand: Hand, sensor: TendonSensor, touched: int, step: int):
    """How far a finger may be from where its command has it, touching nothing [m].

    One that has touched something is held back by what its tendons bear at most, the threshold.
    """
    if touched < 0 or step < touched:
        return _ROUGH
    turn = sensor.threshold / hand.stiffness
    length = hand.link_length
    return _GIVE + turn * (
        sensor.moment_arm[1] * (length[0] + length[1] + length[2])
        + sensor.moment_arm[2] * (length[1] + length[2]) + sensor.moment_arm[3] * length[2])


@wp.func
def _joints_at(
    hand: Hand, base: transform, path: wp.array3d[PathStep], row: ClosingRow,
    true: ClosingTruthRow, g: int, finger: int, step: int
):
    """Joints of a finger that closes alone: where it rests, or where its command would have it."""
    if step >= row.step:
        return true.q
    return free_joints(hand, base, true_command(hand, path, g, finger, step))


@wp.func
def _room(
    hands: wp.array2d[Hand], own: int, mount: real, one: int, two: int, p: vec4, q: vec4
):
    """Least distance between the skins of two fingers at joints `p` and `q` [m], of a finger and
    the palm with `two` 4."""
    hand = hands[own, one]
    f = finger_pose(hand, finger_base(hand, one), p)
    if two == 4:
        return palm_gap(hand, mount, f)
    other = hands[own, two]
    return finger_gap(hand, f, other, finger_pose(other, finger_base(other, two), q))


@wp.func
def _sideways(
    hand: Hand, finger: int, path: wp.array3d[PathStep], g: int, q: vec4, side: real
):
    """How far a finger's skin reaches to a side (1 or -1 along the hand's y axis) [m], from the
    hand's middle, on its way from the abduction that its first command asks for to that of `q`.

    Only abduction and weight turn it sideways: errors of flexion joints do not count.
    """
    command = true_command(hand, path, g, finger, 0)
    middle = hand.spacing * real(finger - 1)
    turn = side
    if finger == 3:
        middle = ZERO
        turn = -side
    long = finger_length(hand)
    out = wp.max(wp.max(turn * wp.sin(command[0]), turn * wp.sin(q[0])), ZERO) * long
    return side * (middle + hand.base_shift[1]) + out + hand.link_radius + hand.lean


@wp.func
def _may_meet(
    hands: wp.array2d[Hand], own: int, path: wp.array3d[PathStep], felt: wp.array4d[ClosingRow],
    truth: wp.array4d[ClosingTruthRow], w: int, p: int, g: int, one: int, two: int, stray: real
):
    """Whether bounds of how far two fingers come sideways and inwards let them meet; with `two` 4,
    one and the palm. `stray` [m] is what fingers that press may be off their way."""
    hand = hands[own, one]
    at = path[g, one, wp.max(felt[w, p, g, one].step, 0)]
    if two == 4:
        return at.palm < stray + hand.sag[2]
    other = hands[own, two]
    there = path[g, two, wp.max(felt[w, p, g, two].step, 0)]
    low = one
    high = two
    if two == 3:
        # The thumb closes against the others.
        if at.inward + there.inward + hand.sag[2] + other.sag[2] + stray < hand.gap:
            return False
        low = 3
        high = one
        if one == 0:
            low = 0
            high = 3
        if one == 1:
            return True
    up = _sideways(hands[own, low], low, path, g, truth[w, p, g, low].q, ONE)
    down = _sideways(hands[own, high], high, path, g, truth[w, p, g, high].q, -ONE)
    return up + down + _GIVE > ZERO


@wp.func
def pairs_that_may(
    hands: wp.array2d[Hand], sensors: wp.array2d[TendonSensor], own: int, own_sensor: int,
    path: wp.array3d[PathStep], felt: wp.array4d[ClosingRow], truth: wp.array4d[ClosingTruthRow],
    w: int, p: int, g: int
):
    """A bit for each pair of fingers, and of a finger and the palm, that may meet."""
    pairs = int(0)
    for one in range(4):
        for two in range(one + 1, 5):
            stray = _stray(hands[own, one], sensors[own_sensor, one], truth[w, p, g, one].touched,
                           felt[w, p, g, one].step)
            if two < 4:
                stray += _stray(hands[own, two], sensors[own_sensor, two],
                                truth[w, p, g, two].touched, felt[w, p, g, two].step)
            if _may_meet(hands, own, path, felt, truth, w, p, g, one, two, stray):
                pairs = pairs | pair_bit(one, two)
    return pairs


@wp.func
def _first_by_table(
    hands: wp.array2d[Hand], own: int, path: wp.array3d[PathStep], felt: wp.array4d[ClosingRow],
    w: int, p: int, g: int, one: int, two: int, stray: real, begin: int, end: int
):
    """No step from `begin` on and before the one returned brings a finger near the palm (`two` 4),
    or the thumb (`two` 3) near another: by how far they come, which only grows; at most `end`."""
    low = begin
    high = end
    hand = hands[own, one]
    stop = felt[w, p, g, one].step
    while low < high:
        s = (low + high) // 2
        here = path[g, one, wp.min(s, stop)]
        near = here.palm < stray + hand.sag[2]
        if two == 3:
            there = path[g, 3, wp.min(s, felt[w, p, g, 3].step)]
            near = (here.inward + there.inward + hand.sag[2] + hands[own, 3].sag[2] + stray
                    >= hand.gap)
        if near:
            high = s
        else:
            low = s + 1
    return low


@wp.func
def _fastest(links: wp.array4d[LinkStep], g: int, finger: int, step: int):
    """How far any place of a finger moves at most in a step from here on [m]."""
    slow = wp.min(links[g, finger, 0, step].steps, wp.min(
        links[g, finger, 1, step].steps, links[g, finger, 2, step].steps))
    return ONE / slow


@wp.func(inline=False)
def first_near(
    hands: wp.array2d[Hand], sensors: wp.array2d[TendonSensor], own: int, own_sensor: int,
    pose: transform, mount: real, path: wp.array3d[PathStep], links: wp.array4d[LinkStep],
    felt: wp.array4d[ClosingRow], truth: wp.array4d[ClosingTruthRow], w: int, p: int, g: int,
    pairs: int, begin: int, last: int
):
    """The first step from `begin` on at which links of a hand may touch, `last` + 1 if none.

    Distances are looked at while they cannot have been used up (conservative advancement).
    """
    found = last + 1
    for one in range(4):
        for two in range(one + 1, 5):
            if (pairs & pair_bit(one, two)) == 0:
                continue
            hand = hands[own, one]
            row = felt[w, p, g, one]
            true = truth[w, p, g, one]
            base = wp.transform_multiply(pose, finger_base(hand, one))
            end = row.step
            other = hand
            other_base = base
            other_row = row
            other_true = true
            if two < 4:
                other = hands[own, two]
                other_base = wp.transform_multiply(pose, finger_base(other, two))
                other_row = felt[w, p, g, two]
                other_true = truth[w, p, g, two]
                end = wp.max(end, other_row.step)
            if end < begin:
                continue  # both are at rest
            s = begin
            if two >= 3:
                stray = _stray(hand, sensors[own_sensor, one], true.touched, end)
                if two == 3:
                    stray += _stray(other, sensors[own_sensor, two], other_true.touched, end)
                s = _first_by_table(hands, own, path, felt, w, p, g, one, two, stray, begin, end)
            while s < found:
                room = _room(hands, own, mount, one, two,
                             _joints_at(hand, base, path, row, true, g, one, s),
                             _joints_at(other, other_base, path, other_row, other_true, g,
                                        wp.min(two, 3), s))
                fast = real(0.0)
                if s < row.step:
                    room -= _stray(hand, sensors[own_sensor, one], true.touched, s)
                    fast += _fastest(links, g, one, s)
                if two < 4 and s < other_row.step:
                    room -= _stray(other, sensors[own_sensor, two], other_true.touched, s)
                    fast += _fastest(links, g, two, s)
                if room <= ZERO:
                    found = s
                elif s >= end:
                    s = found
                else:
                    s += wp.max(int(room / fast), 1)
    return found


@wp.kernel(enable_backward=False, module="warpgrasp.closing.closing_kernels")
def near_kernel(
    first: int,
    # Robot:
    hands: wp.array2d[Hand],
    sensors: wp.array2d[TendonSensor],
    mount: real,
    # Closing in:
    body_pose: wp.array[transform],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[PathStep],
    links: wp.array4d[LinkStep],
    command_count: wp.array[int],
    felt: wp.array4d[ClosingRow],
    truth: wp.array4d[ClosingTruthRow],
    # Out:
    near: wp.array3d[int],
):
    """The step at which links of a hand first come near one another; -1 where they never do."""
    w, p, g, finger = wp.tid()
    w += first
    if finger > 0:
        return
    near[w, p, g] = -1
    if felt[w, p, g, 0].status != _CONTACT and felt[w, p, g, 0].status != _NO_CONTACT:
        return
    pose = wp.transform_multiply(wp.transform_inverse(body_pose[w]), hand_pose[w, p])
    last = command_count[g] - 1
    own = w % hands.shape[0]
    own_sensor = w % sensors.shape[0]
    pairs = pairs_that_may(hands, sensors, own, own_sensor, path, felt, truth, w, p, g)
    if pairs == 0:
        return
    step = first_near(hands, sensors, own, own_sensor, pose, mount, path, links, felt, truth, w, p,
                      g, pairs, 0, last)
    if step <= last:
        near[w, p, g] = step
