"""Where a finger rests: the least energy of its joint servos and its skin against rigid things.

    E(q) = 1/2 K |q_cmd - q|^2 + sum over links and obstacles 1/2 k max(0, r - phi(x_link(q)))^2

The obstacles are the body and the table, phi the signed distance of one of them, x_link the point
of the link's axis nearest to it: a link between object and table bears on both. (With one distance
for both, the energy has a kink where they are equally near, and a descent stalls on it.)
Newton steps on the Gauss-Newton Hessian with backtracking: E never rises.
"""

import warp as wp

from warpgrasp.real import HALF, ONE, ZERO, mat44, real, vec2, vec3, vec4
from warpgrasp.scene import Scene, body_distance, body_distance_grad
from warpgrasp.utah_mit_hand import FingerPose, Hand, finger_jacobian, finger_pose

_SAMPLES = wp.constant(5)
_REFINEMENTS = wp.constant(24)
_WIDTH = wp.constant(real(1e-9))  # of the place along a link, relative to its length
_ITERATIONS = wp.constant(30)
_HALVINGS = wp.constant(12)
_GRADIENT = wp.constant(real(1e-8))  # [N m]
_FAR = wp.constant(real(1e9))


@wp.struct
class Rest:
    """A finger at rest: joints, energy [J], its gradient, and where each link touches.

    `along` is the place on each link's axis [m from its joint] nearest to the body, `depth` how far
    the body presses the skin in [m], `table` the same of the table (at the link's lower end); not
    positive where a link is free.
    """

    q: vec4
    energy: real
    gradient: vec4
    along: vec3
    depth: vec3
    table: vec3


@wp.func
def lower_end(u: vec3, length: real):
    """Place [m] along a segment where it is nearest to the table."""
    if u[2] < ZERO:
        return length
    return ZERO


@wp.func
def nearest_along(scene: Scene, body: int, a: vec3, u: vec3, length: real):
    """Place [m from a] and distance of the point of a segment nearest to body and table."""
    near = nearest_on_body(scene, body, a, u, length)
    low = lower_end(u, length)
    if a[2] + u[2] * low < near[1]:
        return vec2(low, a[2] + u[2] * low)
    return near


@wp.func
def nearest_on_body(scene: Scene, body: int, a: vec3, u: vec3, length: real):
    """Place [m from a] and distance of the point of a segment nearest to the body.

    Five samples choose the valley (a distance need not be convex along a segment), then the slope
    is brought to zero inside it by bisection with secants.
    """
    best = int(0)
    best_d = _FAR
    spacing = length / real(_SAMPLES - 1)
    for k in range(_SAMPLES):
        d = body_distance(scene, body, a + u * (spacing * real(k)))
        if d < best_d:
            best_d = d
            best = int(k)
    low = spacing * real(wp.max(best - 1, 0))
    high = spacing * real(wp.min(best + 1, _SAMPLES - 1))
    g = body_distance_grad(scene, body, a + u * low)
    slope_low = g[0] * u[0] + g[1] * u[1] + g[2] * u[2]
    if slope_low >= ZERO:
        return vec2(low, g[3])
    g = body_distance_grad(scene, body, a + u * high)
    slope_high = g[0] * u[0] + g[1] * u[1] + g[2] * u[2]
    if slope_high <= ZERO:
        return vec2(high, g[3])
    t = low
    d = g[3]
    side = int(0)
    for k in range(_REFINEMENTS):
        # The Illinois variant of false position; every third step halves, against kinks.
        t = (low * slope_high - high * slope_low) / (slope_high - slope_low)
        if k % 3 == 2:
            t = (low + high) * HALF
        g = body_distance_grad(scene, body, a + u * t)
        d = g[3]
        slope = g[0] * u[0] + g[1] * u[1] + g[2] * u[2]
        if wp.abs(slope) < real(1e-10) or high - low < _WIDTH * length:
            break
        if slope < ZERO:
            low = t
            slope_low = slope
            if side == 1:
                slope_high = slope_high * HALF
            side = int(1)
        else:
            high = t
            slope_high = slope
            if side == 2:
                slope_low = slope_low * HALF
            side = int(2)
    return vec2(t, d)


