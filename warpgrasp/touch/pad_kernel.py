# type: ignore  # Warp functions, which type checkers cannot follow
"""Tactile pads in kernels: places, forces and readings of taxels."""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain, ChainPose, link_place, link_turn
from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat32, real, struct, transform, vec2, vec3, vec4
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import (
    counter_key,
    counter_normal,
    counter_normal_is_negative,
    counter_uniform,
)
from warpgrasp.core.turns import sine_cosine
from warpgrasp.geometry.scene import Scene, body_table_distance
from warpgrasp.mechanism.utah_mit_hand import LINK_COUNT
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    Hand,
    finger_base,
    finger_pose,
    link_direction,
    link_start,
)

wp.set_module_options({"max_unroll": 1})
_SIDE = wp.constant(16)
_TURNS = wp.constant(40)  # rows of `pad.pad_turns` a pad
_SIDE_REAL = wp.constant(real(16.0))
_EXPONENTIAL = wp.constant(0)
_GAIN = wp.constant(int(Purpose.PAD_GAIN))
_DEAD = wp.constant(int(Purpose.PAD_DEAD))
_READING = wp.constant(int(Purpose.PAD_READING))
_FULL = wp.constant(real(255.0))


@struct
class Pad:
    """The numbers of a PadTable that kernels need, SI."""

    on: wp.vec3i
    width: real
    length: real
    wrap: real
    thickness: real
    stiffness: real
    flat: real
    law: int
    rest_ohm: real
    least_ohm: real
    force_scale: real
    newton_ohm: real
    power: real
    reference_ohm: real
    floor: real
    saturation: real
    gain_spread: real
    repeatability: real
    noise: real
    dead: real
    threshold: real
    yield_angle: real
    false_touch: real
    shift: mat32
    """Errors of one finger's pads: along and across each link [m], as a row; and their gains."""
    gain: vec3
    places: wp.uint64
    """Of a finger that is a chain: its rows of ChainPad."""


@struct
class ChainPad:
    """Where a pad lies on a link of a chain: the axis that it is bent about and the side that it
    lies on, in the frame of its joint's link."""

    joint: int
    start: vec3
    end: vec3
    out: vec3
    radius: real
    bends: int
    """Whether it bends over the end."""


@struct
class PadLink:
    """What a pad lies on: a cylinder about a link's axis, which may end in a half ball.

    `side` is across the axis, and `side` x `along` the middle of the side that the pad lies on.
    """

    slot: int
    """Which of the finger's three pads."""
    joint: int
    """Of a chain: the joint that bears the link."""
    foot: vec3
    tip: vec3
    along: vec3
    side: vec3
    length: real
    radius: real
    bends: int
    turns: int
    """Where its rows of `pad_turns` begin."""
    bent_by: vec2
    turned_by: vec2
    """(sin, cos) of what the pad's error turns its rows over the tip, and all of it about the axis.
    """


@struct
class PadPlace:
    """A place on a pad's surface and the pad's outward normal there."""

    x: vec3
    out: vec3


@struct
class PadRow:
    """A row of a pad: a point of the link's axis, and the outward direction at the row's middle."""

    axis: vec3
    out: vec3


@wp.func
def _with_error(pad: Pad, at: PadLink):
    """The link with the turns by its pad's error."""
    radius = at.radius + pad.thickness
    at.bent_by = sine_cosine(pad.shift[at.slot, 0] / radius)
    at.turned_by = sine_cosine(pad.shift[at.slot, 1] / radius)
    return at


@wp.func
def pad_link(hand: Hand, pad: Pad, f: FingerPose, link: int):
    """The link that a pad of the Utah-MIT hand lies on; the distal pad bends over the tip."""
    at = PadLink()
    at.slot = link
    at.joint = link + 1
    at.foot = link_start(f, link)
    at.tip = f.p4
    at.along = link_direction(f, link)
    at.side = f.side
    at.length = hand.link_length[link]
    at.radius = hand.link_radius
    at.bends = int(link == 2)
    return _with_error(pad, at)


@wp.func
def pad_link(hand: Chain, pad: Pad, f: ChainPose, link: int):  # noqa: F811 (an overload)
    """The link that a pad of a chain lies on."""
    rows = wp.array(ptr=pad.places, shape=(LINK_COUNT,), dtype=ChainPad)
    row = rows[link]
    at = PadLink()
    at.slot = link
    at.joint = row.joint
    at.foot = link_place(f, row.joint, row.start)
    at.tip = link_place(f, row.joint, row.end)
    way = at.tip - at.foot
    at.length = wp.length(way)
    at.along = way / at.length
    at.side = wp.cross(at.along, wp.quat_rotate(link_turn(f, row.joint), row.out))
    at.radius = row.radius
    at.bends = row.bends
    at.turns = link * _TURNS
    return _with_error(pad, at)


