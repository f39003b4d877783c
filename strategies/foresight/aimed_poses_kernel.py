# type: ignore  # Warp functions, which type checkers cannot follow
"""Hand poses drawn about an object that is roughly known, each lifted clear of the table."""

import warp as wp

from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    TWO,
    TWO_PI,
    ZERO,
    greater,
    lesser,
    quat,
    real,
    struct,
    transform,
    vec3,
)
from warpgrasp.core.random_kernel import counter_key, counter_uniform
from warpgrasp.core.turns import sine_cosine

wp.set_module_options({"max_unroll": 1})


@struct
class Aims:
    """How poses are drawn; lengths in m."""

    about_felt: real
    """Share of them aimed beside a contact, where there is one."""
    beside: real
    """How far from it, along each axis."""
    flattest: real
    """Share of the sphere of approaches that is drawn from, from straight above; twice it."""
    nearest: real
    """From the aim back to the palm, at least."""
    deeper: real
    """And so much more at most."""
    clearance: real
    """Between hand and table at least."""
    clearer: real
    """And so much more at most."""
    radius: real
    """Of the balls that the hand is made of."""


@wp.func
def _drawn(key: wp.uint64, number: int):
    return counter_uniform(counter_key(key, number))


@wp.func
def _inside(key: wp.uint64, x: real, y: real, radius: real, height: real):
    """A place in an upright cylinder, evenly over its volume."""
    around = sine_cosine(TWO_PI * _drawn(key, 0))
    out = radius * wp.sqrt(_drawn(key, 1))
    return vec3(x + out * around[1], y + out * around[0], height * _drawn(key, 2))


@wp.func
def _beside(key: wp.uint64, point: vec3, far: real):
    """A place in a cube about `point`."""
    return point + far * vec3(TWO * _drawn(key, 8) - ONE, TWO * _drawn(key, 9) - ONE,
                              TWO * _drawn(key, 10) - ONE)


@wp.func
def _lowest(turn: quat, corner: wp.array[vec3]):
    """Height of the lowest of places in the frame that is turned, above its origin."""
    x, y, z, w = turn[0], turn[1], turn[2], turn[3]
    down = vec3(TWO * (x * z - y * w), TWO * (y * z + x * w), ONE - TWO * (x * x + y * y))
    low = wp.dot(down, corner[0])
    for c in range(1, corner.shape[0]):
        low = lesser(low, wp.dot(down, corner[c]))
    return low


@wp.func
def aimed_pose(key: wp.uint64, aim: vec3, aims: Aims, corner: wp.array[vec3]):
    """A pose that looks at `aim`: turned about the base's z, tilted from straight down about the
    new y, rolled about the approach. Half angles of the tilt come from its cosine alone."""
    share = _drawn(key, 3) * aims.flattest
    sin, cos = wp.sqrt(ONE - HALF * share), wp.sqrt(HALF * share)
    around, roll = TWO_PI * _drawn(key, 4), TWO_PI * _drawn(key, 5)
    less, more = sine_cosine(HALF * (roll - around)), sine_cosine(HALF * (roll + around))
    turn = quat(sin * less[0], sin * less[1], cos * more[0], cos * more[1])
    level = TWO * sin * cos
    approach = vec3(level * (more[1] * less[1] + more[0] * less[0]),
                    level * (more[0] * less[1] - more[1] * less[0]), share - ONE)
    place = aim - approach * (aims.nearest + aims.deeper * _drawn(key, 6))
    clear = aims.clearance + aims.clearer * _drawn(key, 7)
    low = _lowest(turn, corner) + place[2] - aims.radius
    return transform(place + vec3(ZERO, ZERO, greater(clear - low, ZERO)), turn)


@wp.kernel(enable_backward=False)
def aimed_poses_kernel(
    first: int,
    key: wp.array[wp.uint64],
    x: wp.array[real],
    y: wp.array[real],
    radius: wp.array[real],
    height: wp.array[real],
    felt: wp.array2d[vec3],
    felt_count: wp.array[int],
    corner: wp.array[vec3],
    aims: Aims,
    hand_pose: wp.array2d[transform],
):
    """The pose of each number, aimed at the inside of its world's cylinder or beside one of the
    first `felt_count` contacts. A pose depends on its key and number, not on how many are drawn."""
    w, p = wp.tid()
    w += first
    own = counter_key(key[w], p)
    count = felt_count[w]
    aim = vec3()
    if count > 0 and _drawn(own, 11) < aims.about_felt:
        chosen = wp.min(int(_drawn(own, 1) * real(count)), count - 1)
        aim = _beside(own, felt[w, chosen], aims.beside)
    else:
        aim = _inside(own, x[w], y[w], radius[w], height[w])
    hand_pose[w, p] = aimed_pose(own, aim, aims, corner)
