# type: ignore  # Warp functions, which type checkers cannot follow
"""What hands would meet in a grid of beliefs: which poses are barred, what each finger touches.

Balls are looked up in units of a cell, since a step asks for millions, and `LANES` poses at a time
are sent through the same balls, side by side in the processor's vectors: that is C++ for Clang,
which compiles Warp's kernels for CPUs. Arrays are taken to be contiguous.
"""

import warp as wp

from warpgrasp.core.dtypes import real, struct, transform, vec3

wp.set_module_options({"max_unroll": 1})
LANES = 4
"""Poses that are looked at side by side: as many doubles as a vector of AVX2 holds."""
MOST_FINGERS = 16
BORDER = 1
"""Cells that hold nothing around the grid that is looked up: places outside need no question."""
_ON_BOTH_SIDES = wp.constant(2 * BORDER)


@struct
class Looks:
    """What is asked of every pose; heights above the base's origin in m."""

    floor: real
    """Below it the centre of a ball of the open hand is in the table."""
    table: real
    """Below it that of a ball of a finger stops."""
    lowest: real
    """Below it touches are taken for the table's."""
    sure: real
    """Probability above which what is met is not passed."""
    share: real
    """How much of a place that bars the hand by itself a ball of the open hand is."""


@wp.kernel(enable_backward=False)
def looked_up_kernel(
    first: int,
    n: wp.vec3i,
    hit: wp.array2d[wp.float32],
    cap: wp.array2d[wp.float32],
    worth: wp.array2d[wp.float32],
    chance: wp.array2d[wp.float32],
    value: wp.array2d[wp.float32],
):
    """What is believed of a cell, and what touches there are worth; both within the border, which
    starts as zeros."""
    w = wp.tid() + first
    for i in range(n[0]):
        for j in range(n[1]):
            at = (i * n[1] + j) * n[2]
            row = (i + BORDER) * (n[1] + _ON_BOTH_SIDES) + j + BORDER
            to = row * (n[2] + _ON_BOTH_SIDES) + BORDER
            for k in range(n[2]):
                chance[w, to + k] = wp.min(hit[w, at + k], cap[w, at + k])
                value[w, to + k] = worth[w, at + k]


