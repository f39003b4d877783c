# type: ignore  # Warp functions, which type checkers cannot follow
"""How far a free finger moves before a link touches the body or the table.

A free finger stands where it is commanded but for its weight, so that the motion of its links is
tabulated (`path_table`). Each link is advanced by itself, the outermost first: steps are skipped
while the distance to every obstacle exceeds the distance that the link can have moved (conservative
advancement). What weight and errors of calibration add to tabled places is bounded; where a
distance is evaluated it is computed.

In front of a convex body, the plane through the body's point nearest to a link has the whole body
behind it. While both ends of the link stay in front of that plane no distance is evaluated.
"""

import warp as wp

from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    ZERO,
    greater,
    lesser,
    mat33,
    mat34,
    real,
    struct,
    transform,
    vec3,
    vec4,
)
from warpgrasp.finger.energy import pick, put
from warpgrasp.finger.path_record import LinkStep, PathStep, true_command
from warpgrasp.geometry.scene import Scene, body_distance_grad
from warpgrasp.geometry.segment_distance import LINK_SAMPLES, link_valley, nearest_on_link
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    Hand,
    free_pose,
    link_direction,
    link_start,
)

_ROUNDING = wp.constant(real(1e-12))  # [m]; a link pressed by no more bears 20 nN
_UNSURE = wp.constant(real(0.02))  # share of what weight does that is missed


@struct
class FreeFinger:
    """The links of a free finger at a step.

    `room` is the distance that each link can certainly still move [m]; `along` and `bend` tell
    where the link was nearest at the last evaluation (see `nearest_on_link`); `planes` (normal,
    offset), in the frame of the finger's base, have the whole of a convex body behind them.
    """

    step: int
    off_start: mat33
    off_end: mat33
    loose: vec3
    seen: vec3
    """Weight and errors of calibration shift the ends of links by `off` from their tabled places
    [m], known to `loose` where the table's `swing` times `Hand.askew` was `seen`."""
    room: vec3
    along: vec3
    bend: vec3
    planes: mat34


@struct
class LinkAxis:
    """Where a link's axis starts, and its direction."""

    start: vec3
    way: vec3


@wp.func
def start_free(scene: Scene, body: int, convex: bool, hand: Hand, base: transform, near: vec3):
    """A finger before its first step.

    In front of a convex body all links begin with the plane through the body's point nearest to the
    place `near`, in the frame of the finger's base.
    """
    free = FreeFinger()
    free.step = -1
    free.loose = hand.sag
    free.along = hand.link_length * HALF
    free.bend = vec3(ONE, ONE, ONE)
    if convex:
        g = body_distance_grad(scene, body, wp.transform_point(base, near))
        n = wp.transform_vector(wp.transform_inverse(base), vec3(g[0], g[1], g[2]))
        for link in range(3):
            free.planes[link] = vec4(n[0], n[1], n[2], g[3] - hand.link_radius - wp.dot(n, near))
    return free


@wp.func
def _come(hand: Hand, at: LinkStep):
    """How far any place of the true link can have come [m]."""
    return at.come + hand.askew * at.swing


@wp.func
def _clearance(free: FreeFinger, link: int, table: vec4, at: LinkStep, askew: real):
    """Least distance of a link's skin from two planes [m]."""
    plane = free.planes[link]
    n = vec3(plane[0], plane[1], plane[2])
    up = vec3(table[0], table[1], table[2])
    start = at.start + free.off_start[link]
    end = at.end + free.off_end[link]
    loose = pick(free.loose, link) + wp.abs(askew * at.swing - pick(free.seen, link))
    return lesser(plane[3] + lesser(wp.dot(n, start), wp.dot(n, end)),
                  table[3] + lesser(wp.dot(up, start), wp.dot(up, end))) - loose


