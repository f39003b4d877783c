"""What one pad makes of a touch: its load, its image, and the first moments of the image."""

import warp as wp

from warpgrasp.counter_random import counter_key
from warpgrasp.pad_sight import PadSight, PadTurns, taxel_place, taxel_row
from warpgrasp.real import HALF, ZERO, real, vec2, vec3, vec4
from warpgrasp.scene import Scene
from warpgrasp.tactile_pad import (
    Pad,
    noise_draw,
    noise_limit,
    pad_taxel_key,
    taxel_count,
    taxel_force,
)
from warpgrasp.utah_mit_hand import FingerPose, Hand

_SIDE = wp.constant(16)
_WINDOW = wp.constant(3)  # taxels each way from the peak that count for the centroid


@wp.func
def pad_load(
    scene: Scene, body: int, pad: Pad, hand: Hand, turns: PadTurns, f: FingerPose, link: int,
    sight: PadSight
):
    """Centre of force (x, y, z) and the sum of the forces on all taxels [N]; zeros without load."""
    total = real(0.0)
    centre = vec3(ZERO, ZERO, ZERO)
    for block in range(16):
        bits = sight.taxels[link, block]
        if bits != 0:
            for i in range(4):
                if (bits & (15 << (4 * i))) != 0:
                    row = taxel_row(pad, hand, f, link, 4 * (block // 4) + i, turns)
                    for j in range(4):
                        if (bits & (1 << (4 * i + j))) != 0:
                            x = taxel_place(pad, hand, f, row, 4 * (block % 4) + j, turns)
                            force = taxel_force(scene, body, pad, x)
                            total += force
                            centre += x * force
    if total > ZERO:
        centre = centre / total
    return vec4(centre[0], centre[1], centre[2], total)


@wp.func
def _seen(sight: PadSight, link: int, taxel: int):
    """Whether a taxel may press."""
    row = taxel // _SIDE
    column = taxel % _SIDE
    bits = sight.taxels[link, 4 * (row // 4) + column // 4]
    return (bits & (1 << (4 * (row % 4) + column % 4))) != 0


@wp.func
def _pressing(
    scene: Scene, body: int, pad: Pad, hand: Hand, turns: PadTurns, f: FingerPose, link: int,
    taxel: int
):
    """Force on one taxel [N]."""
    row = taxel_row(pad, hand, f, link, taxel // _SIDE, turns)
    return taxel_force(scene, body, pad, taxel_place(pad, hand, f, row, taxel % _SIDE, turns))


@wp.func
def pad_feels(
    scene: Scene, body: int, pad: Pad, hand: Hand, turns: PadTurns, f: FingerPose, finger: int,
    link: int, episode: wp.uint64, reading: wp.uint64, sight: PadSight
):
    """Whether some taxel of a pad reads the threshold: as `read_image` would, less work.

    Pressed taxels are asked first, those that noise alone may raise only if none of them says so.
    """
    for taxel in range(_SIDE * _SIDE):
        if _seen(sight, link, taxel):
            force = _pressing(scene, body, pad, hand, turns, f, link, taxel)
            if force > ZERO and real(taxel_count(
                    pad, force, pad_taxel_key(episode, finger, link, taxel),
                    counter_key(reading, taxel))) >= pad.threshold:
                return True
    most = noise_limit(pad)
    for taxel in range(_SIDE * _SIDE):
        key = counter_key(reading, taxel)
        if noise_draw(key) < most:
            force = real(0.0)
            if _seen(sight, link, taxel):
                force = _pressing(scene, body, pad, hand, turns, f, link, taxel)
            if real(taxel_count(
                    pad, force, pad_taxel_key(episode, finger, link, taxel), key)) >= pad.threshold:
                return True
    return False


@wp.func
def read_image(
    scene: Scene, body: int, pad: Pad, hand: Hand, turns: PadTurns, f: FingerPose, finger: int,
    link: int, episode: wp.uint64, reading: wp.uint64, sight: PadSight,
    image: wp.array3d[wp.uint8], i: int
):
    """Read a pad into row `i` of `image`; returns the largest count."""
    peak = int(0)
    for taxel in range(_SIDE * _SIDE):
        force = real(0.0)
        if _seen(sight, link, taxel):
            force = _pressing(scene, body, pad, hand, turns, f, link, taxel)
        count = taxel_count(pad, force, pad_taxel_key(episode, finger, link, taxel),
                            counter_key(reading, taxel))
        image[i, taxel // _SIDE, taxel % _SIDE] = wp.uint8(count)
        peak = wp.max(peak, count)
    return peak


@wp.func
def image_centroid(image: wp.array3d[wp.uint8], i: int, least: real):
    """(row, column) by first moments of the counts from `least` on near the strongest taxel.

    The window keeps a taxel far off that noise alone has raised from pulling the centroid away.
    """
    top_row = int(0)
    top_column = int(0)
    for taxel in range(_SIDE * _SIDE):
        if int(image[i, taxel // _SIDE, taxel % _SIDE]) > int(image[i, top_row, top_column]):
            top_row = taxel // _SIDE
            top_column = taxel % _SIDE
    mass = real(0.0)
    at_row = real(0.0)
    at_column = real(0.0)
    for taxel in range(_SIDE * _SIDE):
        row = taxel // _SIDE
        column = taxel % _SIDE
        count = real(int(image[i, row, column]))
        if count >= least and wp.abs(row - top_row) <= _WINDOW and wp.abs(
                column - top_column) <= _WINDOW:
            mass += count
            at_row += count * real(row)
            at_column += count * real(column)
    if mass <= ZERO:
        return vec2(real(top_row), real(top_column))
    return vec2(at_row / mass, at_column / mass)


@wp.func
def felt_above(pad: Pad):
    """Counts that stand out of the noise once a pad is known to feel."""
    return pad.threshold * HALF
