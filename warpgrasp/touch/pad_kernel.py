# type: ignore  # Warp functions, which type checkers cannot follow
"""Tactile pads in kernels: places, forces and readings of taxels."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat32, real, struct, transform, vec2, vec3, vec4
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import (
    counter_key,
    counter_normal,
    counter_normal_is_negative,
    counter_uniform,
)
from warpgrasp.core.sincos import sine_cosine
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

TAXELS = 16
"""Rows and columns of a pad [paper]."""

wp.set_module_options({"max_unroll": 1})
_SIDE = wp.constant(16)
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
def _straight(pad: Pad, hand: Hand, link: int):
    """Length of a pad's straight part [m]."""
    if link == 2:
        return pad.length - pad.wrap * (hand.link_radius + pad.thickness)
    return pad.length


@wp.func
def pad_bend(pad: Pad, hand: Hand, row: real):
    """(sin, cos) of a row's turn over the fingertip; of no use before it."""
    s = (row + HALF) * pad.length / _SIDE_REAL
    return sine_cosine((s - _straight(pad, hand, 2)) / (hand.link_radius + pad.thickness))


@wp.func
def _turned(angle: vec2, further: real):
    """(sin, cos) of an angle increased by a small one."""
    if further == ZERO:
        return angle
    by = sine_cosine(further)
    return vec2(angle[0] * by[1] + angle[1] * by[0], angle[1] * by[1] - angle[0] * by[0])


@wp.func
def pad_row_bent(pad: Pad, hand: Hand, f: FingerPose, link: int, row: real, bend: vec2):
    """`pad_row`, its `pad_bend` before the pad's error given."""
    s = (row + HALF) * pad.length / _SIDE_REAL + pad.shift[link, 0]
    u = link_direction(f, link)
    n = wp.cross(f.side, u)
    straight = _straight(pad, hand, link)
    at = PadRow()
    if link == 2 and s > straight:
        turn = _turned(bend, pad.shift[link, 0] / (hand.link_radius + pad.thickness))
        at.out = n * turn[1] + u * turn[0]
        at.axis = f.p4
    else:
        start = (hand.link_length[link] - straight) * wp.where(link == 2, ONE, HALF)
        at.out = n
        at.axis = link_start(f, link) + u * (start + s)
    return at


@wp.func
def pad_row(pad: Pad, hand: Hand, f: FingerPose, link: int, row: real):
    """Row `row` of a pad, taxels' rows being whole numbers; in the frame of `f`."""
    return pad_row_bent(pad, hand, f, link, row, pad_bend(pad, hand, row))


@wp.func
def pad_column(pad: Pad, hand: Hand, column: real):
    """(sin, cos) of a column's turn about the link's axis, before the pad's error."""
    radius = hand.link_radius + pad.thickness
    return sine_cosine((column + HALF - _SIDE_REAL * HALF) * pad.width / (_SIDE_REAL * radius))


@wp.func
def pad_point(pad: Pad, hand: Hand, f: FingerPose, link: int, row: PadRow, column: vec2):
    """The place of a row and a column of a pad."""
    place = PadPlace()
    turn = _turned(column, pad.shift[link, 1] / (hand.link_radius + pad.thickness))
    place.out = row.out * turn[1] + f.side * turn[0]
    place.x = row.axis + place.out * (hand.link_radius + pad.thickness)
    return place


@wp.func
def pad_place(pad: Pad, hand: Hand, f: FingerPose, link: int, row: real, column: real):
    """The place at (row, column), taxel centres being whole numbers; in the frame of `f`."""
    return pad_point(pad, hand, f, link, pad_row(pad, hand, f, link, row),
                     pad_column(pad, hand, column))


@wp.func
def pad_near(
    scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int, margin: real
):
    """Whether a pad may be nearer than `margin` to an obstacle: a bound from its middle."""
    middle = pad_place(pad, hand, f, link, _SIDE_REAL * HALF, _SIDE_REAL * HALF)
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
def pad_taxel_key(key: wp.uint64, finger: int, link: int, taxel: int):
    """Key of one taxel of one pad of an episode."""
    return counter_key(counter_key(counter_key(key, _GAIN), finger * 4 + link), taxel)


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
    if pad_near(scene, which, pad, hand, f, link, ZERO):
        for row in range(_SIDE):
            for column in range(_SIDE):
                place = pad_place(pad, hand, f, link, real(row), real(column))
                force[i, slot, row, column] = taxel_force(scene, which, pad, place.x)
    read = pad_reading_key(key[i], -1, reading, finger, link)
    for row in range(_SIDE):
        for column in range(_SIDE):
            taxel = row * _SIDE + column
            count[i, slot, row, column] = wp.uint8(taxel_count(
                pad, force[i, slot, row, column] * pad.gain[link],
                pad_taxel_key(key[i], finger, link, taxel), counter_key(read, taxel)))
