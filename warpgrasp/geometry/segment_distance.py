# type: ignore  # Warp functions, which type checkers cannot follow
"""The point of a link's axis nearest to the body.

Along a segment the distance may have several valleys, since it need not be convex. Samples choose a
valley, or one is followed from where it was. In a valley the slope is brought to zero by secants on
the product of distance and slope, which is linear along a straight line in front of a corner or an
edge. (The point nearest to the table is an end of the segment.)
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, greater, lesser, real, struct, vec2, vec3
from warpgrasp.geometry.scene import Scene, body_distance, body_distance_grad

# More do not bring a superquadric's link nearer to the truth: its valleys are then those of the
# first-order value, which is least elsewhere than where its gradient is level and the body nearest.
LINK_SAMPLES = wp.constant(5)
_REFINEMENTS = wp.constant(32)
_HALVE_FROM = wp.constant(4)
_LEVEL = wp.constant(real(1e-7))  # slope
_WIDTH = wp.constant(real(1e-7))  # of the bracket, relative to the link's length
_SHALLOW = wp.constant(real(1e-3))  # [m]; keeps distance times slope rising inside a body
_FLATTEST = wp.constant(real(1e-3))
_FAR = wp.constant(real(1e9))  # [m]

_Ends = wp.types.vector(length=9, dtype=real)


@struct
class Near:
    """The point of a segment nearest to a body: place [m from its start], distance [m], product of
    distance and slope (to follow it), outward normal.

    `least` is a lower bound of the distance along the whole segment, which may be far from the
    nearest point; with `bound` 1 the distance itself is only that bound.
    """

    along: real
    distance: real
    least: real
    bound: int
    bend: real
    normal: vec3


@struct
class _Found:
    """A field changes in place; a struct assigned in a branch is copied at its end."""

    near: Near


@wp.func
def link_valley(
    scene: Scene, body: int, a: vec3, u: vec3, low: real, high: real, start: real, rate: real,
    enough: real, convex: bool
):
    """The bottom of the valley that `start` lies in, between `low` and `high`.

    A lower bound where the distance at `start` shows that the valley lies above `enough`. In front
    of a `convex` body the search ends where the plane through the body's nearest point shows that
    the whole segment stays beyond `enough` by half as much as the place evaluated.
    """
    return _link_valley(scene, body, a[0], a[1], a[2], u[0], u[1], u[2], low, high, start, rate,
                        enough, convex)


@wp.func(inline=False)
def _link_valley(
    scene: Scene, body: int, ax: real, ay: real, az: real, ux: real, uy: real, uz: real, low: real,
    high: real, start: real, rate: real, enough: real, convex: bool
):
    # Numbers, which go in registers: a vector is written to the stack, and waited for there.
    a = vec3(ax, ay, az)
    u = vec3(ux, uy, uz)
    near = Near()
    below = real(low)
    above = real(high)
    descends = int(0)  # at `below`
    rises = int(0)  # at `above`
    t = real(start)
    bend = real(rate)
    last_t = real(0.0)
    last_psi = real(0.0)
    for k in range(_REFINEMENTS):
        g = body_distance_grad(scene, body, a + u * t)
        near.along = t
        near.distance = g[3]
        near.least = g[3]
        near.normal = vec3(g[0], g[1], g[2])
        slope = wp.dot(near.normal, u)
        if convex:
            bound = g[3] + lesser((low - t) * slope, (high - t) * slope)
            if bound - enough > HALF * (g[3] - enough):
                near.least = bound
                break
        elif k == 0:
            bound = g[3] - greater(t - low, high - t)
            if bound > enough:
                near.distance = bound
                near.least = bound
                near.bound = 1
                break
        psi = slope * greater(g[3], _SHALLOW)
        if k > 0:
            # Along a face the slope does not change: on to the end, or the middle, of the bracket.
            bend = greater((psi - last_psi) / (t - last_t), _FLATTEST)
        last_t = t
        last_psi = psi
        if wp.abs(slope) < _LEVEL:
            break
        if slope > ZERO:
            if t <= below:
                break
            above = t
            rises = int(1)
        else:
            if t >= above:
                break
            below = t
            descends = int(1)
        if above - below < _WIDTH * (high - low):
            break
        t = t - psi / bend
        if t <= below:
            t = wp.where(descends == 1, (below + above) * HALF, below)
        elif t >= above:
            t = wp.where(rises == 1, (below + above) * HALF, above)
        elif k >= _HALVE_FROM and k % 2 == 0 and descends == 1 and rises == 1:
            t = (below + above) * HALF  # against kinks
    near.bend = bend
    return near


@wp.func
def nearest_on_link(
    scene: Scene, body: int, a: vec3, u: vec3, length: real, guess: real, bend: real,
    samples: int, enough: real
):
    """The point of a segment nearest to the body.

    A `guess` that is not negative follows the valley from there, with the `bend` found before, and
    checks that none of the `samples` (0, or 2 and more) lies lower. Otherwise the samples choose;
    without any, as before a convex body, which has one valley, the middle of the link begins. A
    distance above `enough` may be a lower bound.
    """
    return _nearest_on_link(scene, body, a[0], a[1], a[2], u[0], u[1], u[2], length, guess, bend,
                            samples, enough)


@wp.func(inline=False)
def _nearest_on_link(
    scene: Scene, body: int, ax: real, ay: real, az: real, ux: real, uy: real, uz: real,
    length: real, guess: real, bend: real, samples: int, enough: real
):
    a = vec3(ax, ay, az)
    u = vec3(ux, uy, uz)
    spacing = length / real(wp.max(samples - 1, 1))
    found = _Found()
    found.near.distance = real(1e9)
    begin = real(guess)
    rate = real(bend)
    low = real(0.0)
    high = real(length)
    search = int(1)
    if guess < ZERO:
        bound = body_distance(scene, body, a + u * (length * HALF)) - length * HALF
        if bound > enough:
            found.near.distance = bound
            found.near.least = bound
            found.near.along = length * HALF
            found.near.bend = ONE
            search = int(0)
        if samples == 0:
            begin = length * HALF
            rate = real(1.0)
    for attempt in range(2):
        if search == 1:
            if begin >= ZERO:
                found.near = link_valley(scene, body, a, u, low, high, begin, rate, enough,
                                         False)
            search = int(0)
            if attempt == 0 and (begin < ZERO or found.near.bound == 0):
                least = found.near.distance - real(1e-9)
                for k in range(samples):
                    t = spacing * real(k)
                    if guess < ZERO or wp.abs(t - found.near.along) > spacing * HALF:
                        d = body_distance(scene, body, a + u * t)
                        if d < least:
                            least = d
                            begin = t
                            rate = real(1.0)
                            low = greater(t - spacing, ZERO)
                            high = lesser(t + spacing, length)
                            search = int(1)
    return found.near


@wp.func(inline=False)
def deepest_valley(
    scene: Scene, body: int, a: vec3, u: vec3, length: real, parts: int, enough: real
):
    """The place [m from its start] where a segment is nearest to the body, or negative.

    Negative where the segment certainly is farther than `enough` [m]. Eight stretches are sampled
    in `parts` each, and every valley found is searched. A stretch is left out where no place of it
    can be nearer than its ends allow, since distances are 1-Lipschitz.
    """
    best = real(-1.0)
    stretch = length / real(8.0)
    ends = _Ends()
    least = real(1e9)
    nearest = real(1e9)
    if body_distance(scene, body, a + u * (length * HALF)) - length * HALF <= enough:
        for k in range(9):
            ends[k] = body_distance(scene, body, a + u * (stretch * real(k)))
            least = lesser(least, ends[k])
    if least - stretch * HALF <= enough:
        step = stretch / real(parts)
        before = real(1e9)
        here = ends[0]
        for k in range(8):
            count = int(1)
            if (ends[k] + ends[k + 1] - stretch) * HALF < lesser(least, enough):
                count = parts
            for j in range(count):
                t = stretch * real(k) + step * real(j)
                after = ends[k + 1]
                if j < count - 1:
                    after = body_distance(scene, body, a + u * (t + step))
                if here <= before and here <= after and here - step * HALF <= least:
                    near = link_valley(scene, body, a, u, greater(t - step, ZERO),
                                   lesser(t + step, length), t, ONE, _FAR, False)
                    if near.distance < nearest:
                        nearest = near.distance
                        least = lesser(least, nearest)
                        best = near.along
                before = here
                here = after
        if here <= before and here - step * HALF <= least:
            near_end = link_valley(scene, body, a, u, length - step, length, length, ONE,
                                   _FAR, False)
            if near_end.distance < nearest:
                best = near_end.along
    return best


@wp.func
def lower_end(u: vec3, length: real):
    """Place [m] along a segment where it is nearest to the table."""
    if u[2] < ZERO:
        return length
    return ZERO


@wp.func
def nearest_along(scene: Scene, body: int, a: vec3, u: vec3, length: real, enough: real):
    """Place [m from a] and distance of the point of a segment nearest to body and table.

    A distance above `enough` may be a lower bound.
    """
    near = nearest_on_link(scene, body, a, u, length, -ONE, ONE, LINK_SAMPLES, enough)
    low = lower_end(u, length)
    if a[2] + u[2] * low < near.distance:
        return vec2(low, a[2] + u[2] * low)
    return vec2(near.along, near.distance)