@wp.func
def _straight(pad: Pad, at: PadLink):
    """Length of a pad's straight part [m]."""
    if at.bends == 1:
        return pad.length - pad.wrap * (at.radius + pad.thickness)
    return pad.length


@wp.func
def pad_bend(pad: Pad, at: PadLink, row: real):
    """(sin, cos) of a row's turn over the fingertip; of no use before it."""
    s = (row + HALF) * pad.length / _SIDE_REAL
    return sine_cosine((s - _straight(pad, at)) / (at.radius + pad.thickness))


@wp.func
def _turned(angle: vec2, by: vec2):
    """(sin, cos) of the sum of two angles."""
    return vec2(angle[0] * by[1] + angle[1] * by[0], angle[1] * by[1] - angle[0] * by[0])


@wp.func
def pad_row_bent(pad: Pad, at: PadLink, row: real, bend: vec2):
    """`pad_row`, its `pad_bend` before the pad's error given."""
    s = (row + HALF) * pad.length / _SIDE_REAL + pad.shift[at.slot, 0]
    u = at.along
    n = wp.cross(at.side, u)
    straight = _straight(pad, at)
    line = PadRow()
    if at.bends == 1 and s > straight:
        turn = _turned(bend, at.bent_by)
        line.out = n * turn[1] + u * turn[0]
        line.axis = at.tip
    else:
        start = (at.length - straight) * wp.where(at.bends == 1, ONE, HALF)
        line.out = n
        line.axis = at.foot + u * (start + s)
    return line


@wp.func
def pad_row(pad: Pad, at: PadLink, row: real):
    """Row `row` of a pad, taxels' rows being whole numbers; in the frame of `at`."""
    return pad_row_bent(pad, at, row, pad_bend(pad, at, row))


@wp.func
def pad_column(pad: Pad, at: PadLink, column: real):
    """(sin, cos) of a column's turn about the link's axis, before the pad's error."""
    radius = at.radius + pad.thickness
    return sine_cosine((column + HALF - _SIDE_REAL * HALF) * pad.width / (_SIDE_REAL * radius))


@wp.func
def pad_point(pad: Pad, at: PadLink, row: PadRow, column: vec2):
    """The place of a row and a column of a pad."""
    place = PadPlace()
    turn = _turned(column, at.turned_by)
    place.out = row.out * turn[1] + at.side * turn[0]
    place.x = row.axis + place.out * (at.radius + pad.thickness)
    return place


@wp.func
def pad_place(pad: Pad, at: PadLink, row: real, column: real):
    """The place at (row, column), taxel centres being whole numbers; in the frame of `at`."""
    return pad_point(pad, at, pad_row(pad, at, row), pad_column(pad, at, column))


@wp.func
def pad_near(scene: Scene, body: int, pad: Pad, at: PadLink, margin: real):
    """Whether a pad may be nearer than `margin` to an obstacle: a bound from its middle."""
    middle = pad_place(pad, at, _SIDE_REAL * HALF, _SIDE_REAL * HALF)
    return body_table_distance(scene, body, middle.x) < (pad.length + pad.width) * HALF + margin


@wp.func
def taxel_spring(pad: Pad, depth: real):
    """Force [N], energy [J] and stiffness [N/m] of a taxel pressed in by `depth` > 0 [m].

    Beyond its thickness it is pressed flat, and gives hardly more.
    """
    past = wp.max(depth - pad.thickness, ZERO)
    soft = depth - past
    force = pad.stiffness * soft
    energy = HALF * force * soft + past * (force + HALF * pad.flat * past)
    return vec3(force + pad.flat * past, energy, wp.where(past > ZERO, pad.flat, pad.stiffness))


@wp.func
def taxel_force(scene: Scene, body: int, pad: Pad, x: vec3):
    """Force on a taxel at x [N]."""
    depth = -body_table_distance(scene, body, x)
    if depth <= ZERO:
        return ZERO
    return taxel_spring(pad, depth)[0]


@wp.func
def _voltage(pad: Pad, force: real):
    """Share of the supply voltage at the divider."""
    ohm = pad.rest_ohm
    if pad.law == _EXPONENTIAL:
        ohm = pad.least_ohm + (pad.rest_ohm - pad.least_ohm) * wp.exp(-force / pad.force_scale)
    else:
        if force > ZERO:
            ohm = wp.min(pad.rest_ohm, pad.newton_ohm * wp.pow(force, -pad.power))
    return pad.reference_ohm / (pad.reference_ohm + ohm)


