# type: ignore  # Warp functions, which type checkers cannot follow
"""Where the hand is along a guarded line, as believed and truly, and whether its way is free."""

from typing import Any

import warp as wp

from warpgrasp.chain.chain_clearance_kernel import chain_finger_clearance, palm_bars_clearance
from warpgrasp.chain.chain_kernel import Chain, ChainBar, vec6
from warpgrasp.core.dtypes import ZERO, real, transform, vec3, vec7
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.arm_kernel import Arm, arm_flange
from warpgrasp.mechanism.hand_clearance import finger_clearance, palm_clearance
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_base
from warpgrasp.touch.line_finger import command_at

_SWING = wp.constant(real(0.25))  # [m]: from the hand's origin to its farthest place, about
_SHORTEST = wp.constant(real(5e-4))  # [m]
_LEAVING = wp.constant(real(1e-2))  # [m]: so far a touch may be left that gets no deeper


@wp.func
def along_line(line: transform, direction: vec3, s: real):
    """The believed pose of the hand, `s` [m] along a line."""
    return transform(wp.transform_get_translation(line) + direction * s,
                     wp.transform_get_rotation(line))


@wp.func
def hand_slip(arm: Arm, q: vec7, believed: transform, hand_on_flange: transform, mount: transform):
    """The true pose of the hand in the frame of the believed one; `arm` is the true arm."""
    true = wp.transform_multiply(wp.transform_multiply(arm_flange(arm, q), hand_on_flange), mount)
    return wp.transform_multiply(wp.transform_inverse(believed), true)


@wp.func
def hand_at(
    line: transform, direction: vec3, s: real, slip: transform, last: transform, share: real,
    wobble: vec3
):
    """The true pose of the hand, a `share` of the way from where it slips by `slip` to `last`.

    Calibration errors change so little along a line that straight between its ends is exact to a
    few micrometres on 20 mm, to 0.02 mm on 60 mm.
    """
    a = wp.transform_get_rotation(slip)
    b = wp.transform_get_rotation(last)
    if wp.dot(a, b) < ZERO:
        b = -b
    x = wp.transform_get_translation(slip)
    off = transform(x + (wp.transform_get_translation(last) - x) * share,
                    wp.normalize(a + (b - a) * share))
    here = wp.transform_multiply(along_line(line, direction, s), off)
    return transform(wp.transform_get_translation(here) + wobble, wp.transform_get_rotation(here))


@wp.func
def others_free(
    scene: Scene, body: int, hands: wp.array2d[Hand], own: int, pose: transform, mount: real,
    commands: wp.array3d[real], finger: int
):
    """Clearance of palm and the other fingers [m], which stay at their first command; of all with
    `finger` -1."""
    worst = real(1e9)
    for other in range(4):
        if other != finger:
            hand = hands[own, other]
            worst = finger_clearance(scene, body, hand,
                                     wp.transform_multiply(pose, finger_base(hand, other)),
                                     command_at(commands, other, 0) - hand.offset, worst)
    return palm_clearance(scene, body, hands[own, 0], pose, mount, worst)


@wp.func
def others_free(  # noqa: F811 (an overload)
    scene: Scene, body: int, hands: wp.array2d[Chain], own: int, pose: transform,
    palm: wp.array[ChainBar], commands: wp.array2d[vec6], finger: int
):
    """The same of a hand of chains, its palm and wrist a number of capsules."""
    worst = real(1e9)
    for other in range(hands.shape[1]):
        if other != finger:
            hand = hands[own, other]
            worst = chain_finger_clearance(scene, body, hand, pose,
                                           command_at(commands, other, 0) - hand.offset, worst)
    return palm_bars_clearance(scene, body, pose, palm, worst)


@wp.func
def way_is_free(
    scene: Scene, body: int, hands: Any, own: int, to_body: transform,
    here: transform, there: transform, palm: Any, commands: Any
):
    """Whether the hand, its fingers at their first commands, can go straight from pose to pose.

    The start may touch a little, since a hand that leaves a touch does. `here` and `there` are true
    poses in the base frame; `palm` is what `others_free` takes.
    """
    a = wp.transform_get_rotation(here)
    b = wp.transform_get_rotation(there)
    if wp.dot(a, b) < ZERO:
        b = -b
    x = wp.transform_get_translation(here)
    y = wp.transform_get_translation(there)
    # The chord of two quaternions is half the turn's angle.
    way = wp.length(y - x) + real(2.0) * wp.length(b - a) * _SWING
    gone = real(0.0)
    last = real(-1.0)
    while gone < way:
        share = gone / way
        pose = wp.transform_multiply(to_body, transform(
            x + (y - x) * share, wp.normalize(a + (b - a) * share)))
        clear = others_free(scene, body, hands, own, pose, palm, commands, -1)
        if clear < -_SHORTEST and (gone > _LEAVING or clear < last - _SHORTEST):
            return False
        last = clear
        gone += wp.max(clear, _SHORTEST)
    return True
