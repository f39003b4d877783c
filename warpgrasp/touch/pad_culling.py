# type: ignore  # Warp functions, which type checkers cannot follow
"""Pad culling: which taxels may press, computed once for a finger that then moves a little.

Signed distances are 1-Lipschitz: a taxel farther away than the finger can have moved is free. Some
twenty of the 256 taxels remain, and the equilibrium evaluates these alone.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain, vec6
from warpgrasp.core.dtypes import real, vec2, vec4
from warpgrasp.finger.chain_energy import links_moved
from warpgrasp.geometry.scene import Scene, body_table_distance
from warpgrasp.mechanism.utah_mit_hand import LINK_COUNT
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.parameters import TAXELS
from warpgrasp.touch.pad_kernel import (
    ChainPad,
    Pad,
    PadLink,
    PadRow,
    pad_near,
    pad_point,
    pad_row_bent,
)

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
def taxel_row(pad: Pad, at: PadLink, row: int, turns: wp.array[vec2]):
    """`pad_row` of a row of taxels."""
    return pad_row_bent(pad, at, real(row), turns[at.turns + _ROWS + row])


@wp.func
def taxel_place(pad: Pad, at: PadLink, row: PadRow, column: int, turns: wp.array[vec2]):
    """The place of a taxel of a row."""
    return pad_point(pad, at, row, turns[at.turns + column]).x


@wp.func
def rows_near(
    scene: Scene, body: int, pad: Pad, at: PadLink, block: int, turns: wp.array[vec2]
):
    """The rows of four taxels of a block that may be within the margin, as bits."""
    pitch = pad.length / _SIDE_REAL
    width = pad.width / _SIDE_REAL
    top = 4 * (block // _BLOCKS)
    column = turns[at.turns + _MIDDLE_COLUMNS + block % _BLOCKS]
    bits = int(0)
    row = pad_row_bent(pad, at, real(top) + _MIDDLE,
                       turns[at.turns + _MIDDLE_ROWS + block // _BLOCKS])
    middle = pad_point(pad, at, row, column).x
    if body_table_distance(scene, body, middle) < CULLING_MARGIN + _MIDDLE * wp.sqrt(
            pitch * pitch + width * width):
        for i in range(4):
            x = pad_point(pad, at, taxel_row(pad, at, top + i, turns), column).x
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
def culling_holds(pad: Pad, hand: Chain, culled_at: vec6, q: vec6):  # noqa: F811 (an overload)
    """The same of a chain at drives `q`."""
    rows = wp.array(ptr=pad.places, shape=(LINK_COUNT,), dtype=ChainPad)
    turned, travel = links_moved(hand, q, culled_at)
    most = real(0.0)
    for link in range(LINK_COUNT):
        if pad.on[link] != 0:
            row = rows[link]
            far = wp.max(wp.length(row.start), wp.length(row.end)) + row.radius + pad.thickness
            most = wp.max(most, travel[row.joint] + turned[row.joint] * far)
    return most < CULLING_MARGIN


@wp.func
def pad_is_near(scene: Scene, body: int, pad: Pad, at: PadLink):
    """Whether any taxel of a link's pad may be within the margin."""
    return pad_near(scene, body, pad, at, CULLING_MARGIN)
