# type: ignore  # Warp functions, which type checkers cannot follow
"""Which taxels may press on something, looked up once for a finger that then moves a little.

A distance changes no faster than one walks: a taxel farther off than the finger can have moved
since is free. Of 256 taxels some twenty are left, and all that a press needs asks those alone.
`pad_rest` looks them up while it works out an energy.
"""

import warp as wp

from warpgrasp.core.dtypes import real, vec2, vec4
from warpgrasp.geometry.scene import Scene, stand_distance
from warpgrasp.mechanism.utah_mit_hand_kernel import FingerPose, Hand
from warpgrasp.touch.pad_kernel import TAXELS, Pad, PadRow, pad_near, pad_point, pad_row_bent

SIGHT_MARGIN = wp.constant(real(3e-4))
"""A taxel farther off than this [m] is left out."""
BLOCKS = 4
"""4 x 4 blocks of 4 x 4 taxels, each skipped by one distance."""
_BLOCKS, _SIDE = wp.constant(BLOCKS), wp.constant(TAXELS)
_SIDE_REAL = wp.constant(real(TAXELS))
_MIDDLE = wp.constant(real(1.5))  # of a block, in taxels
# Where in `pad_turns` rows, and the middles of blocks, begin.
_ROWS = wp.constant(TAXELS)
_MIDDLE_COLUMNS, _MIDDLE_ROWS = wp.constant(2 * TAXELS), wp.constant(2 * TAXELS + BLOCKS)


@wp.func
def taxel_row(pad: Pad, hand: Hand, f: FingerPose, link: int, row: int, turns: wp.array[vec2]):
    """`pad_row` of a row of taxels."""
    return pad_row_bent(pad, hand, f, link, real(row), turns[_ROWS + row])


@wp.func
def taxel_place(
    pad: Pad, hand: Hand, f: FingerPose, row: PadRow, column: int, turns: wp.array[vec2]
):
    """Where a taxel of a row is."""
    return pad_point(pad, hand, f, row, turns[column]).x


@wp.func
def rows_in_sight(
    scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int, block: int,
    turns: wp.array[vec2]
):
    """The rows of four taxels of a block that may come into sight: all their bits."""
    pitch = pad.length / _SIDE_REAL
    width = pad.width / _SIDE_REAL
    top = 4 * (block // _BLOCKS)
    column = turns[_MIDDLE_COLUMNS + block % _BLOCKS]
    bits = int(0)
    row = pad_row_bent(pad, hand, f, link, real(top) + _MIDDLE,
                       turns[_MIDDLE_ROWS + block // _BLOCKS])
    middle = pad_point(pad, hand, f, row, column).x
    if stand_distance(scene, body, middle) < SIGHT_MARGIN + _MIDDLE * wp.sqrt(
            pitch * pitch + width * width):
        for i in range(4):
            x = pad_point(pad, hand, f, taxel_row(pad, hand, f, link, top + i, turns), column).x
            if stand_distance(scene, body, x) < SIGHT_MARGIN + _MIDDLE * width:
                bits = bits | (15 << (4 * i))
    return bits


@wp.func
def sight_holds(pad: Pad, hand: Hand, looked: vec4, q: vec4):
    """Whether at joints `q` no taxel can be farther than the margin from where it was `looked`."""
    turned = wp.abs(q[0] - looked[0])
    travel = turned * hand.abduction_offset
    for link in range(3):
        turned += wp.abs(q[link + 1] - looked[link + 1])
        travel += turned * hand.link_length[link]
    return travel + turned * (hand.link_radius + pad.thickness) < SIGHT_MARGIN


@wp.func
def pad_in_sight(scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int):
    """Whether any taxel of a link's pad may come into sight."""
    return pad_near(scene, body, pad, hand, f, link, SIGHT_MARGIN)
