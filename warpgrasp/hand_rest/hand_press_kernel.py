# type: ignore  # Warp functions, which type checkers cannot follow
"""How well pressing on the others, or on the palm, explains where a finger stopped: a kernel."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, real, transform, vec4
from warpgrasp.geometry.segment_pair import Nearest, segment_pair
from warpgrasp.hand_rest.link_gap import above_palm, link_end, links_within, palm_capsule
from warpgrasp.hand_rest.press_kernel import (
    NO_PRESS,
    PRESS_REACH,
    Doubt,
    press_misfit,
    pushed_turn,
)
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    Hand,
    finger_base,
    finger_jacobian,
    finger_pose,
    free_joints,
    link_start,
)
from warpgrasp.probe_status import ProbeStatus

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))


@wp.func
def _free(
    hand: Hand, pose: transform, commands: wp.array4d[real], grasp: int, finger: int, step: int
):
    """Where a finger that touches nothing rests at a command; `pose` is the hand's."""
    command = vec4(commands[grasp, finger, step, 0], commands[grasp, finger, step, 1],
                   commands[grasp, finger, step, 2], commands[grasp, finger, step, 3])
    return free_joints(hand, wp.transform_multiply(pose, finger_base(hand, finger)), command)


@wp.func
def _misfit(
    hand: Hand, doubt: Doubt, f: FingerPose, link: int, near: Nearest, thick: real, free: vec4,
    turned: vec4, by_other: real
):
    """That of a link of a finger as read, `turned` from where it would be `free`, which presses on
    what has a skin `thick` [m] and a place of variance `by_other` [m2] along the way between them.
    """
    away = finger_jacobian(f, link, near.one, near.way)
    k = hand.stiffness
    give = pushed_turn(away, vec4(k, k, k, k), free, hand.low, hand.high, hand.stop)
    variance = doubt.place + doubt.zero * wp.dot(away, away) + by_other
    return press_misfit(near.apart - wp.dot(away, turned), hand.link_radius + thick, variance,
                        away, give, turned, doubt)


@wp.kernel(enable_backward=False, module="warpgrasp.closing.closing_kernels")
def hand_press_kernel(
    first: int,
    # Robot:
    hand: Hand,
    mount: real,
    doubt: Doubt,
    # Closing in:
    hand_pose: wp.array2d[transform],
    status: wp.array4d[int],
    q: wp.array4d[vec4],
    step: wp.array4d[int],
    commands: wp.array4d[real],
    # Misfit out:
    misfit: wp.array4d[real],
):
    """The least misfit of a finger that stopped pressing on any link of the others, or on the palm:
    others where they had stopped by then, or else would rest free."""
    w, p, g, finger = wp.tid()
    w += first
    least = real(NO_PRESS)
    if status[w, p, g, finger] != _CONTACT:
        misfit[w, p, g, finger] = least
        return
    s = step[w, p, g, finger]
    free = _free(hand, hand_pose[w, p], commands, g, finger, s)
    turned = q[w, p, g, finger] - free
    f = finger_pose(hand, finger_base(hand, finger), q[w, p, g, finger])
    for other in range(4):
        if other != finger:
            there = q[w, p, g, other]
            angle = doubt.zero + doubt.reading
            if step[w, p, g, other] > s:
                there = _free(hand, hand_pose[w, p], commands, g, other, s)
                angle = doubt.zero
            o = finger_pose(hand, finger_base(hand, other), there)
            for a in range(3):
                for b in range(3):
                    if links_within(hand, f, a, hand, o, b, PRESS_REACH):
                        near = segment_pair(link_start(f, a), link_end(f, a), link_start(o, b),
                                            link_end(o, b))
                        by = finger_jacobian(o, b, near.two, near.way)
                        least = wp.min(least, _misfit(
                            hand, doubt, f, a, near, hand.link_radius, free, turned,
                            doubt.place + angle * wp.dot(by, by)))
    for a in range(1, 3):
        if not above_palm(hand, f, a, PRESS_REACH):
            for bar in range(4):
                near = segment_pair(link_start(f, a), link_end(f, a),
                                    palm_capsule(hand, mount, bar, 0),
                                    palm_capsule(hand, mount, bar, 1))
                least = wp.min(least, _misfit(hand, doubt, f, a, near, hand.palm_thickness * HALF,
                                              free, turned, ZERO))
    misfit[w, p, g, finger] = least
