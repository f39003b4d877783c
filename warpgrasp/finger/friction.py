# type: ignore  # Warp functions, which type checkers cannot follow
"""Coulomb friction between a finger's skin and what it touches, carried from step to step.

Where a link touches, its skin is a spring along the surface, of the stiffness k_t. It holds until
the force in it reaches the friction coefficient times the normal force N; then it slides, and is
stretched no farther. A step of the command is one implicit step of that law. With N and the place
of contact fixed it is the least of the finger's energy and, for each contact, of

    1/2 k_t |e|^2 where k_t |e| <= mu N,  mu N |e| - (mu N)^2 / 2 k_t beyond,

e the stretch: what was left of the last step, and how far the point of the link that is now in
touch has moved along the surface since. N and the place are then those of the rest found, and so on
until they no longer change (Alart and Curnier 1991; Li et al. 2020, Incremental potential contact,
for energies with lagged N). A rolling link is followed, since each step takes the points that
touch. k_t / k = 2 (1 - nu) / (2 - nu) = 2/3 for a skin that does not change its volume, nu = 1/2
(Mindlin 1949, Compliance of elastic bodies in contact).
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, struct, transform, vec2, vec3, vec4
from warpgrasp.finger.energy import Equilibrium
from warpgrasp.geometry.scene import Scene, body_distance_grad
from warpgrasp.geometry.segment_distance import lower_end
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    Hand,
    finger_jacobian,
    finger_pose,
    link_direction,
    link_start,
)

NO_FRICTION = wp.constant(0)
SHEAR = 2.0 / 3.0
"""Stiffness of the skin along the surface, of that across it."""
_SHEAR = wp.constant(real(SHEAR))
_LEAST = wp.constant(real(0.25))  # of the secant: where friction wedges a link, N has no limit
_pairs = wp.types.matrix(shape=(6, 2), dtype=real)
places = wp.types.matrix(shape=(6, 3), dtype=real)
_turns = wp.types.matrix(shape=(6, 4), dtype=real)
_six = wp.types.vector(length=6, dtype=real)


@struct
class Friction:
    """The contacts of a finger in a step of its command, each in a row: three links against the
    body, then the same against the table.

    `q` are the joints at the step before, `drift` how they would turn in this step if nothing new
    came in touch; `left` the stretch of the skin then [m], zero and not in
    `touching` (a bit each) where it did not touch. `limit` is the largest force along the surface
    [N], 0 where nothing touches; `one` and `two` are directions along the surface, `by_one` and
    `by_two` what a turn of each joint moves the link along them [m/rad], `begun` the stretch at
    joints `q` along them [m]. `off` is the largest error of a limit [N].
    """

    q: vec4
    drift: vec4
    left: places
    touching: int
    limit: _six
    one: places
    two: places
    by_one: _turns
    by_two: _turns
    begun: _pairs
    off: real


@wp.func
def start_friction(q: vec4):
    """A finger at joints `q` that touches nothing."""
    friction = Friction()
    friction.q = q
    return friction


@wp.func
def _stretch(friction: Any, q: Any, k: int):
    """How far the skin at contact `k` would be stretched if it held, along `one` and `two` [m]."""
    turned = q - friction.q
    return vec2(friction.begun[k, 0] + wp.dot(friction.by_one[k], turned),
                friction.begun[k, 1] + wp.dot(friction.by_two[k], turned))


@wp.func
def with_friction(rest: Equilibrium, skin: real, friction: int):
    """`rest` as it is: without friction."""
    return rest


@wp.func
def with_friction(rest: Equilibrium, skin: real, friction: Friction):  # noqa: F811
    """`rest` of `finger_energy` with energy, slope and stiffness of friction added."""
    return rubbed(rest, skin, friction)


@wp.func(inline=False)
def rubbed(rest: Any, skin: real, friction: Any):
    """`with_friction` for any finger: an Equilibrium and its Friction, or those of a chain."""
    held = rest
    shear = skin * _SHEAR
    for k in range(len(friction.limit)):
        limit = friction.limit[k]
        if limit > ZERO:
            e = _stretch(friction, rest.q, k)
            size = wp.length(e)
            one = friction.by_one[k]
            two = friction.by_two[k]
            along = one * e[0] + two * e[1]
            if shear * size <= limit:
                held.pressed += HALF * shear * size * size
                held.energy += HALF * shear * size * size
                held.gradient += along * shear
                gives = held.compliance * one
                held.compliance -= wp.outer(gives, gives / (ONE / shear + wp.dot(one, gives)))
                gives = held.compliance * two
                held.compliance -= wp.outer(gives, gives / (ONE / shear + wp.dot(two, gives)))
            else:
                slid = limit * size - HALF * limit * limit / shear
                held.pressed += slid
                held.energy += slid
                held.gradient += along * (limit / size)
                # Only a turn of the force is resisted.
                across = (two * e[0] - one * e[1]) / size
                gives = held.compliance * across
                held.compliance -= wp.outer(
                    gives, gives / (size / limit + wp.dot(across, gives)))
    return held


@wp.func
def pose_of(hand: Hand, base: transform, q: vec4):
    """Where a finger's links are, of a hand of any kind."""
    return finger_pose(hand, base, q)


