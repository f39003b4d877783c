# type: ignore  # Warp structs, whose fields type checkers cannot follow
"""Records of a closing as kernels see them: its path, and the rows they write for each finger."""


import warp as wp

from warpgrasp.core.dtypes import mat42, real, struct, vec3, vec4
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand


@struct
class PathStep:
    """A command [rad].

    Of commands so far, for fingers that touch nothing: `strain` is the largest torque [N m] that
    servos of flexions put on the joints' stops, `inward` how far any skin came towards the thumb's
    side, from the finger's base [m], and `palm` how near any came to the palm [m].
    """

    command: vec4
    strain: real
    inward: real
    palm: real


@struct
class LinkStep:
    """A link of the free finger at a step, in the frame of the finger's base.

    `start` and `end` bound its axis [m], weight and errors of calibration apart. `come` bounds the
    distance [m] that any of its points has moved since the first step; `swing` is the sum of all
    turns so far times what they turn [m], of which weight and errors of calibration add
    `Hand.askew`. `steps` is the number of steps per metre at its fastest from here on [1/m].
    """

    start: vec3
    end: vec3
    come: real
    swing: real
    steps: real


@wp.func
def true_command(hand: Hand, path: wp.array3d[PathStep], grasp: int, finger: int, step: int):
    """The command at which the true joints stand, the errors of their sensors taken off [rad]."""
    return path[grasp, finger, step].command - hand.offset


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
