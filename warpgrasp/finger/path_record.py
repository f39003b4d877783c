# type: ignore  # Warp structs, whose fields type checkers cannot follow
"""Records of a closing path as kernels see them: commands, and the links of a finger on them."""

import warp as wp

from warpgrasp.core.dtypes import real, struct, vec3, vec4
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