@wp.func
def axis_start(hand: Hand, f: FingerPose, link: int):
    """Where the axis of a link's skin begins, on the side of the palm."""
    return link_start(f, link)


@wp.func
def axis_way(hand: Hand, f: FingerPose, link: int):
    """Unit vector along the axis of a link's skin."""
    return link_direction(f, link)


@wp.func
def axis_length(hand: Hand, link: int):
    """Length of the axis of a link's skin [m]."""
    return hand.link_length[link]


@wp.func
def place_jacobian(hand: Hand, f: FingerPose, link: int, x: vec3, d: vec3):
    """Motion along `d` of the point `x` of a link per radian of each joint."""
    return finger_jacobian(f, link, x, d)


@wp.func(inline=False)
def note_friction(
    scene: Scene, body: int, hand: Any, base: transform, rest: Any, was: Any
):
    """The contacts at `rest`, found with the limits and places of `was`, of the same step.

    A contact that is new holds from where the link comes in touch on the way of `drift`.
    """
    now = was
    now.off = ZERO
    f = pose_of(hand, base, rest.q)
    links = len(rest.depth)
    for k in range(len(was.limit)):
        link = k % links
        u = axis_way(hand, f, link)
        depth = rest.depth[link]
        if k >= links:
            depth = rest.table[link]
        force = wp.where(depth > ZERO, hand.skin * depth * hand.friction, ZERO)
        if force == ZERO:
            now.off = wp.max(now.off, was.limit[k])
            now.limit[k] = ZERO
        else:
            x = axis_start(hand, f, link) + u * rest.along[link]
            n = vec3(ZERO, ZERO, ONE)
            if k >= links:
                x = axis_start(hand, f, link) + u * lower_end(u, axis_length(hand, link))
                x -= n * x[2]
            else:
                g = body_distance_grad(scene, body, x)
                n = wp.normalize(vec3(g[0], g[1], g[2]))
                x -= n * g[3]
            one = wp.where(wp.abs(n[0]) < HALF, vec3(ONE, ZERO, ZERO), vec3(ZERO, ONE, ZERO))
            one = wp.normalize(one - n * wp.dot(n, one))
            two = wp.cross(n, one)
            away = place_jacobian(hand, f, link, x, n)
            # How much of a rise of the limit comes back as normal force, where it slides.
            echo = real(0.0)
            if was.limit[k] > ZERO:
                e = _stretch(was, rest.q, k)
                size = wp.length(e)
                if hand.skin * _SHEAR * size > was.limit[k]:
                    along = (was.by_one[k] * e[0] + was.by_two[k] * e[1]) / size
                    echo = hand.friction * hand.skin * wp.dot(away, rest.compliance * along)
            now.off = wp.max(now.off, wp.abs(force - was.limit[k]))
            now.limit[k] = wp.max(
                was.limit[k] + (force - was.limit[k]) / wp.max(ONE - echo, _LEAST), ZERO)
            now.one[k] = one
            now.two[k] = two
            now.by_one[k] = place_jacobian(hand, f, link, x, one)
            now.by_two[k] = place_jacobian(hand, f, link, x, two)
            if (was.touching & (1 << k)) != 0:
                now.begun[k, 0] = wp.dot(was.left[k], one)
                now.begun[k, 1] = wp.dot(was.left[k], two)
            else:
                before = depth + wp.dot(away, rest.q - was.q)
                closes = -wp.dot(away, was.drift)
                share = real(1.0)
                if closes > ZERO:
                    share = wp.clamp(-before / closes, ZERO, ONE)
                now.begun[k, 0] = -share * wp.dot(now.by_one[k], was.drift)
                now.begun[k, 1] = -share * wp.dot(now.by_two[k], was.drift)
    return now


@wp.func
def end_friction(hand: Any, done: Any, q: Any):
    """The contacts of a step that ended at joints `q`, as the next step finds them."""
    now = done
    now.q = q
    now.touching = 0
    for k in range(len(done.limit)):
        now.left[k] = vec3(ZERO, ZERO, ZERO)
        if done.limit[k] > ZERO:
            e = _stretch(done, q, k)
            most = done.limit[k] / (hand.skin * _SHEAR)
            size = wp.length(e)
            if size > most:
                e = e * (most / size)
            now.left[k] = done.one[k] * e[0] + done.two[k] * e[1]
            now.begun[k, 0] = e[0]
            now.begun[k, 1] = e[1]
            now.touching = now.touching | (1 << k)
    return now
