# type: ignore  # Warp structs, whose fields type checkers cannot follow
"""Records of a closing of a hand of chains as kernels see them: the rows they write."""

import warp as wp

from warpgrasp.chain.chain_kernel import vec6, vec12
from warpgrasp.core.dtypes import ZERO, real, struct, transform, vec3
from warpgrasp.core.random_kernel import counter_key

_NAN = wp.constant(real(float("nan")))


@struct
class ChainClosingRow:
    """What the robot knows: as `closing_record.ClosingRow`, torques in place of tensions."""

    status: int
    step: int
    q: vec6
    torque: vec6
    """Mean of readings at rest [N m]."""
    reading: real
    """That stopped the finger [N m; of a switch N]."""


@struct
class ChainTruthRow:
    """The true outcome: as `closing_record.ClosingTruthRow`; `along`, `bend` and `depth` are those
    of a `ChainRest`. `link` is the joint whose link bears most."""

    q: vec6
    torque: vec6
    rest: vec6
    point: vec3
    normal: vec3
    along: vec12
    bend: vec12
    depth: vec12
    link: int
    on_table: int
    touched: int
    met: int
    self_depth: real
    strayed: real
    """How far any place of the pressed finger was from where it would be free [m], at most."""


@wp.func
def no_angles():
    """Of a finger that was not closed."""
    return vec6(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN)


@wp.func
def clear_chain_rows(
    felt: wp.array4d[ChainClosingRow], truth: wp.array4d[ChainTruthRow],
    probe_status: wp.array3d[int], w: int, p: int, g: int, finger: int
):
    """Rows of a finger before its closing."""
    felt[w, p, g, finger].status = probe_status[w, p, g]
    felt[w, p, g, finger].step = -1
    felt[w, p, g, finger].reading = _NAN
    felt[w, p, g, finger].q = no_angles()
    felt[w, p, g, finger].torque = no_angles()
    truth[w, p, g, finger].link = -1
    truth[w, p, g, finger].on_table = 0
    truth[w, p, g, finger].touched = -1
    truth[w, p, g, finger].met = 0
    truth[w, p, g, finger].self_depth = ZERO
    truth[w, p, g, finger].strayed = ZERO
    truth[w, p, g, finger].q = no_angles()
    truth[w, p, g, finger].torque = no_angles()
    truth[w, p, g, finger].rest = no_angles()
    truth[w, p, g, finger].point = vec3(_NAN, _NAN, _NAN)
    truth[w, p, g, finger].normal = vec3(_NAN, _NAN, _NAN)


@wp.func
def hand_from_body(
    body_pose: wp.array[transform], hand_pose: wp.array2d[transform], w: int, p: int
):
    """The pose of the hand's frame in the frame of the body before it."""
    return wp.transform_multiply(wp.transform_inverse(body_pose[w]), hand_pose[w, p])


@wp.func
def finger_stream(
    key: wp.array[wp.uint64], probe_number: wp.array2d[int], w: int, p: int, g: int, finger: int
):
    """The counter of a finger's random numbers in a closing."""
    return counter_key(counter_key(counter_key(key[w], probe_number[w, p]), g), finger)
