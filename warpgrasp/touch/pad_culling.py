# type: ignore  # Warp functions, which type checkers cannot follow
"""Pad culling: which taxels may press, computed once for a finger that then moves a little.

Signed distances are 1-Lipschitz: a taxel farther away than the finger can have moved is free. Some
twenty of the 256 taxels remain, and the equilibrium evaluates these alone.
"""

import warp as wp

from warpgrasp.core.dtypes import real, vec2, vec4
from warpgrasp.geometry.scene import Scene, body_table_distance
from warpgrasp.mechanism.utah_mit_hand_kernel import FingerPose, Hand
from warpgrasp.touch.pad_kernel import TAXELS, Pad, PadRow, pad_near, pad_point, pad_row_bent

CULLING_MARGIN = wp.constant(real(3e-4))
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
    pad: Pad, hand: Hand, f: FingerPose, link: int, row: PadRow, column: int, turns: wp.array[vec2]
):
    """The place of a taxel of a row."""
    return pad_point(pad, hand, f, link, row, turns[column]).x


@wp.func
def rows_near(
    scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int, block: int,
    turns: wp.array[vec2]
):
    """The rows of four taxels of a block that may be within the margin, as bits."""
    pitch = pad.length / _SIDE_REAL
    width = pad.width / _SIDE_REAL
    top = 4 * (block // _BLOCKS)
    column = turns[_MIDDLE_COLUMNS + block % _BLOCKS]
    bits = int(0)
    row = pad_row_bent(pad, hand, f, link, real(top) + _MIDDLE,
                       turns[_MIDDLE_ROWS + block // _BLOCKS])
    middle = pad_point(pad, hand, f, link, row, column).x
    if body_table_distance(scene, body, middle) < CULLING_MARGIN + _MIDDLE * wp.sqrt(
            pitch * pitch + width * width):
        for i in range(4):
            x = pad_point(
                pad, hand, f, link, taxel_row(pad, hand, f, link, top + i, turns), column).x
            if body_table_distance(scene, body, x) < CULLING_MARGIN + _MIDDLE * width:
                bits = bits | (15 << (4 * i))
    return bits


@wp.func
def culling_holds(pad: Pad, hand: Hand, culled_at: vec4, q: vec4):
    """Whether at joints `q` no taxel can have moved by more than the margin from `culled_at`."""
    turned = wp.abs(q[0] - culled_at[0])
    travel = turned * hand.abduction_offset
    for link in range(3):
        turned += wp.abs(q[link + 1] - culled_at[link + 1])
        travel += turned * hand.link_length[link]
    return travel + turned * (hand.link_radius + pad.thickness) < CULLING_MARGIN


@wp.func
def pad_is_near(scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int):
    """Whether any taxel of a link's pad may be within the margin."""
    return pad_near(scene, body, pad, hand, f, link, CULLING_MARGIN)
