# type: ignore  # Warp functions, which type checkers cannot follow
"""The readout of a pad: load, tactile image, and the first moments of the image."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, real, vec2, vec3, vec4
from warpgrasp.core.random_kernel import counter_key, counter_uniform
from warpgrasp.geometry.scene import Scene
from warpgrasp.touch.pad_culling import taxel_place, taxel_row
from warpgrasp.touch.pad_kernel import (
    Pad,
    PadLink,
    depth_read,
    noise_draw,
    noise_limit,
    pad_key,
    taxel_count,
    taxel_force,
    unloaded_count,
)
from warpgrasp.touch.taxel_lanes import TAXELS_AT_ONCE, greatest_count, read_unloaded

_SIDE = wp.constant(16)
_AT_ONCE = wp.constant(TAXELS_AT_ONCE)
_GROUPS = wp.constant(16 * 16 // TAXELS_AT_ONCE)
_WINDOW = wp.constant(3)  # taxels each way from the peak that count for the centroid


@wp.func
def pad_load(
    scene: Scene, body: int, pad: Pad, at: PadLink, turns: wp.array[vec2],
    near_bits: wp.array2d[int]
):
    """Centre of force (x, y, z) and the sum of the forces on all taxels [N]; zeros without load."""
    total = real(0.0)
    centre = vec3(ZERO, ZERO, ZERO)
    for block in range(16):
        bits = near_bits[at.slot, block]
        if bits != 0:
            for i in range(4):
                if (bits & (15 << (4 * i))) != 0:
                    row = taxel_row(pad, at, 4 * (block // 4) + i, turns)
                    for j in range(4):
                        if (bits & (1 << (4 * i + j))) != 0:
                            x = taxel_place(pad, at, row, 4 * (block % 4) + j, turns)
                            force = taxel_force(scene, body, pad, x)
                            total += force
                            centre += x * force
    if total > ZERO:
        centre = centre / total
    return vec4(centre[0], centre[1], centre[2], total)


@wp.func(inline=False)
def pad_feels(
    scene: Scene, body: int, pad: Pad, at: PadLink, turns: wp.array[vec2], finger: int,
    episode: wp.uint64, reading: wp.uint64, near_bits: wp.array2d[int]
):
    """Whether a taxel of a pad reads the threshold or more: the same result as by `read_image`.

    Pressed taxels are read first, those that noise alone may raise only if none of them feels.
    """
    own = pad_key(episode, finger, at.slot)
    for block in range(16):
        bits = near_bits[at.slot, block]
        if bits != 0:
            for i in range(4):
                if (bits & (15 << (4 * i))) != 0:
                    line = 4 * (block // 4) + i
                    row = taxel_row(pad, at, line, turns)
                    for j in range(4):
                        if (bits & (1 << (4 * i + j))) != 0:
                            column = 4 * (block % 4) + j
                            x = taxel_place(pad, at, row, column, turns)
                            force = taxel_force(scene, body, pad, x) * pad.gain[at.slot]
                            taxel = line * _SIDE + column
                            if force > ZERO and real(taxel_count(
                                    pad, force, counter_key(own, taxel),
                                    counter_key(reading, taxel))) >= pad.threshold:
                                return True
    most = noise_limit(pad)
    # The least draw of all first, in a loop without branches: hardly ever is it small enough.
    least = ~wp.uint64(0)
    for taxel in range(_SIDE * _SIDE):
        least = wp.min(least, counter_key(counter_key(counter_key(reading, taxel), 1), 1))
    if counter_uniform(least) >= most:
        return False
    for taxel in range(_SIDE * _SIDE):
        key = counter_key(reading, taxel)
        if noise_draw(key) < most:
            force = real(0.0)
            line = taxel // _SIDE
            column = taxel % _SIDE
            bits = near_bits[at.slot, 4 * (line // 4) + column // 4]
            if (bits & (1 << (4 * (line % 4) + column % 4))) != 0:
                row = taxel_row(pad, at, line, turns)
                x = taxel_place(pad, at, row, column, turns)
                force = taxel_force(scene, body, pad, x) * pad.gain[at.slot]
            if real(taxel_count(pad, force, counter_key(own, taxel), key)) >= pad.threshold:
                return True
    return False


@wp.func
def read_image(
    scene: Scene, body: int, pad: Pad, at: PadLink, turns: wp.array[vec2], finger: int,
    episode: wp.uint64, reading: wp.uint64, near_bits: wp.array2d[int],
    image: wp.array3d[wp.uint8], i: int
):
    """Read a pad into row `i` of `image`; returns the largest count.

    All taxels are first read as unloaded, then the pressed ones with their load.
    """
    own = pad_key(episode, finger, at.slot)
    for group in range(_GROUPS):
        if not read_unloaded(pad.noise, pad.dead, own, reading, group * _AT_ONCE, image, i):
            for lane in range(_AT_ONCE):
                taxel = group * _AT_ONCE + lane
                image[i, taxel // _SIDE, taxel % _SIDE] = wp.uint8(unloaded_count(
                    pad, counter_key(own, taxel), counter_key(reading, taxel)))
    for block in range(16):
        bits = near_bits[at.slot, block]
        if bits != 0:
            for k in range(4):
                if (bits & (15 << (4 * k))) != 0:
                    line = 4 * (block // 4) + k
                    row = taxel_row(pad, at, line, turns)
                    for j in range(4):
                        if (bits & (1 << (4 * k + j))) != 0:
                            column = 4 * (block % 4) + j
                            x = taxel_place(pad, at, row, column, turns)
                            force = taxel_force(scene, body, pad, x) * pad.gain[at.slot]
                            if force > ZERO:
                                taxel = line * _SIDE + column
                                image[i, line, column] = wp.uint8(taxel_count(
                                    pad, force, counter_key(own, taxel),
                                    counter_key(reading, taxel)))
    return greatest_count(image, i)


@wp.func
def image_centroid(image: wp.array3d[wp.uint8], i: int, peak: int, least: real):
    """(row, column) by first moments of the counts from `least` on near the strongest taxel.

    `peak` is the largest count. The window keeps distant taxels that noise alone has raised from
    shifting the centroid.
    """
    top = int(0)
    while int(image[i, top // _SIDE, top % _SIDE]) != peak:
        top += 1
    top_row = top // _SIDE
    top_column = top % _SIDE
    mass = real(0.0)
    at_row = real(0.0)
    at_column = real(0.0)
    for row in range(wp.max(top_row - _WINDOW, 0), wp.min(top_row + _WINDOW + 1, _SIDE)):
        for column in range(wp.max(top_column - _WINDOW, 0),
                            wp.min(top_column + _WINDOW + 1, _SIDE)):
            count = real(int(image[i, row, column]))
            if count >= least:
                mass += count
                at_row += count * real(row)
                at_column += count * real(column)
    if mass <= ZERO:
        return vec2(real(top_row), real(top_column))
    return vec2(at_row / mass, at_column / mass)


@wp.func
def image_depth(pad: Pad, image: wp.array3d[wp.uint8], i: int, at: vec2, peak: int):
    """How deep the pad is pressed in [m] at a place (row, column) of its image.

    Of the taxel nearest to the place; where that one feels nothing (it may be dead), by the peak.
    """
    count = real(int(image[i, int(at[0] + HALF), int(at[1] + HALF)]))
    if count < felt_above(pad):
        count = real(peak)
    return depth_read(pad, count)


@wp.func
def felt_above(pad: Pad):
    """The counts that exceed the noise once a pad is known to feel."""
    return pad.threshold * HALF
