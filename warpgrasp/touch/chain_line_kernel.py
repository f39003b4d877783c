# type: ignore  # Warp functions, which type checkers cannot follow
"""The kernel of a guarded line of a hand of chains: `line_row` with its fingers and palm."""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain, ChainBar, vec6
from warpgrasp.core.dtypes import real, transform, vec2
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.arm_kernel import Arm
from warpgrasp.touch.guarded_motion_kernel import line_row
from warpgrasp.touch.line_record import LineBegin, LineEnd
from warpgrasp.touch.pad_kernel import Pad

wp.set_module_options({"max_unroll": 1})  # unrolled taxels take minutes to compile


@wp.kernel(enable_backward=False)
def chain_line_kernel(
    first: int,
    # Scene:
    scene: Scene,
    # Robot:
    arm: Arm,
    hands: wp.array2d[Chain],
    pad: Pad,
    turns: wp.array[vec2],
    true_arms: wp.array[Arm],
    true_hands: wp.array2d[Chain],
    true_pads: wp.array2d[Pad],
    mount: wp.array[transform],
    palm: wp.array[ChainBar],
    joint_noise: real,
    march_scale: real,
    # Move in:
    begins: wp.array[LineBegin],
    finger: int,
    commands: wp.array2d[vec6],
    swing: real,
    checked: int,
    # Scratch, for the taxels in sight:
    near_bits: wp.array3d[int],
    # Touch out:
    image: wp.array3d[wp.uint8],
    ends: wp.array[LineEnd],
):
    """A row; `hands` (1, finger) are believed."""
    line_row(wp.tid() + first, scene, arm, hands[0, finger], pad, turns, true_arms, true_hands,
             true_pads, mount, palm, joint_noise, march_scale, begins, finger, commands, swing,
             checked, near_bits, image, ends)
