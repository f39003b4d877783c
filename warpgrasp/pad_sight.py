"""Which taxels may press on something, looked up once for a finger that then moves a little.

A distance changes no faster than one walks: a taxel farther off than the finger can have moved
since is free. Of 256 taxels some twenty are left, and all that a press needs asks those alone.
"""

import warp as wp

from warpgrasp.real import mat42, real, transform, vec4
from warpgrasp.scene import Scene, stand_distance
from warpgrasp.tactile_pad import Pad, pad_column, pad_near, pad_point, pad_row
from warpgrasp.utah_mit_hand import Hand, finger_pose

_MARGIN = wp.constant(real(3e-4))  # [m]
_BLOCKS = wp.constant(4)  # 4 x 4 blocks of 4 x 4 taxels, each skipped by one distance
_SIDE_REAL = wp.constant(real(16.0))
_MIDDLE = wp.constant(real(1.5))  # of a block, in taxels


class _Bits(wp.types.matrix(shape=(3, 16), dtype=int)):
    """For each link and block a bit for each taxel, row by row."""


@wp.struct
class PadSight:
    """The taxels that may press while the joints are near `q`."""

    q: vec4
    taxels: _Bits


@wp.func
def pad_columns(pad: Pad, hand: Hand, first: real, step: real):
    """Rows of a matrix: (sin, cos) of the turns of four columns from `first` on."""
    a = pad_column(pad, hand, first)
    b = pad_column(pad, hand, first + step)
    c = pad_column(pad, hand, first + step * real(2.0))
    d = pad_column(pad, hand, first + step * real(3.0))
    return mat42(a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1])


@wp.func
def block_columns(pad: Pad, hand: Hand, block: int):
    """`pad_columns` of a block's taxels."""
    return pad_columns(pad, hand, real(4 * (block % _BLOCKS)), real(1.0))


@wp.func
def pad_sight(scene: Scene, body: int, pad: Pad, hand: Hand, base: transform, q: vec4):
    """The taxels that may press near joints `q`; `base` in the body's frame."""
    sight = PadSight()
    sight.q = q
    f = finger_pose(hand, base, q)
    pitch = pad.length / _SIDE_REAL
    width = pad.width / _SIDE_REAL
    reach = _MARGIN + _MIDDLE * wp.sqrt(pitch * pitch + width * width)
    quad_reach = _MARGIN + _MIDDLE * width
    middles = pad_columns(pad, hand, _MIDDLE, real(4.0))
    for link in range(3):
        if pad.on[link] != 0 and pad_near(scene, body, pad, hand, f, link, _MARGIN):
            for top in range(4):
                first = real(4 * top)
                across = pad_row(pad, hand, f, link, first + _MIDDLE)
                for side in range(4):
                    middle = pad_point(pad, hand, f, across, middles[side]).x
                    if stand_distance(scene, body, middle) < reach:
                        bits = int(0)
                        columns = block_columns(pad, hand, 4 * top + side)
                        for i in range(4):
                            row = pad_row(pad, hand, f, link, first + real(i))
                            x = pad_point(pad, hand, f, row, middles[side]).x
                            if stand_distance(scene, body, x) < quad_reach:
                                for j in range(4):
                                    x = pad_point(pad, hand, f, row, columns[j]).x
                                    if stand_distance(scene, body, x) < _MARGIN:
                                        bits = bits | (1 << (4 * i + j))
                        sight.taxels[link, _BLOCKS * top + side] = bits
    return sight


@wp.func
def sight_holds(pad: Pad, hand: Hand, sight: PadSight, q: vec4):
    """Whether at joints `q` no taxel can have moved farther than the margin."""
    turned = wp.abs(q[0] - sight.q[0])
    travel = turned * hand.abduction_offset
    for link in range(3):
        turned += wp.abs(q[link + 1] - sight.q[link + 1])
        travel += turned * hand.link_length[link]
    return travel + turned * (hand.link_radius + pad.thickness) < _MARGIN
