# type: ignore  # Warp functions, which type checkers cannot follow
"""How far a finger that touches nothing goes before a capsule of it touches the body or the table.

`come` bounds how far any place of a capsule has moved since the first step of the path: a table for
all worlds, weight and errors of calibration included (`chain_path`). A capsule that was seen at a
distance cannot touch while it has not come as far (conservative advancement).
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    ChainCapsule,
    ChainJoint,
    chain_capsule,
    chain_free_joints,
    chain_pose,
    chain_weight,
    past_stops,
    placed,
    turned_by_weight,
    vec6,
    vec12,
)
from warpgrasp.chain.free_lanes import capsules_in_lanes
from warpgrasp.core.dtypes import HALF, ONE, ZERO, greater, lesser, real, struct, transform, vec3
from warpgrasp.core.lanes import LANES
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import LINK_SAMPLES, nearest_on_link
from warpgrasp.hand_rest.chain_meetings import off_command

_LANES = wp.constant(LANES)
_APART = wp.constant(8)  # steps of a first look
_SOON = wp.constant(8)  # steps in which what weight does changes little
_ROUGH = wp.constant(real(1e-4))  # [m]: what weight does is found to second order
_TWICE = wp.constant(real(2.0))  # what a finger is off by, less than half of which is left
_ENOUGH = wp.constant(real(5.0))  # times what it may be off by: clear enough
_ROUNDING = wp.constant(real(1e-12))  # [m]; a capsule pressed by no more bears 20 nN


@struct
class FreeChain:
    """A free finger at a step. Each capsule is free while `come` stays below `until` [m]; `sag` is
    about what weight turns the drives by there [rad]."""

    step: int
    until: vec12
    sag: vec6


@wp.func
def _first_at_least(
    come: wp.array4d[real], g: int, finger: int, capsule: int, value: real, begin: int, end: int
):
    """The first step from `begin` on at which `come` reaches a value; `end` if none before."""
    low = int(begin)
    high = int(end)
    while low < high:
        middle = (low + high) // 2
        if come[g, finger, capsule, middle] >= value:
            high = middle
        else:
            low = middle + 1
    return low


@wp.func
def _clearance(scene: Scene, body: int, a: vec3, b: vec3, radius: real):
    """How far the skin around an axis is from body and table [m], at least where it is far."""
    u = b - a
    length = wp.length(u)
    if length > ZERO:
        u = u / length
    near = nearest_on_link(scene, body, a, u, length, -ONE, ONE, LINK_SAMPLES,
                           length * HALF + radius)
    return lesser(near.least, lesser(a[2], b[2])) - radius


@wp.func(inline=False)
def advance_in_lanes(
    scene: Scene, body: int, hand: Chain, base: transform, path: wp.array3d[vec6],
    come: wp.array4d[real], g: int, finger: int, scale: real, was: FreeChain, end: int
):
    """As `advance_chain`, at eight steps side by side: some steps apart while a capsule that is
    looked at is known to be free since the look before, else one after the other."""
    free = was
    free.step = end
    s = int(was.step)
    apart = int(_APART)
    while s < free.step:
        begin = s + 1
        s = end
        for c in range(hand.capsule_count):
            s = _first_at_least(come, g, finger, c, free.until[c], begin, s)
        if s < end:
            at = capsules_in_lanes(
                hand, wp.array(ptr=hand.joints, shape=(1,), dtype=ChainJoint),
                wp.array(ptr=hand.capsules, shape=(1,), dtype=ChainCapsule), base, path, g, finger,
                s, apart, end - 1)
            first = int(s)
            unknown = int(0)
            for n in range(_LANES):
                t = first + n * apart
                if unknown == 0 and t < free.step:
                    for c in range(hand.capsule_count):
                        here = come[g, finger, c, t]
                        if here >= free.until[c]:
                            row = 6 * c
                            clear = _clearance(
                                scene, body, vec3(at[row, n], at[row + 1, n], at[row + 2, n]),
                                vec3(at[row + 3, n], at[row + 4, n], at[row + 5, n]),
                                chain_capsule(hand, c).radius)
                            free_way = scale * greater(clear, ZERO)
                            if n > 0 and apart > 1 and here - free_way > free.until[c]:
                                unknown = int(1)
                            else:
                                free.until[c] = here + free_way
                                if clear < -_ROUNDING:
                                    free.step = int(t)
                    if unknown == 0:
                        s = int(t)
            apart = wp.where(unknown == 1, 1, _APART)
    return free


@wp.func(inline=False)
def advance_chain(
    scene: Scene, body: int, hand: Chain, base: transform, path: wp.array3d[vec6],
    come: wp.array4d[real], g: int, finger: int, scale: real, was: FreeChain, end: int
):
    """The finger at the first step after `was` at which a capsule touches, or at `end`.

    `base` is the hand's pose in the body's frame; `scale` shortens the skipped distances.
    """
    free = was
    free.step = end
    s = int(was.step)
    while s < free.step:
        # All capsules that may touch at the next step at which any may are looked at together.
        begin = s + 1
        s = end
        for c in range(hand.capsule_count):
            s = _first_at_least(come, g, finger, c, free.until[c], begin, s)
        if s < end:
            command = path[g, finger, s] - hand.offset
            # About where it is first; exactly where that does not tell whether it is free.
            if begin == 0 or s - begin > _SOON:
                free.sag = turned_by_weight(hand, base, command + free.sag)
            q = past_stops(hand, command + free.sag)
            exact = int(0)
            while exact < 2:
                pose = chain_pose(hand, base, q)
                off = real(0.0)
                if hand.weighs == 1:
                    free.sag = wp.cw_div(chain_weight(hand, pose), hand.stiffness)
                    if exact == 0:
                        off = _ROUGH + _TWICE * off_command(
                            hand, past_stops(hand, command + free.sag) - q)
                exact += 2
                for c in range(hand.capsule_count):
                    if exact >= 2 and come[g, finger, c, s] >= free.until[c]:
                        capsule = chain_capsule(hand, c)
                        at = pose.at[capsule.joint]
                        turn = pose.turn[capsule.joint]
                        clear = _clearance(scene, body, placed(at, turn, capsule.start),
                                           placed(at, turn, capsule.end), capsule.radius)
                        if off > ZERO and clear < _ENOUGH * off:
                            exact = int(1)
                            q = chain_free_joints(hand, base, command)
                        else:
                            free.until[c] = come[g, finger, c, s] + scale * greater(
                                clear - off, ZERO)
                            if clear < -_ROUNDING:
                                free.step = int(s)
    return free