@wp.func
def depth_read(pad: Pad, count: real):
    """How deep a taxel is pressed in [m] that reads `count`, by the pad as believed."""
    none = _voltage(pad, ZERO)
    level = none + (_voltage(pad, pad.saturation) - none) * wp.min(count / _FULL, ONE)
    ohm = pad.reference_ohm * (ONE / level - ONE)
    force = real(0.0)
    if pad.law == _EXPONENTIAL:
        force = -pad.force_scale * wp.log((ohm - pad.least_ohm) / (pad.rest_ohm - pad.least_ohm))
    else:
        force = wp.pow(pad.newton_ohm / ohm, ONE / pad.power)
    past = wp.max(force - pad.stiffness * pad.thickness, ZERO)
    return wp.max((force - past) / pad.stiffness + past / pad.flat, ZERO)


@wp.func
def unloaded_count(pad: Pad, taxel_key: wp.uint64, reading_key: wp.uint64):
    """`taxel_count` without force: noise alone, of which half is negative and reads 0."""
    noise = counter_key(reading_key, 1)
    if counter_normal_is_negative(noise):
        return int(0)
    count = int(wp.clamp(wp.floor(pad.noise * counter_normal(noise) + HALF), ZERO, _FULL))
    if count > 0 and counter_uniform(counter_key(taxel_key, _DEAD)) < pad.dead:
        return int(0)
    return count


@wp.func
def taxel_count(pad: Pad, force: real, taxel_key: wp.uint64, reading_key: wp.uint64):
    """What the converter reads for a force [N]: 0 to 255.

    `taxel_key` is the taxel's own for an episode, `reading_key` this reading's of this taxel.
    """
    if force <= ZERO:
        return unloaded_count(pad, taxel_key, reading_key)
    if counter_uniform(counter_key(taxel_key, _DEAD)) < pad.dead:
        return int(0)
    level = real(0.0)
    felt = force * wp.exp(pad.gain_spread * counter_normal(counter_key(taxel_key, _GAIN)))
    felt = felt * (ONE + pad.repeatability * counter_normal(counter_key(reading_key, 0)))
    if felt >= pad.floor:
        none = _voltage(pad, ZERO)
        level = _FULL * (_voltage(pad, felt) - none) / (_voltage(pad, pad.saturation) - none)
    level = wp.min(level, _FULL) + pad.noise * counter_normal(counter_key(reading_key, 1))
    return int(wp.clamp(wp.floor(level + HALF), ZERO, _FULL))


@wp.func
def noise_limit(pad: Pad):
    """An unloaded taxel reads less than the threshold unless its `noise_draw` is below this."""
    least = (wp.ceil(pad.threshold) - HALF) / wp.max(pad.noise, real(1e-9))
    return wp.exp(-HALF * least * least)


@wp.func
def noise_draw(reading_key: wp.uint64):
    """The number in (0, 1) from which the size of a reading's noise is drawn."""
    return counter_uniform(counter_key(counter_key(reading_key, 1), 1))


@wp.func
def pad_key(key: wp.uint64, finger: int, link: int):
    """Key of one pad of an episode; taxels are hashed in by the caller."""
    return counter_key(counter_key(key, _GAIN), finger * 4 + link)


@wp.func
def pad_reading_key(key: wp.uint64, move: int, step: int, finger: int, link: int):
    """Key of one reading of a pad; taxels are hashed in by the caller."""
    k = counter_key(counter_key(counter_key(key, _READING), move), step)
    return counter_key(k, finger * 4 + link)


@wp.kernel(enable_backward=False)
def _pads_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hand: Hand,
    pad: Pad,
    # Pose in:
    key: wp.array[wp.uint64],
    hand_pose: wp.array[transform],
    q: wp.array2d[vec4],
    reading: int,
    # Pads out:
    force: wp.array4d[real],
    count: wp.array4d[wp.uint8],
):
    i, finger, link = wp.tid()
    i += first
    slot = finger * LINK_COUNT + link
    which = body[i % body.shape[0]]
    if pad.on[link] == 0:
        return
    base = wp.transform_multiply(
        wp.transform_inverse(body_pose[i]),
        wp.transform_multiply(hand_pose[i], finger_base(hand, finger)))
    f = finger_pose(hand, base, q[i, finger])
    at = pad_link(hand, pad, f, link)
    if pad_near(scene, which, pad, at, ZERO):
        for row in range(_SIDE):
            for column in range(_SIDE):
                place = pad_place(pad, at, real(row), real(column))
                force[i, slot, row, column] = taxel_force(scene, which, pad, place.x)
    read = pad_reading_key(key[i], -1, reading, finger, link)
    for row in range(_SIDE):
        for column in range(_SIDE):
            taxel = row * _SIDE + column
            count[i, slot, row, column] = wp.uint8(taxel_count(
                pad, force[i, slot, row, column] * pad.gain[link],
                counter_key(pad_key(key[i], finger, link), taxel), counter_key(read, taxel)))