_FORESEE = """
#if !defined(__CUDA_ARCH__)
    enum { L = LANES };
    typedef double v __attribute__((ext_vector_type(L)));
    typedef long m __attribute__((ext_vector_type(L)));  // of comparisons: 0, or all bits
    typedef int c __attribute__((ext_vector_type(L)));
    const v zero = 0.0, one = 1.0;

    // From the hand's frame to cells of the grid with its border.
    const int poses = hand_pose.shape[1], begin = group * L;
    const int lanes = poses - begin < L ? poses - begin : L;
    const wp::vec3d corner_m = corner.data[world];
    const double size = cell.data[world];
    const size_t row = (size_t)world * poses + begin;
    v turn[9], place[3];
    m open;
    for (int l = 0; l < L; ++l) {
        const size_t at = row + (l < lanes ? l : 0);
        const wp::transformd& pose = hand_pose.data[at];
        const double x = pose.q.x, y = pose.q.y, z = pose.q.z, w = pose.q.w;
        const double once = 1.0 / size, twice = 2.0 / size;
        turn[0][l] = once - twice * (y * y + z * z);
        turn[1][l] = twice * (x * y - z * w);
        turn[2][l] = twice * (x * z + y * w);
        turn[3][l] = twice * (x * y + z * w);
        turn[4][l] = once - twice * (x * x + z * z);
        turn[5][l] = twice * (y * z - x * w);
        turn[6][l] = twice * (x * z - y * w);
        turn[7][l] = twice * (y * z + x * w);
        turn[8][l] = once - twice * (x * x + y * y);
        for (int a = 0; a < 3; ++a)
            place[a][l] = (pose.p[a] - corner_m[a]) / size + BORDER;
        open[l] = l < lanes && wanted.data[at] ? -1 : 0;
    }
    auto height = [&](double z) { return (v)((z - corner_m[2]) / size + BORDER); };
    const v floor = height(looks.floor), table = height(looks.table);
    const v lowest = height(looks.lowest), sure = looks.sure;
    auto along = [&](int a, const wp::vec3d& ball) {
        return turn[3 * a] * ball[0] + turn[3 * a + 1] * ball[1] + turn[3 * a + 2] * ball[2]
            + place[a];
    };

    // Numbers of cells, and what they hold.
    const int deep = n[2] + 2 * BORDER, wide = (n[1] + 2 * BORDER) * deep;
    const float* chances = chance.data + (size_t)world * chance.shape[1];
    const float* values = value.data + (size_t)world * value.shape[1];
    auto whole = [&](v u, int count) {
        const v last = (double)(count + BORDER);
        u = u > zero ? u : zero;
        u = u < last ? u : last;
        return __builtin_convertvector(u, c);
    };
    auto number = [&](v x, v y, v z) {
        return whole(x, n[0]) * wide + whole(y, n[1]) * deep + whole(z, n[2]);
    };
    auto held = [&](const float* cells, c at) {
        v found;
        for (int l = 0; l < L; ++l)
            found[l] = cells[(unsigned)at[l]];
        return found;
    };

    // The open hand: whether it is where something may be.
    v most = zero, free = one;
    for (int b = 0; b < open_ball.shape[0]; ++b) {
        const wp::vec3d& ball = open_ball.data[b];
        const v z = along(2, ball);
        const v now = held(chances, number(along(0, ball), along(1, ball), z));
        open &= z >= floor;
        most = now > most ? now : most;
        free *= one - now;
    }
    const v start = most * most;
    open &= start <= sure;
    for (int l = 0; l < lanes; ++l) {
        const double met = 1.0 - wp::pow(free[l], looks.share);
        barred.data[row + l] = open[l] ? (met > most[l] ? met : most[l]) : 1.0;
    }

    // The fingers: how far each goes, and what it touches. A cell to which one is sent stops it by
    // the square of what is believed: poses are picked for what is left to find, and there beliefs
    // are too high. Of fingers sent to cells believed at 0.35, 0.55 and 0.85 about 0.2, 0.5 and 0.9
    // felt something [est].
    struct Walk {
        v most, gain, best, x, y, z;
        m going;
    } walks[MOST_FINGERS];
    const int fingers = met.shape[0], places = swept_ball.shape[1], balls = swept_ball.shape[2];
    auto follow = [&](int finger, int from, int to, v share) {
        Walk walk = walks[finger];
        for (int s = from; s < to && __builtin_reduce_or(walk.going); ++s) {
            const wp::vec3d* ball = swept_ball.data + ((size_t)finger * places + s) * balls;
            for (int b = 0; b < balls; ++b, ++ball) {
                const v x = along(0, *ball), y = along(1, *ball), z = along(2, *ball);
                walk.going &= z >= table;
                const c at = number(x, y, z);
                const v belief = held(chances, at), now = belief * belief;
                const m more = walk.going & (now > walk.most);
                if (!__builtin_reduce_or(more))
                    continue;
                if (feels.data[finger * balls + b]) {
                    const v worth = share * (now - walk.most) * held(values, at);
                    const v touch = (more & (z > lowest)) ? worth : zero;
                    const m better = touch > walk.best;
                    walk.gain += touch;
                    walk.best = better ? touch : walk.best;
                    walk.x = better ? x : walk.x;
                    walk.y = better ? y : walk.y;
                    walk.z = better ? z : walk.z;
                }
                walk.most = more ? now : walk.most;
            }
            walk.going &= walk.most <= sure;
        }
        walks[finger] = walk;
    };
    for (int f = 0; f < fingers; ++f) {
        walks[f] = { start, zero, zero, zero, zero, zero, open };
        follow(f, 0, met.data[f], one);
    }
    v stopped[MOST_FINGERS];
    for (int f = 0; f < fingers; ++f)
        stopped[f] = walks[f].most;
    for (int f = 0; f < fingers; ++f)
        if (meets.data[f] >= 0)
            follow(f, met.data[f], places, stopped[meets.data[f]]);
    for (int l = 0; l < lanes; ++l)
        for (int f = 0; f < fingers; ++f) {
            const size_t at = (row + l) * fingers + f;
            const Walk& walk = walks[f];
            gain.data[at] = walk.gain[l];
            if (closely) {
                const wp::vec3d cells(walk.x[l] - BORDER, walk.y[l] - BORDER, walk.z[l] - BORDER);
                place_of.data[at] = walk.gain[l] > 0.0 ? corner_m + cells * size : wp::vec3d();
            }
        }
#endif
"""
for _name, _number in (("LANES", LANES), ("BORDER", BORDER), ("MOST_FINGERS", MOST_FINGERS)):
    _FORESEE = _FORESEE.replace(_name, str(_number))


@wp.func_native(_FORESEE)
def _foresee(
    world: int, group: int, n: wp.vec3i, looks: Looks, closely: wp.bool, corner: wp.array[vec3],
    cell: wp.array[real], open_ball: wp.array[vec3], swept_ball: wp.array3d[vec3],
    feels: wp.array2d[wp.bool], met: wp.array[int], meets: wp.array[int],
    hand_pose: wp.array2d[transform], wanted: wp.array2d[wp.bool], chance: wp.array2d[wp.float32],
    value: wp.array2d[wp.float32], barred: wp.array2d[real], gain: wp.array3d[real],
    place_of: wp.array3d[vec3],
):
    """`LANES` poses of a world from `group` times as many on; see `foresee_kernel`."""


@wp.kernel(enable_backward=False)
def foresee_kernel(
    first: int,
    corner: wp.array[vec3],
    cell: wp.array[real],
    n: wp.vec3i,
    looks: Looks,
    closely: wp.bool,
    open_ball: wp.array[vec3],
    swept_ball: wp.array3d[vec3],
    feels: wp.array2d[wp.bool],
    met: wp.array[int],
    meets: wp.array[int],
    hand_pose: wp.array2d[transform],
    wanted: wp.array2d[wp.bool],
    chance: wp.array2d[wp.float32],
    value: wp.array2d[wp.float32],
    barred: wp.array2d[real],
    gain: wp.array3d[real],
    place: wp.array3d[vec3],
):
    """The probability that a pose is barred, and for each finger the expected worth of its touch
    and the likeliest place of it. The open hand is barred by any of its places, or by the likeliest
    at least. Probabilities along a path are those of one uncertain surface:
    that a finger was stopped by then is the greatest of all cells met so far. From its place `met`
    on a finger is stopped by the hand itself, unless the finger that it `meets` there was `stopped`
    before."""
    w, group = wp.tid()
    _foresee(w + first, group, n, looks, closely, corner, cell, open_ball, swept_ball, feels, met,
             meets, hand_pose, wanted, chance, value, barred, gain, place)
