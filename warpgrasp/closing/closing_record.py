# type: ignore  # Warp structs, whose fields type checkers cannot follow
"""Records of a closing as kernels see them: the rows they write for each finger."""

import warp as wp

from warpgrasp.core.dtypes import ZERO, mat42, real, struct, transform, vec3, vec4
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_base

_NAN = wp.constant(real(float("nan")))


@struct
class ClosingRow:
    """The row of a `Closing`."""

    status: int
    step: int
    q: vec4
    tension: mat42
    difference: real


@struct
class ClosingTruthRow:
    """The row of a `ClosingTruth`; `along`, `bend` and `depth` are those of a `Equilibrium`."""

    q: vec4
    torque: vec4
    rest: vec4
    """Joints when the whole hand has come to rest: fingers that stopped may be pushed later."""
    point: vec3
    normal: vec3
    along: vec3
    bend: vec3
    depth: vec3
    link: int
    on_table: int
    touched: int
    """The first step, of those looked at, that pressed a link against something; -1 if none."""
    met: int
    """Whether it was closed together with the others, since their links touched it."""
    self_depth: real
    """How deep another finger or the palm presses into its skin [m]."""

@wp.func
def clear_rows(
    felt: wp.array4d[ClosingRow], truth: wp.array4d[ClosingTruthRow],
    probe_status: wp.array3d[int], w: int, p: int, g: int, finger: int
):
    """Rows of a finger before its closing."""
    felt[w, p, g, finger].status = probe_status[w, p, g]
    felt[w, p, g, finger].step = -1
    felt[w, p, g, finger].difference = _NAN
    truth[w, p, g, finger].link = -1
    truth[w, p, g, finger].touched = -1
    truth[w, p, g, finger].met = 0
    truth[w, p, g, finger].self_depth = ZERO
    truth[w, p, g, finger].q = vec4(_NAN, _NAN, _NAN, _NAN)
    truth[w, p, g, finger].torque = vec4(_NAN, _NAN, _NAN, _NAN)
    truth[w, p, g, finger].rest = vec4(_NAN, _NAN, _NAN, _NAN)


@wp.func
def stays_open(closes: wp.array3d[int], w: int, p: int, finger: int):
    """Whether a finger holds its first command; `closes` has axes (world, probe, finger), each of
    which may be shared."""
    return closes[w % closes.shape[0], p % closes.shape[1], finger % closes.shape[2]] == 0


@wp.func
def base_from_body(
    body_pose: wp.array[transform], hand_pose: wp.array2d[transform], hand: Hand, w: int, p: int,
    finger: int
):
    """A finger's base in the frame of the body before it."""
    return wp.transform_multiply(
        wp.transform_inverse(body_pose[w]),
        wp.transform_multiply(hand_pose[w, p], finger_base(hand, finger)))


@wp.func
def finger_key(
    key: wp.array[wp.uint64], probe_number: wp.array2d[int], w: int, p: int, g: int, finger: int
):
    """The counter of a finger's random numbers in a closing."""
    return counter_key(counter_key(counter_key(key[w], probe_number[w, p]), g), finger)
