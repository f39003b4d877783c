"""Which taxels may press on something, looked up once for a finger that then moves a little.

A distance changes no faster than one walks: a taxel farther off than the finger can have moved
since is free. Of 256 taxels some twenty are left, and all that a press needs asks those alone.
`pad_rest` looks them up while it works out an energy.
"""

import warp as wp

from warpgrasp.real import mat42, real, vec4
from warpgrasp.scene import Scene, stand_distance
from warpgrasp.tactile_pad import (
    Pad,
    PadRow,
    pad_bend,
    pad_column,
    pad_near,
    pad_point,
    pad_row_bent,
)
from warpgrasp.utah_mit_hand import FingerPose, Hand

SIGHT_MARGIN = wp.constant(real(3e-4))
"""A taxel farther off than this [m] is left out."""
_BLOCKS = wp.constant(4)  # 4 x 4 blocks of 4 x 4 taxels, each skipped by one distance
_SIDE = wp.constant(16)
_SIDE_REAL = wp.constant(real(16.0))
_MIDDLE = wp.constant(real(1.5))  # of a block, in taxels


class _Bits(wp.types.matrix(shape=(3, 16), dtype=int)):
    """For each link and block a bit for each taxel, row by row."""


class _Turns(wp.types.matrix(shape=(16, 2), dtype=real)):
    """(sin, cos) of sixteen turns."""


@wp.struct
class PadSight:
    """The taxels that may press while the joints are near `q`."""

    q: vec4
    taxels: _Bits


@wp.struct
class PadTurns:
    """What of a pad's places does not hang on the finger: turns of columns, bends of rows."""

    columns: _Turns
    rows: _Turns
    middle_columns: mat42
    """Turns of columns in the middles of blocks."""
    middle_rows: mat42
    """Bends of rows there."""


@wp.func
def pad_turns(pad: Pad, hand: Hand):
    """A pad's turns, worked out once for all that is asked of it."""
    turns = PadTurns()
    for k in range(_SIDE):
        a = pad_column(pad, hand, real(k))
        turns.columns[k, 0] = a[0]
        turns.columns[k, 1] = a[1]
        b = pad_bend(pad, hand, real(k))
        turns.rows[k, 0] = b[0]
        turns.rows[k, 1] = b[1]
    for k in range(_BLOCKS):
        c = pad_column(pad, hand, _MIDDLE + real(4 * k))
        turns.middle_columns[k, 0] = c[0]
        turns.middle_columns[k, 1] = c[1]
        d = pad_bend(pad, hand, _MIDDLE + real(4 * k))
        turns.middle_rows[k, 0] = d[0]
        turns.middle_rows[k, 1] = d[1]
    return turns


@wp.func
def taxel_row(pad: Pad, hand: Hand, f: FingerPose, link: int, row: int, turns: PadTurns):
    """`pad_row` of a row of taxels."""
    return pad_row_bent(pad, hand, f, link, real(row), turns.rows[row])


@wp.func
def taxel_place(pad: Pad, hand: Hand, f: FingerPose, row: PadRow, column: int, turns: PadTurns):
    """Where a taxel of a row is."""
    return pad_point(pad, hand, f, row, turns.columns[column]).x


@wp.func
def rows_in_sight(
    scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int, block: int,
    turns: PadTurns
):
    """The rows of four taxels of a block that may come into sight: all their bits."""
    pitch = pad.length / _SIDE_REAL
    width = pad.width / _SIDE_REAL
    top = 4 * (block // _BLOCKS)
    column = turns.middle_columns[block % _BLOCKS]
    bits = int(0)
    row = pad_row_bent(pad, hand, f, link, real(top) + _MIDDLE, turns.middle_rows[block // _BLOCKS])
    middle = pad_point(pad, hand, f, row, column).x
    if stand_distance(scene, body, middle) < SIGHT_MARGIN + _MIDDLE * wp.sqrt(
            pitch * pitch + width * width):
        for i in range(4):
            x = pad_point(pad, hand, f, taxel_row(pad, hand, f, link, top + i, turns), column).x
            if stand_distance(scene, body, x) < SIGHT_MARGIN + _MIDDLE * width:
                bits = bits | (15 << (4 * i))
    return bits


@wp.func
def sight_holds(pad: Pad, hand: Hand, sight: PadSight, q: vec4):
    """Whether at joints `q` no taxel can have moved farther than the margin."""
    turned = wp.abs(q[0] - sight.q[0])
    travel = turned * hand.abduction_offset
    for link in range(3):
        turned += wp.abs(q[link + 1] - sight.q[link + 1])
        travel += turned * hand.link_length[link]
    return travel + turned * (hand.link_radius + pad.thickness) < SIGHT_MARGIN


@wp.func
def pad_in_sight(scene: Scene, body: int, pad: Pad, hand: Hand, f: FingerPose, link: int):
    """Whether any taxel of a link's pad may come into sight."""
    return pad_near(scene, body, pad, hand, f, link, SIGHT_MARGIN)
