# type: ignore  # Warp functions, which type checkers cannot follow
"""Where capsules of a hand of chains touch one another or the palm, or are near.

Two skins give in series, and do not rub. Pairs that the hand's build keeps close are no pairs: the
first links of fingers and the palm, and what is as near in the open hand (`chain_meeting.palm_of`).
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    CAPSULES,
    Chain,
    ChainPose,
    chain_capsule,
    chain_jacobian,
    chain_pose,
    placed,
    vec6,
)
from warpgrasp.core.dtypes import HALF, ZERO, real, struct, transform, vec3, vec4
from warpgrasp.finger.chain_energy import largest_magnitude
from warpgrasp.finger.path_record import true_command
from warpgrasp.geometry.segment_pair import segment_pair
from warpgrasp.hand_rest.meetings import (
    MEETINGS,
    base_of,
    find_meetings,
    servo_torques,
    takes_part,
)
from warpgrasp.hands.hand_checks import MOST_MEETING

FINGERS = MOST_MEETING
"""Fingers of a hand at most."""
CAPSULE_ROWS = wp.constant(CAPSULES)
"""Of a finger, in a row of all capsules of a hand."""
_MEETINGS = wp.constant(MEETINGS)
_NEAR = wp.constant(real(2e-3))  # [m]: links nearer than this may meet in a step
_ROOM = wp.constant(real(1.5e-2))  # [m]: two fingers come less far together before pairs are listed
_FAR = wp.constant(real(8e-3))  # [m]: how far two capsules are is found if it is less
_MORE = wp.constant(real(5e-3))  # [m]: and may be off their commands by as much more
hand_angles = wp.types.matrix(shape=(FINGERS, 6), dtype=real)


@struct
class ChainMeeting:
    """Two capsules that touch or are near: how deep [m], and how their distance changes with the
    drives of each finger [m/rad]; `two` is `PALM` for the palm."""

    one: int
    two: int
    depth: real
    by_one: vec6
    by_two: vec6
    give_one: vec6
    """How far a newton between them turns the drives of each [rad/N]."""
    give_two: vec6


@struct
class CapsulePair:
    """Two capsules that may touch: their fingers, `two` -1 for the palm; their numbers, of a finger
    or of the palm; the sum of their radii [m]."""

    one: int
    two: int
    capsule: int
    other: int
    both: real


@struct
class ChainBuild:
    """What else decides where links meet: the palm's capsules (bar, 2), the pairs, and room for the
    ends of capsules (row, capsule, 2), in the hand's frame [m], with the balls around their axes
    (bar and row, capsule): middles, and half their lengths.

    `order` (world, grasp, pair) numbers the pairs by their `slack`, the least first: how near they
    come on the way of a grasp while nothing holds their fingers, at least [m]. Of this hand's
    (`world`, `grasp`) the first `count` may be near.

    Those of the first `within` that were so near that they may meet before a finger has come far
    are `listed` (row, number), `listed_count` of them; see `near_pairs`. `come` (row, finger) is
    how far each finger has come since [m], at most, and `come_to` its drives at that place. A pair
    is nowhere near before its fingers have together come to `due` (row, number). `poses`
    (row, finger) in the hand's frame are those at the drives that are `posed`; `up` is the way
    upwards there.
    """

    has_lanes: wp.bool
    palm: wp.array2d[vec3]
    palm_balls: wp.array[vec4]
    pairs: wp.array[CapsulePair]
    ends: wp.array3d[vec3]
    balls: wp.array2d[vec4]
    order: wp.array3d[int]
    slack: wp.array3d[real]
    world: int
    grasp: int
    count: int
    listed: wp.array2d[int]
    come: wp.array2d[real]
    come_to: wp.array2d[vec6]
    due: wp.array2d[real]
    poses: wp.array2d[ChainPose]
    posed: wp.array2d[vec6]
    up: vec3
    listed_count: int
    within: int


@wp.func
def takes_part(build: ChainBuild, finger: int):  # noqa: F811 (overloads, from here on)
    """Every finger does."""
    return True


@wp.func
def base_of(hand: Chain, pose: transform, finger: int):  # noqa: F811
    """What the kinematics of a finger start from: the hand's own pose."""
    return pose


@wp.func
def servo_torques(hand: Chain, turn: vec6):  # noqa: F811
    """Torques of servos that are off by a turn [N m]."""
    return wp.cw_mul(turn, hand.stiffness)


@wp.func
def true_command(  # noqa: F811
    hand: Chain, path: wp.array3d[vec6], grasp: int, finger: int, step: int
):
    """The command at which the true drives stand, the errors of their sensors taken off [rad]."""
    return path[grasp, finger, step] - hand.offset


