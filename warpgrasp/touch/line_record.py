# type: ignore  # Warp structs, whose fields type checkers cannot follow
"""Records of a guarded line as its kernel sees them: what a row starts from, and its outcome."""

import warp as wp

from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.core.dtypes import real, struct, transform, vec3, vec7


@struct
class LineBegin:
    """The start of one row, see `line_touch.LineMove`."""

    body: int
    body_pose: transform
    world: int
    """Whose errors of calibration are its own."""
    key: wp.uint64
    number: int
    start: transform
    direction: vec3
    interval: real
    steps: int
    until_release: int
    arm_q: vec7


@struct
class LineEnd:
    """The outcome: what the robot knows, see `line_touch.LineTouch`, and what is true."""

    status: int
    link: int
    point: vec3
    normal: vec3
    tip: vec3
    believed: transform
    q_read: vec6
    peak: int
    made: int
    arm_time: real
    """Of the move to the line's start."""
    line_time: real
    """That the arm's joints need for the way along the line."""
    arm_path: real
    """Of the hand to the line's start."""
    arm_q: vec7
    # Truth:
    q_true: vec6
    point_true: vec3
    normal_true: vec3
    force_true: real
    on_table: int
    pose_true: transform
