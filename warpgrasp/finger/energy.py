# type: ignore  # Warp functions, which type checkers cannot follow
"""The energy of a finger: joint servos and skin against the rigid body and the table.

    E(q) = 1/2 K |q_cmd - q|^2 + sum over links and obstacles 1/2 k max(0, r - phi(x_link(q)))^2
           + weight of the links + 1/2 k_stop (joints past their stops)^2

phi is the signed distance of one obstacle, the body or the table, and x_link the point of the
link's axis nearest to it. Each link has one term for each obstacle. With a single distance for
both, the energy would have a kink where they are equally near. Links that are certainly free are
skipped, and contact points are followed from where they were.
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, greater, mat33, mat44, real, struct, vec3, vec4
from warpgrasp.core.turns import frame_axes, sine_cosine
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import lower_end, nearest_on_link
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, beyond_stops


@struct
class Equilibrium:
    """A finger at equilibrium: joints, energy [J], its gradient, compliance, and its links.

    `compliance` is the inverse of the Gauss-Newton Hessian of the energy.

    `along` is the place on each link's axis [m from its joint] nearest to the body, negative where
    unknown; `bend` helps to follow it (see `nearest_on_link`). `depth` is how far the body presses
    into the skin [m]; where it is not positive the link is free, by at least that distance. `table`
    is the same for the table, at the lower end of the link.

    `near_depth` is the depth of the nearest place that bears no load (not positive), `near` its
    derivative by the joints.
    """

    q: vec4
    energy: real
    gradient: vec4
    pressed: real
    """The part of the energy that is in skin and stops [J]."""
    drive: vec4
    """The part of the gradient that servos and weight make [N m]."""
    compliance: mat44
    along: vec3
    bend: vec3
    depth: vec3
    table: vec3
    near: vec4
    near_depth: real


@wp.func
def free_equilibrium(q: vec4):
    """A finger at joints `q` without contact, its links unknown."""
    rest = Equilibrium()
    rest.q = q
    rest.along = vec3(-ONE, -ONE, -ONE)
    rest.near_depth = -ONE
    return rest


@wp.func
def pick(v: vec3, link: int):
    """`v[link]`; an index not known when compiled would keep `v` out of the registers."""
    return wp.where(link == 0, v[0], wp.where(link == 1, v[1], v[2]))


@wp.func
def put(v: vec3, link: int, value: real):
    """`v` with `value` at `link`."""
    return vec3(wp.where(link == 0, value, v[0]), wp.where(link == 1, value, v[1]),
                wp.where(link == 2, value, v[2]))


@wp.func
def _lost(
    n: vec3, at: vec3, origin: vec3, x: vec3, side: vec3, p1: vec3, p2: vec3, p3: vec3, link: int
):
    """Depth lost by a turn of each joint, at a place of a link pressed in against `n` [m/rad]."""
    swing = wp.cross(n, side)
    return vec4(wp.dot(wp.cross(at - origin, x), n), wp.dot(swing, at - p1),
                wp.where(link >= 1, wp.dot(swing, at - p2), ZERO),
                wp.where(link >= 2, wp.dot(swing, at - p3), ZERO))


@wp.func(inline=False)
def finger_energy(
    scene: Scene, body: int, hand: Hand, base: wp.transformd, command: vec4, q: vec4,
    last: Equilibrium, samples: int
):
    """Energy, gradient, compliance and depths of the links at joints `q`.

    `base` is in the body's frame. `last` is the equilibrium at joints near by: links that were free
    by more than they can have moved are free; on the others the nearest places are followed, with
    `samples` compared.
    """
    rest = Equilibrium()
    rest.q = q
    lag = command - q
    k = hand.stiffness
    past = beyond_stops(hand, q)
    rest.pressed = HALF * hand.stop * wp.dot(past, past)
    e = ONE / k
    c = ONE / (k + hand.stop)
    rest.compliance = mat44(wp.where(past[0] == ZERO, e, c), ZERO, ZERO, ZERO,
                            ZERO, wp.where(past[1] == ZERO, e, c), ZERO, ZERO,
                            ZERO, ZERO, wp.where(past[2] == ZERO, e, c), ZERO,
                            ZERO, ZERO, ZERO, wp.where(past[3] == ZERO, e, c))
    rest.energy = HALF * k * wp.dot(lag, lag)
    rest.drive = -lag * k
    rest.gradient = past * hand.stop
    # The chain of `finger_pose`, link by link.
    axes = frame_axes(wp.transform_get_rotation(base))
    origin = wp.transform_get_translation(base)
    x = axes[0]
    y = axes[1]
    z = axes[2]
    turn = sine_cosine(q[0])
    turn1 = sine_cosine(q[1])
    turn2 = sine_cosine(q[1] + q[2])
    turn3 = sine_cosine(q[1] + q[2] + q[3])
    side = y * turn[1] - z * turn[0]
    z = z * turn[1] + y * turn[0]
    u = x * turn1[0] + z * turn1[1]
    u2 = x * turn2[0] + z * turn2[1]
    u3 = x * turn3[0] + z * turn3[1]
    p1 = origin + z * hand.abduction_offset
    p2 = p1 + u * hand.link_length[0]
    p3 = p2 + u2 * hand.link_length[1]
    # Rows are looked up: a vector assigned in a branch would be copied at its end.
    starts = mat33(p1[0], p1[1], p1[2], p2[0], p2[1], p2[2], p3[0], p3[1], p3[2])
    ways = mat33(u[0], u[1], u[2], u2[0], u2[1], u2[2], u3[0], u3[1], u3[2])
    flexed = vec3(wp.abs(q[1] - last.q[1]), wp.abs(q[2] - last.q[2]), wp.abs(q[3] - last.q[3]))
    # How far any point of a link can have moved: each joint's turn times what lies beyond it.
    rest.near_depth = -ONE
    turned = wp.abs(q[0] - last.q[0])
    travel = turned * hand.abduction_offset
    for link in range(3):
        a = starts[link]
        way = ways[link]
        length = pick(hand.link_length, link)
        turned += pick(flexed, link)
        travel += turned * length
        before = pick(last.depth, link)
        depth = before + travel
        along = pick(last.along, link)
        bend = pick(last.bend, link)
        if depth >= ZERO or before >= ZERO:
            near = nearest_on_link(scene, body, a, way, length, along, bend, samples,
                                hand.link_radius)
            depth = hand.link_radius - near.distance
            along = near.along
            bend = near.bend
            if depth > rest.near_depth:
                j = _lost(near.normal, a + way * along, origin, x, side, p1, p2, p3, link)
                if depth > ZERO:
                    rest.pressed += HALF * hand.skin * depth * depth
                    rest.gradient -= j * (hand.skin * depth)
                    # Sherman and Morrison: the Hessian gains skin times j j^T.
                    yields = rest.compliance * j
                    rest.compliance -= wp.outer(
                        yields, yields / (ONE / hand.skin + wp.dot(j, yields)))
                else:
                    rest.near = j
                    rest.near_depth = depth
        low = a + way * lower_end(way, length)
        pressed = hand.link_radius - low[2]
        if pressed > ZERO:
            sinks = _lost(vec3(ZERO, ZERO, ONE), low, origin, x, side, p1, p2, p3, link)
            rest.pressed += HALF * hand.skin * pressed * pressed
            rest.gradient -= sinks * (hand.skin * pressed)
            gives = rest.compliance * sinks
            rest.compliance -= wp.outer(gives, gives / (ONE / hand.skin + wp.dot(sinks, gives)))
        rest.table = put(rest.table, link, pressed)
        rest.along = put(rest.along, link, along)
        rest.bend = put(rest.bend, link, bend)
        rest.depth = put(rest.depth, link, depth)
    if hand.weight[0] > ZERO:
        # Weights times arms, from the tip inwards: what turns a joint is what lies beyond it.
        up = vec3(ZERO, ZERO, ONE)
        turns = wp.cross(up, side)
        carried = hand.weight[2]
        moment = (u3 * (HALF * hand.link_length[2])) * carried
        rest.drive[3] += wp.dot(moment, turns)
        moment += (p3 - p2) * carried + (u2 * (HALF * hand.link_length[1])) * hand.weight[1]
        carried += hand.weight[1]
        rest.drive[2] += wp.dot(moment, turns)
        moment += (p2 - p1) * carried + (u * (HALF * hand.link_length[0])) * hand.weight[0]
        carried += hand.weight[0]
        rest.drive[1] += wp.dot(moment, turns)
        moment += (p1 - origin) * carried
        rest.drive[0] += wp.dot(wp.cross(moment, x), up)
        rest.energy += moment[2] + origin[2] * carried
    rest.energy += rest.pressed
    rest.gradient += rest.drive
    return rest


@wp.func
def largest_magnitude(v: vec4):
    """The largest absolute value of four numbers."""
    return greater(greater(wp.abs(v[0]), wp.abs(v[1])), greater(wp.abs(v[2]), wp.abs(v[3])))


@wp.func
def loosened(rest: Equilibrium, moved: real):
    """`rest` with depths that stay bounds after any place moves by `moved` [m]."""
    loose = rest
    loose.depth += vec3(moved, moved, moved)
    loose.table += vec3(moved, moved, moved)
    return loose
