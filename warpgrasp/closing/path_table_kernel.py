# type: ignore  # Warp functions, which type checkers cannot follow
"""The tables of a closing path, in a kernel: a row for each robot and grasp."""

import warp as wp

from warpgrasp.closing.closing_record import LinkStep, PathStep
from warpgrasp.core.dtypes import ONE, ZERO, real, vec4
from warpgrasp.mechanism.utah_mit_hand_kernel import FingerPose, Hand, finger_pose, link_start

wp.set_module_options({"max_unroll": 1})
_STILL = wp.constant(real(1e-12))  # [rad]; joint steps below are none
_UNMOVED = wp.constant(real(1e9))  # steps a metre of a link that stands still


@wp.func
def _end(f: FingerPose, link: int):
    if link == 2:
        return f.p4
    return link_start(f, link + 1)


@wp.kernel(enable_backward=False)
def path_kernel(
    first: int,
    # Robot:
    hands: wp.array2d[Hand],
    # Commands in:
    commands: wp.array4d[real],
    # Tables out:
    path: wp.array3d[PathStep],
    links: wp.array4d[LinkStep],
):
    """A finger's row: where the joint sensors' errors let it go on its commands."""
    r, finger = wp.tid()
    r += first
    g = r % commands.shape[0]
    hand = hands[r // commands.shape[0], finger]
    base = wp.transform_identity(dtype=real)
    moves = real(0.0)
    for s in range(commands.shape[2]):
        command = vec4(commands[g, finger, s, 0], commands[g, finger, s, 1],
                       commands[g, finger, s, 2], commands[g, finger, s, 3])
        if s > 0:
            for j in range(1, 4):
                if wp.abs(command[j] - commands[g, finger, s - 1, j]) > _STILL:
                    moves += ONE
        path[r, finger, s].command = command - hand.offset
        path[r, finger, s].moves = moves
        f = finger_pose(hand, base, command - hand.offset)
        for link in range(3):
            start = link_start(f, link)
            end = _end(f, link)
            come = ZERO
            if s > 0:
                before = links[r, finger, link, s - 1]
                # A point of a link moves no farther than the farther-moving of its ends.
                come = before.come + wp.max(wp.length(start - before.start),
                                            wp.length(end - before.end))
            links[r, finger, link, s].start = start
            links[r, finger, link, s].end = end
            links[r, finger, link, s].come = come
    for link in range(3):
        steps = real(_UNMOVED)
        for back in range(commands.shape[2]):
            s = commands.shape[2] - 1 - back
            if back > 0:
                way = links[r, finger, link, s + 1].come - links[r, finger, link, s].come
                steps = wp.min(steps, ONE / wp.max(way, ONE / _UNMOVED))
            links[r, finger, link, s].steps = steps
