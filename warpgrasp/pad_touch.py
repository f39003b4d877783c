"""What one pad makes of a touch: its load, its image, and the first moments of the image."""

import warp as wp

from warpgrasp.counter_random import counter_key
from warpgrasp.real import HALF, ZERO, real, vec2, vec3, vec4
from warpgrasp.scene import Scene
from warpgrasp.tactile_pad import (
    Pad,
    block_near,
    noise_may_reach,
    pad_columns,
    pad_near,
    pad_point,
    pad_row,
    pad_taxel_key,
    taxel_count,
    taxel_force,
)
from warpgrasp.utah_mit_hand import FingerPose, Hand

_SIDE = wp.constant(16)
_WINDOW = wp.constant(3)  # taxels each way from the peak that count for the centroid


@wp.func
def pad_load(scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int):
    """Centre of force (x, y, z) and the sum of the forces on all taxels [N]; zeros without load."""
    total = real(0.0)
    centre = vec3(ZERO, ZERO, ZERO)
    if pad_near(scene, body, pad, hand, f, link):
        for block in range(16):
            if block_near(scene, body, pad, hand, f, link, block):
                columns = pad_columns(pad, hand, 4 * (block % 4))
                for i in range(4):
                    row = pad_row(pad, hand, f, link, real(4 * (block // 4) + i))
                    for j in range(4):
                        x = pad_point(pad, hand, f, row, columns[j]).x
                        force = taxel_force(scene, body, pad, x)
                        total += force
                        centre += x * force
    if total > ZERO:
        centre = centre / total
    return vec4(centre[0], centre[1], centre[2], total)


@wp.func
def pad_feels(
    scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, finger: int, link: int,
    episode: wp.uint64, reading: wp.uint64
):
    """Whether some taxel of a pad reads the threshold: as `read_image` would, less work."""
    for block in range(16):
        near = block_near(scene, body, pad, hand, f, link, block)
        columns = pad_columns(pad, hand, 4 * (block % 4))
        for i in range(4):
            row_number = 4 * (block // 4) + i
            row = pad_row(pad, hand, f, link, real(row_number))
            for j in range(4):
                taxel = row_number * _SIDE + 4 * (block % 4) + j
                force = real(0.0)
                if near:
                    force = taxel_force(scene, body, pad,
                                        pad_point(pad, hand, f, row, columns[j]).x)
                key = counter_key(reading, taxel)
                if force > ZERO or noise_may_reach(pad, key):
                    count = taxel_count(pad, force, pad_taxel_key(episode, finger, link, taxel),
                                        key)
                    if real(count) >= pad.threshold:
                        return True
    return False


@wp.func
def read_image(
    scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, finger: int, link: int,
    episode: wp.uint64, reading: wp.uint64, image: wp.array3d[wp.uint8], i: int
):
    """Read a pad into row `i` of `image`; returns the largest count."""
    peak = int(0)
    for block in range(16):
        near = block_near(scene, body, pad, hand, f, link, block)
        columns = pad_columns(pad, hand, 4 * (block % 4))
        for k in range(4):
            row_number = 4 * (block // 4) + k
            row = pad_row(pad, hand, f, link, real(row_number))
            for j in range(4):
                column_number = 4 * (block % 4) + j
                taxel = row_number * _SIDE + column_number
                force = real(0.0)
                if near:
                    force = taxel_force(scene, body, pad,
                                        pad_point(pad, hand, f, row, columns[j]).x)
                count = taxel_count(pad, force, pad_taxel_key(episode, finger, link, taxel),
                                    counter_key(reading, taxel))
                image[i, row_number, column_number] = wp.uint8(count)
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