@wp.func
def _free_axis(
    hand: Hand, base: transform, path: wp.array3d[PathStep], grasp: int, finger: int, step: int,
    link: int, at: LinkStep, sag: real, length: real
):
    """The axis of a link of a free finger at a step, in the body's frame."""
    axis = LinkAxis()
    if sag > ZERO:
        f = free_pose(hand, base, true_command(hand, path, grasp, finger, step))
        axis.start = link_start(f, link)
        axis.way = link_direction(f, link)
        return axis
    axis.start = wp.transform_point(base, at.start)
    axis.way = (wp.transform_point(base, at.end) - axis.start) / length
    return axis


@wp.func(inline=False)
def advance_free(
    scene: Scene, body: int, convex: bool, hand: Hand, base: transform, path: wp.array3d[PathStep],
    links: wp.array4d[LinkStep], grasp: int, finger: int, scale: real, was: FreeFinger, end: int
):
    """The finger advanced to the first step at which a link touches, or to `end` if none does.

    `was` is its last state, `base` is in the body's frame. `scale` shortens the skipped distances.
    """
    free = was
    rotation = wp.transform_get_rotation(base)
    to_base = wp.transform_inverse(base)
    up = wp.quat_rotate_inv(rotation, vec3(ZERO, ZERO, ONE))
    table = vec4(up[0], up[1], up[2], base[2] - hand.link_radius)
    free.step = end
    come = vec3(ZERO, ZERO, ZERO)
    for inward in range(3):
        link = 2 - inward
        length = pick(hand.link_length, link)
        sag = pick(hand.sag, link)
        room = pick(was.room, link)
        seen = _come(hand, links[grasp, finger, link, wp.max(was.step, 0)])
        s = int(was.step + 1)
        while s < free.step:
            at = links[grasp, finger, link, s]
            room -= _come(hand, at) - seen
            seen = _come(hand, at)
            clear = -ONE
            if convex:
                clear = _clearance(free, link, table, at, hand.askew)
                room = greater(room, scale * clear)
            if room <= ZERO and clear < -_ROUNDING:
                axis = _free_axis(hand, base, path, grasp, finger, s, link, at, sag, length)
                a = axis.start
                u = axis.way
                if sag > ZERO:
                    free.off_start[link] = wp.transform_point(to_base, a) - at.start
                    free.off_end[link] = wp.transform_point(to_base, a + u * length) - at.end
                    free.loose = put(free.loose, link, _UNSURE * sag)
                    free.seen = put(free.seen, link, hand.askew * at.swing)
                if convex:
                    near = link_valley(scene, body, a, u, ZERO, length, pick(free.along, link),
                                       pick(free.bend, link), hand.link_radius, True)
                    n = wp.quat_rotate_inv(rotation, near.normal)
                    place = wp.transform_point(to_base, a + u * near.along)
                    free.planes[link] = vec4(
                        n[0], n[1], n[2], near.distance - hand.link_radius - wp.dot(n, place))
                else:
                    near = nearest_on_link(scene, body, a, u, length, -ONE, ONE, LINK_SAMPLES,
                                        length * HALF + hand.link_radius)
                free.along = put(free.along, link, near.along)
                free.bend = put(free.bend, link, near.bend)
                clear = lesser(near.least - hand.link_radius,
                               lesser(a[2], a[2] + u[2] * length) - hand.link_radius)
                clear -= _UNSURE * sag
                room = scale * clear
                if clear < -_ROUNDING:
                    free.step = int(s)
            s += 1 + int(lesser(greater(room, ZERO) * at.steps, real(end)))
        come = put(come, link, seen)
        free.room = put(free.room, link, room)
    if free.step < end:
        for link in range(3):
            at = links[grasp, finger, link, free.step]
            # A link may have been followed beyond the step: back again takes as much.
            room = pick(free.room, link) - wp.abs(_come(hand, at) - pick(come, link))
            if convex:
                room = greater(room, _clearance(free, link, table, at, hand.askew))
            elif room <= ZERO and _come(hand, at) != pick(come, link):
                free.along = put(free.along, link, -ONE)
            free.room = put(free.room, link, room)
    return free
