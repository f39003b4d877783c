# type: ignore  # Warp functions, which type checkers cannot follow
"""How near links of hands of chains come: which hands they may touch in, and from which step on.

Fingers that close alone are followed on their commands. Of a path it is tabulated how near each
pair of capsules can come on it, whatever steps their fingers are at (`chain_slack`): most pairs
never do. The others are looked at together, as seldom as the motion of their capsules allows.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    ChainCapsule,
    ChainJoint,
    past_stops,
    turned_by_weight,
    vec6,
)
from warpgrasp.chain_closing.chain_record import ChainClosingRow, ChainTruthRow, hand_from_body
from warpgrasp.chain_closing.near_lanes import near_in_lanes
from warpgrasp.core.dtypes import HALF, ZERO, lesser, real, transform, vec3, vec4
from warpgrasp.finger.path_record import true_command
from warpgrasp.geometry.segment_pair import segment_pair
from warpgrasp.hand_rest.chain_meetings import (
    CAPSULE_ROWS,
    FINGERS,
    CapsulePair,
    ChainBuild,
    hand_angles,
    off_command,
    ordered_pair,
    pair_gap,
    pairs_within,
    place_finger,
)

_ROUGH = wp.constant(real(1e-4))  # [m]: what weight does is found to second order
_SOON = wp.constant(8)  # steps, in which what it does changes so little that it may begin with it
_hand_room = wp.types.vector(length=FINGERS, dtype=real)
_WIDE = wp.constant(real(0.02))  # [m]: pairs as far apart are looked at roughly
_CLOSE = wp.constant(real(5e-4))  # [m]: a path's least gap is found to within this
_FARTHEST = wp.constant(real(0.1))  # [m]: nor of one that is larger


@wp.func
def _stray(row: ChainClosingRow, true: ChainTruthRow, s: int):
    """How far a finger that closes alone may be from where its command would have it [m]."""
    if s >= row.step:
        return ZERO
    if true.touched < 0 or s < true.touched:
        return _ROUGH
    return _ROUGH + true.strayed


@wp.func
def _come_since(
    come: wp.array4d[real], g: int, finger: int, capsule: int, since: int, step: int, stop: int
):
    """How far a capsule has come since a step [m], at most; it stands still from `stop` on."""
    return (come[g, finger, capsule, wp.min(step, stop)]
            - come[g, finger, capsule, wp.min(since, stop)])


@wp.func
def _due(
    come: wp.array4d[real], g: int, pair: CapsulePair, stop: int, other_stop: int, s: int,
    latest: int, room: real
):
    """The first step at which a pair that has `room` at step `s` [m] may have used it up, or
    `latest`."""
    low = s + 1
    high = int(latest)
    while low < high:
        # The last step first: mostly it is as far off.
        middle = wp.where(high == latest, high - 1, (low + high) // 2)
        used = _come_since(come, g, pair.one, pair.capsule, s, middle, stop)
        if pair.two >= 0:
            used += _come_since(come, g, pair.two, pair.other, s, middle, other_stop)
        if used >= room:
            high = middle
        else:
            low = middle + 1
    return low


@wp.func(inline=False)
def first_near(
    hands: wp.array2d[Chain], base: transform, path: wp.array3d[vec6], come: wp.array4d[real],
    build: ChainBuild, felt: wp.array4d[ChainClosingRow], truth: wp.array4d[ChainTruthRow], w: int,
    p: int, g: int, i: int, begin: int, last: int
):
    """The first step from `begin` on at which links of a hand may touch, `last` + 1 if none.

    Distances are looked at while they cannot have been used up (conservative advancement); `come`
    bounds how far any place of a capsule has come. Pairs that are both at rest before `begin` are
    left out.
    """
    fingers = hands.shape[1]
    own = w % hands.shape[0]
    # Two fingers may be off their ways by no more than the two that are most.
    most = real(0.0)
    second = real(0.0)
    for f in range(fingers):
        stray = _ROUGH
        if truth[w, p, g, f].touched >= 0:
            stray += truth[w, p, g, f].strayed
        if truth[w, p, g, f].met == 1:
            hand = hands[own, f]
            stray += off_command(hand, true_command(hand, path, g, f, felt[w, p, g, f].step)
                                 - truth[w, p, g, f].q)
        second = wp.max(second, wp.min(most, stray))
        most = wp.max(most, stray)
    count = pairs_within(build, most + second)
    looked = int(0)  # at these fingers
    for k in range(count):
        pair = ordered_pair(build, k)
        looked = looked | (1 << pair.one)
        if pair.two >= 0:
            looked = looked | (1 << pair.two)
    if build.has_lanes:
        return near_in_lanes(
            hands, own, wp.array(ptr=hands[own, 0].joints, shape=(1,), dtype=ChainJoint),
            wp.array(ptr=hands[own, 0].capsules, shape=(1,), dtype=ChainCapsule), base, path, come,
            build.palm, build.pairs, build.order, build.world, count, looked, felt, truth, w, p, g,
            begin, last)
    sag = hand_angles()
    s = int(begin)
    seen = begin - 1  # the step looked at before
    while s <= last and looked != 0:
        off = _hand_room()
        moving = int(0)
        ahead = last + 1
        for f in range(fingers):
            if (looked & (1 << f)) == 0:
                continue
            row = felt[w, p, g, f]
            true = truth[w, p, g, f]
            hand = hands[own, f]
            off[f] = _stray(row, true, s)
            if row.step > seen:
                moving = moving | (1 << f)
            if s >= row.step:
                if row.step > seen or s == begin:
                    place_finger(hand, true.q, build.ends, build.balls, i, f)
            else:
                command = true_command(hand, path, g, f, s)
                if s == begin or s - seen > _SOON:
                    sag[f] = turned_by_weight(hand, base, command)
                sag[f] = turned_by_weight(hand, base, command + sag[f])
                place_finger(hand, past_stops(hand, command + sag[f]), build.ends, build.balls, i,
                             f)
            if true.touched > s:
                ahead = wp.min(ahead, true.touched)  # from there on it may be off farther
        for k in range(count):
            pair = ordered_pair(build, k)
            both = 1 << pair.one
            reach = off[pair.one]
            other_stop = int(0)
            if pair.two >= 0:
                both = both | (1 << pair.two)
                reach += off[pair.two]
                other_stop = felt[w, p, g, pair.two].step
            if (moving & both) != 0:
                room = pair_gap(build, pair, i, _WIDE) - reach
                if room <= ZERO:
                    return s
                ahead = _due(come, g, pair, felt[w, p, g, pair.one].step, other_stop, s, ahead,
                             room)
        seen = int(s)
        s = int(ahead)
    return last + 1


@wp.kernel(enable_backward=False, module="warpgrasp.chain_closing.chain_closing_kernels")
def chain_near_kernel(
    first: int,
    has_lanes: wp.bool,
    # Robot:
    hands: wp.array2d[Chain],
    palm: wp.array2d[vec3],
    palm_balls: wp.array[vec4],
    pairs: wp.array[CapsulePair],
    order: wp.array3d[int],
    slack: wp.array3d[real],
    # Closing in:
    body_pose: wp.array[transform],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[vec6],
    come: wp.array4d[real],
    command_count: wp.array[int],
    place: wp.array[wp.vec3i],
    felt: wp.array4d[ChainClosingRow],
    truth: wp.array4d[ChainTruthRow],
    # Scratch:
    ends: wp.array3d[vec3],
    balls: wp.array2d[vec4],
    # Out:
    near: wp.array[int],
):
    """The step at which links of a hand first come near one another; -1 where they never do."""
    i = wp.tid() + first
    w = place[i][0]
    last = command_count[place[i][2]] - 1
    base = hand_from_body(body_pose, hand_pose, w, place[i][1])
    build = ChainBuild()
    build.has_lanes = has_lanes
    build.palm = palm
    build.palm_balls = palm_balls
    build.pairs = pairs
    build.ends = ends
    build.balls = balls
    build.order = order
    build.slack = slack
    build.world = w % order.shape[0]
    build.grasp = place[i][2]
    near[i] = first_near(hands, base, path, come, build, felt, truth, w, place[i][1], place[i][2],
                         i, 0, last)
    if near[i] > last:
        near[i] = -1


@wp.func
def _first_come(come: wp.array4d[real], g: int, finger: int, capsule: int, begin: int, way: real):
    """The first step after `begin` at which a capsule may have come so far since [m]."""
    low = begin + 1
    high = come.shape[3]
    while low < high:
        middle = (low + high) // 2
        if come[g, finger, capsule, middle] - come[g, finger, capsule, begin] >= way:
            high = middle
        else:
            low = middle + 1
    return low


@wp.kernel(enable_backward=False, module="warpgrasp.chain_closing.chain_closing_kernels")
def path_gap_kernel(
    first: int,
    palm: wp.array2d[vec3],
    pairs: wp.array[CapsulePair],
    ends: wp.array4d[vec3],
    come: wp.array4d[real],
    gap: wp.array2d[real],
):
    """How near two capsules come on their path [m], at least, with their fingers at any two steps:
    the least distance but for a millimetre, at most a decimetre.

    `ends` (grasp, capsule of a finger, step, 2) are those of the capsules in the hand's frame.
    """
    g, k = wp.tid()
    g += first
    pair = pairs[k]
    least = real(_FARTHEST)
    row = pair.one * CAPSULE_ROWS + pair.capsule
    s = int(0)
    while s < ends.shape[2]:
        here = real(_FARTHEST)  # least distance with the first finger at `s`
        t = int(0)
        while t < ends.shape[2]:
            after = int(ends.shape[2])
            c = palm[wp.where(pair.two < 0, pair.other, 0), 0]
            d = palm[wp.where(pair.two < 0, pair.other, 0), 1]
            if pair.two >= 0:
                c = ends[g, pair.two * CAPSULE_ROWS + pair.other, t, 0]
                d = ends[g, pair.two * CAPSULE_ROWS + pair.other, t, 1]
            apart = segment_pair(ends[g, row, s, 0], ends[g, row, s, 1], c, d).apart - pair.both
            here = lesser(here, apart)
            least = lesser(least, apart)
            # Half of what is left may be used up on either way.
            if pair.two >= 0:
                after = _first_come(come, g, pair.two, pair.other, t,
                                    (apart - least) * HALF + _CLOSE)
            t = int(after)
        s = _first_come(come, g, pair.one, pair.capsule, s, (here - least) * HALF + _CLOSE)
    gap[g, k] = least - _CLOSE - _CLOSE