@wp.func
def place_finger(
    hand: Chain, q: vec6, ends: wp.array3d[vec3], balls: wp.array2d[vec4], i: int, finger: int
):
    """Notes both ends of a finger's capsules in the hand's frame, in row `i` of `ends`, and the
    balls around them."""
    _place_capsules(hand, chain_pose(hand, wp.transform_identity(dtype=wp.float64), q), ends, balls,
                    i, finger)


@wp.func
def _place_capsules(
    hand: Chain, pose: ChainPose, ends: wp.array3d[vec3], balls: wp.array2d[vec4], i: int,
    finger: int
):
    for c in range(hand.capsule_count):
        capsule = chain_capsule(hand, c)
        at = pose.at[capsule.joint]
        turn = pose.turn[capsule.joint]
        a = placed(at, turn, capsule.start)
        b = placed(at, turn, capsule.end)
        row = finger * CAPSULE_ROWS + c
        ends[i, row, 0] = a
        ends[i, row, 1] = b
        middle = (a + b) * HALF
        balls[i, row] = vec4(middle[0], middle[1], middle[2], wp.length(b - a) * HALF)


@wp.func
def _balls_apart(build: ChainBuild, pair: CapsulePair, i: int):
    """The square of the distance of the middles of a pair's balls [m2], and how far apart they are
    where the skins around them touch [m]."""
    one = build.balls[i, pair.one * CAPSULE_ROWS + pair.capsule]
    two = vec4()
    if pair.two >= 0:
        two = build.balls[i, pair.two * CAPSULE_ROWS + pair.other]
    else:
        two = build.palm_balls[pair.other]
    x = one[0] - two[0]
    y = one[1] - two[1]
    z = one[2] - two[2]
    return x * x + y * y + z * z, one[3] + two[3] + pair.both


@wp.func
def _pair_end(pair: CapsulePair, palm: wp.array2d[vec3], ends: wp.array3d[vec3], i: int, end: int):
    """An end of a pair's second capsule."""
    if pair.two < 0:
        return palm[pair.other, end]
    return ends[i, pair.two * CAPSULE_ROWS + pair.other, end]


@wp.func
def ordered_pair(build: ChainBuild, k: int):
    """The pair of a number in `order`."""
    return build.pairs[build.order[build.world, build.grasp, k]]


@wp.func
def pairs_within(build: ChainBuild, reach: real):
    """How many pairs may touch where fingers are held back, or pushed, by `reach` together [m]."""
    low = int(0)
    high = int(build.pairs.shape[0])
    while low < high:
        middle = (low + high) // 2
        if build.slack[build.world, build.grasp, middle] < reach:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def off_command(hand: Chain, turn: vec6):
    """How far drives that are off their commands by a turn move any place of a finger [m], at most.
    """
    off = real(0.0)
    for d in range(hand.drives):
        off += hand.levers[d] * wp.abs(turn[d])
    return off


@wp.func
def _pair_fingers(pair: CapsulePair):
    """A bit for each finger of a pair."""
    both = 1 << pair.one
    if pair.two >= 0:
        both = both | (1 << pair.two)
    return both


@wp.func
def _moved(hands: wp.array2d[Chain], own: int, build: ChainBuild, q: hand_angles, i: int):
    """How much nearer two fingers may come by drives `q` than where pairs were listed [m]."""
    most = real(0.0)
    second = real(0.0)
    for f in range(hands.shape[1]):
        way = build.come[i, f] + off_command(hands[own, f], q[f] - build.come_to[i, f])
        second = wp.max(second, wp.min(most, way))
        most = wp.max(most, way)
    return most + second


@wp.func
def _both_come(build: ChainBuild, pair: CapsulePair, i: int):
    """How far a pair's fingers have come together since pairs were listed [m]."""
    way = build.come[i, pair.one]
    if pair.two >= 0:
        way += build.come[i, pair.two]
    return way


@wp.func
def pair_gap(build: ChainBuild, pair: CapsulePair, i: int, enough: real):
    """How far the skins of a pair are apart [m]; by balls around them where that is `enough`."""
    square, touching = _balls_apart(build, pair, i)
    gap = wp.sqrt(square) - touching
    if gap < enough:
        a = build.ends[i, pair.one * CAPSULE_ROWS + pair.capsule, 0]
        b = build.ends[i, pair.one * CAPSULE_ROWS + pair.capsule, 1]
        c = _pair_end(pair, build.palm, build.ends, i, 0)
        d = _pair_end(pair, build.palm, build.ends, i, 1)
        gap = segment_pair(a, b, c, d).apart - pair.both
    return gap