@wp.func
def link_start(f: FingerPose, link: int):
    """Joint a link starts from."""
    if link == 0:
        return f.p1
    if link == 1:
        return f.p2
    return f.p3


@wp.func
def link_direction(f: FingerPose, link: int):
    """Unit vector along a link."""
    if link == 0:
        return f.u1
    if link == 1:
        return f.u2
    return f.u3


@wp.func
def table_jacobian(f: FingerPose, link: int, length: real):
    """Rise of a link's lower end per radian a joint."""
    u = link_direction(f, link)
    x = link_start(f, link) + u * lower_end(u, length)
    return finger_jacobian(f, link, x, vec3(ZERO, ZERO, ONE))


@wp.func
def rest_energy(scene: Scene, body: int, hand: Hand, base: wp.transformd, command: vec4, q: vec4):
    """Energy, its gradient and the depths of the links at joints `q`; `base` in body frame."""
    rest = Rest()
    rest.q = q
    f = finger_pose(hand, base, q)
    lag = command - q
    rest.energy = HALF * hand.stiffness * wp.dot(lag, lag)
    rest.gradient = -lag * hand.stiffness
    for link in range(3):
        a = link_start(f, link)
        u = link_direction(f, link)
        length = hand.link_length[link]
        middle = body_distance(scene, body, a + u * (length * HALF))
        rest.along[link] = length * HALF
        rest.depth[link] = hand.link_radius - (middle - length * HALF)
        if rest.depth[link] > ZERO:
            near = nearest_on_body(scene, body, a, u, length)
            rest.along[link] = near[0]
            depth = hand.link_radius - near[1]
            rest.depth[link] = depth
            if depth > ZERO:
                x = a + u * near[0]
                g = body_distance_grad(scene, body, x)
                j = finger_jacobian(f, link, x, vec3(g[0], g[1], g[2]))
                rest.energy += HALF * hand.skin * depth * depth
                rest.gradient -= j * (hand.skin * depth)
        else:
            # A bound from the link's middle: free for certain, depth at most this.
            rest.depth[link] = wp.min(rest.depth[link], ZERO)
        low = a + u * lower_end(u, length)
        rest.table[link] = hand.link_radius - low[2]
        if rest.table[link] > ZERO:
            pressed = rest.table[link]
            rest.energy += HALF * hand.skin * pressed * pressed
            rest.gradient -= table_jacobian(f, link, length) * (hand.skin * pressed)
    return rest


@wp.func
def _newton_step(scene: Scene, body: int, hand: Hand, base: wp.transformd, rest: Rest):
    f = finger_pose(hand, base, rest.q)
    k = hand.stiffness
    h = mat44(k, ZERO, ZERO, ZERO, ZERO, k, ZERO, ZERO, ZERO, ZERO, k, ZERO, ZERO, ZERO, ZERO, k)
    for link in range(3):
        if rest.depth[link] > ZERO:
            x = link_start(f, link) + link_direction(f, link) * rest.along[link]
            g = body_distance_grad(scene, body, x)
            j = finger_jacobian(f, link, x, vec3(g[0], g[1], g[2]))
            h += wp.outer(j, j) * hand.skin
        if rest.table[link] > ZERO:
            j = table_jacobian(f, link, hand.link_length[link])
            h += wp.outer(j, j) * hand.skin
    return -(wp.inverse(h) * rest.gradient)


@wp.func
def finger_rest(
    scene: Scene, body: int, hand: Hand, base: wp.transformd, command: vec4, start: vec4
):
    """The rest configuration for a command, descending from `start`; `base` in the body's frame."""
    rest = rest_energy(scene, body, hand, base, command, start)
    for _ in range(_ITERATIONS):
        worst = wp.max(wp.max(wp.abs(rest.gradient[0]), wp.abs(rest.gradient[1])),
                       wp.max(wp.abs(rest.gradient[2]), wp.abs(rest.gradient[3])))
        if worst < _GRADIENT:
            break
        step = _newton_step(scene, body, hand, base, rest)
        scale = real(1.0)
        descended = int(0)
        for _h in range(_HALVINGS):
            trial = rest_energy(scene, body, hand, base, command, rest.q + step * scale)
            if trial.energy < rest.energy:
                rest = trial
                descended = int(1)
                break
            scale = scale * HALF
        if descended == 0:
            break
    return rest


