# type: ignore  # Warp functions, which type checkers cannot follow
"""The directions of a contact's force at one place of a link, side by side: what
`placing_posterior` sums up one by one.

C++ for Clang, see `warpgrasp.core.lanes`. Empty on a GPU.
"""

from math import log

import warp as wp

from strategies.contacts.placing_sums import LEVEL, MOST_DIRECTIONS, NEGLIGIBLE, WORST
from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.core.dtypes import real, vec3, vec4, vec7
from warpgrasp.core.lanes import LANES, lanes_begin
from warpgrasp.finger.sliding import (
    FLAT,
    LEAN_ASIDE,
    LEAN_MOST,
    LEAN_SIGMA,
    LEAN_UNKNOWN,
    LEAST,
    STEPS,
    STILL_M,
)

_SUM = lanes_begin() + """
    enum { J = sizeof(felt) / sizeof(double), GROUPS = MOST };
    const double total = wp::dot(felt, felt);
    const places u = everywhere(along_link), inwards = everywhere(towards);
    places d[GROUPS];
    reals chi[GROUPS], narrower[GROUPS], least_of_all = WORST;
    for (int g = 0; begin + g * L < end; ++g) {
        places share;
        flags counts;
        for (int l = 0; l < L; ++l) {
            const int n = begin + g * L + l;
            const wp::vec3d& one = direction.data[n < end ? n : begin];
            share.x[l] = one[0];
            share.y[l] = one[1];
            share.z[l] = one[2];
            counts[l] = n < end ? -1 : 0;
        }
        const places way = along(along(
            places{share.x * middle[0], share.x * middle[1], share.x * middle[2]},
            share.y, everywhere(across)), share.z, everywhere(over));
        if (!all_around)
            counts &= dot(way, u) >= -LEVEL;
        const reals none = 0.0;
        reals j[J], size = none, pushed = none;
        for (int k = 0; k < J; ++k)
            j[k] = way.x * by_x[k] + way.y * by_y[k] + way.z * by_z[k];
        reals a[J], b[J];
        reals ahead_one = none, ahead_two = none, sigma = none, aside = none;
        if (friction != 0.0) {
            places one = cross(u, way);
            const reals level = 1.0 / more(root(dot(one, one)), (reals)1e-300);
            one = places{one.x * level, one.y * level, one.z * level};
            const places two = cross(way, one);
            reals into = none, one_goes = none, two_goes = none, out_yields = none,
                one_pull = none, two_pull = none, one_yields = none, both = none,
                two_yields = none;
            for (int k = 0; k < J; ++k) {
                // At the skin, a radius off the axis.
                a[k] = one.x * by_x[k] + one.y * by_y[k] + one.z * by_z[k] + radius * (
                    two.x * turn_x[k] + two.y * turn_y[k] + two.z * turn_z[k]);
                b[k] = two.x * by_x[k] + two.y * by_y[k] + two.z * by_z[k] - radius * (
                    one.x * turn_x[k] + one.y * turn_y[k] + one.z * turn_z[k]);
                const reals yielding = j[k] * ease[k], one_yielding = a[k] * ease[k];
                into += j[k] * step[k];
                one_goes += a[k] * step[k];
                two_goes += b[k] * step[k];
                out_yields += j[k] * yielding;
                one_pull += a[k] * yielding;
                two_pull += b[k] * yielding;
                one_yields += a[k] * one_yielding;
                both += b[k] * one_yielding;
                two_yields += b[k] * b[k] * ease[k];
            }
            // As `force_lean`, in its words.
            const reals tiny = none + 1e-300, flat = FLAT * (one_yields + two_yields) + tiny;
            const reals easy = 1.0 / (out_yields + FLAT * flat + tiny);
            const reals push = into * easy, tilt_one = one_pull * easy, tilt_two = two_pull * easy;
            const reals by_one = one_goes - tilt_one * into, by_two = two_goes - tilt_two * into;
            one_yields += flat - tilt_one * one_pull;
            both -= tilt_one * two_pull;
            two_yields += flat - tilt_two * two_pull;
            auto passing = [&](reals slip, reals go_one, reals go_two, reals& x, reals& y) {
                const reals p = one_yields + slip, q = two_yields + slip;
                x = q * go_one - both * go_two;
                y = p * go_two - both * go_one;
                return p * q - both * both;
            };
            reals x, y, slip = none;
            const double cone = LEAN_MOST * friction;
            const reals edge = none + cone, by_push = 1.0 / push;
            const reals pushing = push * passing(slip, by_one, by_two, x, y)
                - (tilt_one * x + tilt_two * y);
            const reals still_x = x, still_y = y, still_size = root(x * x + y * y);
            const flags pushes = push > 0.0, sticks = pushes & (still_size <= cone * pushing);
            for (int n = 0; n < STEPS; ++n) {
                const reals by = 1.0 / root(x * x + y * y), c = x * by, s = y * by;
                const reals wanted = more(1.0 + cone * (tilt_one * c + tilt_two * s), none + LEAST)
                    * by_push * (1.0 / cone);
                reals less_x, less_y;
                const reals wide = passing(slip, c, s, less_x, less_y);
                const reals shrinks = c * less_x + s * less_y;
                const reals turns = (tilt_one * (less_x - c * shrinks)
                                     + tilt_two * (less_y - s * shrinks)) * by_push;
                reals slope = wide * shrinks * by;
                slope = more(slope + turns, 0.5 * slope);
                slip = more(slip + wide * (wanted - wide * by) / slope, none);
                passing(slip, by_one, by_two, x, y);
            }
            x = pushes ? (sticks ? still_x : x) : by_one;
            y = pushes ? (sticks ? still_y : y) : by_two;
            const flags stays = root(by_one * by_one + by_two * by_two) < STILL;
            const reals by = 1.0 / root(x * x + y * y);
            const flags goes = (x != 0.0) | (y != 0.0);
            ahead_one = goes ? x * by : none + 1.0;
            ahead_two = goes ? y * by : none;
            const reals far = stays ? none : sticks ? still_size / pushing : edge;
            x = ahead_one * far;
            y = ahead_two * far;
            for (int k = 0; k < J; ++k)
                j[k] += x * a[k] + y * b[k];
            aside = stays ? (reals)(LEAN_UNKNOWN * friction) : (reals)(LEAN_ASIDE * friction);
            sigma = stays | sticks ? aside : (reals)(LEAN_SIGMA * friction);
        }
        for (int k = 0; k < J; ++k) {
            size += j[k] * j[k];
            pushed += j[k] * felt[k];
        }
        size = more(size, (reals)1e-300);
        const reals push = more(pushed, none);
        reals left = total - push * push / size, narrow = none + 1.0;
        if (friction != 0.0) {
            const reals long_by = sigma * push / size, wide_by = aside * push / size;
            reals aa = none + 1.0, bb = aa, ab = none;
            reals ja = none, jb = none, fa = none, fb = none;
            for (int k = 0; k < J; ++k) {
                const reals ahead = (a[k] * ahead_one + b[k] * ahead_two) * long_by;
                b[k] = (b[k] * ahead_one - a[k] * ahead_two) * wide_by;
                a[k] = ahead;
                aa += a[k] * a[k];
                bb += b[k] * b[k];
                ab += a[k] * b[k];
                ja += j[k] * a[k];
                jb += j[k] * b[k];
                fa += felt[k] * a[k];
                fb += felt[k] * b[k];
            }
            const reals less_wide = 1.0 / (aa * bb - ab * ab);
            const reals jj = size - (bb * ja * ja - 2.0 * ab * ja * jb + aa * jb * jb) * less_wide;
            const reals jf = pushed - (
                bb * ja * fa - ab * (ja * fb + jb * fa) + aa * jb * fb) * less_wide;
            const reals ff = total - (
                bb * fa * fa - 2.0 * ab * fa * fb + aa * fb * fb) * less_wide;
            const reals whole = more(jf, none);
            left = ff - whole * whole / more(jj, (reals)1e-300);
            narrow = root(less_wide);
        }
        const places off = from_to(inwards, way);
        d[g] = way;
        chi[g] = counts ? left + dot(off, off) * sharp : (reals)WORST;
        narrower[g] = counts ? narrow : none;
        least_of_all = less(least_of_all, chi[g]);
    }
    const double least = __builtin_reduce_min(least_of_all);
    double sum = 0.0, most = 0.0, misfit = 0.0;
    wp::vec3d outward;
    for (int g = 0; begin + g * L < end; ++g) {
        const reals weight = narrower[g] * power_of_two(
            more(least - chi[g], (reals)-NEGLIGIBLE) * HALF_BITS);
        for (int l = 0; l < L; ++l) {
            sum += weight[l];
            outward += wp::vec3d(d[g].x[l], d[g].y[l], d[g].z[l]) * weight[l];
            if (weight[l] > most) {
                most = weight[l];
                misfit = chi[g][l];
            }
        }
    }
    wp::vec_t<7, double> sums(least);
    sums[1] = sum;
    for (int n = 0; n < 3; ++n)
        sums[2 + n] = outward[n];
    sums[5] = most;
    sums[6] = misfit;
    return sums;
#else
    return {};
#endif
"""
for _name, _value in (
        ("GROUPS = MOST", f"GROUPS = {-(-MOST_DIRECTIONS // LANES)}"),
        ("LEVEL", repr(LEVEL)), ("WORST", repr(float(WORST))),
        ("LEAN_MOST", repr(LEAN_MOST)), ("LEAN_SIGMA", repr(LEAN_SIGMA)),
        ("LEAN_ASIDE", repr(LEAN_ASIDE)), ("LEAN_UNKNOWN", repr(LEAN_UNKNOWN)),
        ("STEPS", repr(STEPS)), ("STILL", repr(STILL_M)), ("FLAT", repr(FLAT)),
        ("LEAST", repr(LEAST)),
        ("NEGLIGIBLE", repr(float(NEGLIGIBLE))), ("HALF_BITS", repr(0.5 / log(2.0)))):
    _SUM = _SUM.replace(_name, _value)


@wp.func_native(_SUM)
def directions_in_lanes(
    by_x: vec4, by_y: vec4, by_z: vec4, turn_x: vec4, turn_y: vec4, turn_z: vec4, felt: vec4,
    direction: wp.array[vec3], begin: int, end: int, all_around: bool,
    middle: vec3, across: vec3, over: vec3, along_link: vec3, towards: vec3,
    radius: real, friction: real, step: vec4, ease: vec4, sharp: real,
) -> vec7:
    """The fields of `Around`, in order, of the directions `begin` to `end`."""


@wp.func_native(_SUM)
def directions_in_lanes(  # noqa: F811 (an overload)
    by_x: vec6, by_y: vec6, by_z: vec6, turn_x: vec6, turn_y: vec6, turn_z: vec6, felt: vec6,
    direction: wp.array[vec3], begin: int, end: int, all_around: bool,
    middle: vec3, across: vec3, over: vec3, along_link: vec3, towards: vec3,
    radius: real, friction: real, step: vec6, ease: vec6, sharp: real,
) -> vec7:
    """The same of a chain's drives."""