@wp.func
def near_pairs(
    hands: wp.array2d[Chain], own: int, build: ChainBuild, command: hand_angles, q: hand_angles,
    moves: hand_angles, i: int, anew: int
):
    """`build` with the pairs that may be near in a step that moves the commands of fingers at
    drives `q`, listed `anew`, or where those listed before may not be all."""
    now = build
    most = real(0.0)  # that any two fingers are off their commands [m]
    second = real(0.0)
    for f in range(hands.shape[1]):
        hand = hands[own, f]
        off = off_command(hand, command[f] - q[f]) + off_command(hand, moves[f])
        second = wp.max(second, wp.min(most, off))
        most = wp.max(most, off)
    now.count = pairs_within(build, most + second + _NEAR)
    if anew == 0 and now.count <= build.within and (
            _moved(hands, own, build, q + moves, i) < _ROOM):
        return now
    now.within = pairs_within(build, most + second + _NEAR + _MORE)
    looked = int(0)
    for k in range(now.within):
        looked = looked | _pair_fingers(ordered_pair(build, k))
    for f in range(hands.shape[1]):
        build.come_to[i, f] = q[f]
        build.come[i, f] = ZERO
        if (looked & (1 << f)) != 0:
            place_finger(hands[own, f], q[f], build.ends, build.balls, i, f)
    now.listed_count = int(0)
    for k in range(now.within):
        pair = ordered_pair(build, k)
        gap = pair_gap(build, pair, i, _NEAR + _ROOM)
        if gap < _NEAR + _ROOM:
            build.listed[i, now.listed_count] = k
            build.due[i, now.listed_count] = gap - _NEAR
            now.listed_count = now.listed_count + 1
    return now


@wp.func
def _note(
    meetings: wp.array2d[ChainMeeting], i: int, count: int, one: int, two: int, depth: real,
    by_one: vec6, by_two: vec6
):
    """Notes a meeting; where there is no room, in place of the shallowest if it is deeper."""
    at = int(count)
    if count >= _MEETINGS:
        at = int(0)
        for k in range(1, _MEETINGS):
            if meetings[i, k].depth < meetings[i, at].depth:
                at = int(k)
        if depth <= meetings[i, at].depth:
            return count
    meetings[i, at].one = one
    meetings[i, at].two = two
    meetings[i, at].depth = depth
    meetings[i, at].by_one = by_one
    meetings[i, at].by_two = by_two
    return wp.min(count + 1, _MEETINGS)


@wp.func(inline=False)
def find_meetings(  # noqa: F811
    hands: wp.array2d[Chain], own: int, build: ChainBuild, q: hand_angles,
    meetings: wp.array2d[ChainMeeting], i: int
):
    """Notes the pairs of capsules that touch or are near, in row `i`; returns their number."""
    pairs = build.listed_count
    listed = int(1)
    if _moved(hands, own, build, q, i) > _ROOM:
        listed = int(0)
        pairs = build.count
    for f in range(hands.shape[1]):
        build.come[i, f] += off_command(hands[own, f], q[f] - build.come_to[i, f])
        build.come_to[i, f] = q[f]
    looked = int(0)
    for n in range(pairs):
        k = int(n)
        if listed == 1:
            k = build.listed[i, n]
        pair = ordered_pair(build, k)
        if listed == 0 or _both_come(build, pair, i) >= build.due[i, n]:
            looked = looked | _pair_fingers(pair)
    for f in range(hands.shape[1]):
        if (looked & (1 << f)) != 0:
            if largest_magnitude(q[f] - build.posed[i, f]) > ZERO:
                build.poses[i, f] = chain_pose(
                    hands[own, f], wp.transform_identity(dtype=wp.float64), q[f])
                build.posed[i, f] = q[f]
            _place_capsules(hands[own, f], build.poses[i, f], build.ends, build.balls, i, f)
    count = int(0)
    for n in range(pairs):
        k = int(n)
        if listed == 1:
            k = build.listed[i, n]
        pair = ordered_pair(build, k)
        way = _both_come(build, pair, i)
        if listed == 1:
            if way < build.due[i, n]:
                continue
        square, touching = _balls_apart(build, pair, i)
        reach = touching + _NEAR + wp.where(listed == 1, _FAR, ZERO)
        if square >= reach * reach:
            if listed == 1:
                build.due[i, n] = way + _FAR
        else:
            near = segment_pair(build.ends[i, pair.one * CAPSULE_ROWS + pair.capsule, 0],
                                build.ends[i, pair.one * CAPSULE_ROWS + pair.capsule, 1],
                                _pair_end(pair, build.palm, build.ends, i, 0),
                                _pair_end(pair, build.palm, build.ends, i, 1))
            if listed == 1:
                build.due[i, n] = way + near.apart - pair.both - _NEAR
            if near.apart < pair.both + _NEAR:
                hand = hands[own, pair.one]
                by_one = chain_jacobian(hand, build.poses[i, pair.one],
                                        chain_capsule(hand, pair.capsule).joint, near.one, near.way)
                by_two = vec6()
                if pair.two >= 0:
                    other = hands[own, pair.two]
                    by_two = chain_jacobian(other, build.poses[i, pair.two],
                                            chain_capsule(other, pair.other).joint, near.two,
                                            -near.way)
                count = _note(meetings, i, count, pair.one, pair.two, pair.both - near.apart,
                              by_one, by_two)
    return count
