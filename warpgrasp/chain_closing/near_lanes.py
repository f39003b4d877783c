# type: ignore  # Warp functions, which type checkers cannot follow
"""The first step at which links of a hand of chains come near, eight steps side by side.

What `chain_near_kernel.first_near` finds look by look, in C++ for Clang (`core.lanes`). The hand is
placed at eight steps at once, some steps apart. Between two of them capsules have come no farther
than `come` says; where that is not enough to know them apart, eight steps one after the other
decide.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import CAPSULES, Chain, ChainCapsule, ChainJoint, vec6
from warpgrasp.chain.chain_lanes import CHAIN_LANES
from warpgrasp.chain_closing.chain_record import ChainClosingRow, ChainTruthRow
from warpgrasp.core.dtypes import real, transform, vec3
from warpgrasp.hand_rest.chain_meetings import FINGERS, CapsulePair

_APART = 6
"""Steps between two places of a first look."""

_NEAR = CHAIN_LANES + """
    enum { F = FINGERS, C = CAPSULES };
    const frames hand_frame = {{none, none, none}, {none, none, none, none + 1.0}};
    const wp::vec3d up = wp::quat_rotate_inv(base.q, wp::vec3d(0.0, 0.0, 1.0));
    places start[F * C], end[F * C];
    reals off[F];
    int step[L];

    // A finger's capsules, where it goes freely or rests
    auto place = [&](int f) {
        const auto& hand = wp::index(hands, own, f);
        const auto& rest = wp::index(truth, w, p, g, f);
        const int stop = wp::index(felt, w, p, g, f).step;
        reals command[J], q[J];
        flags rests;
        for (int l = 0; l < L; ++l) {
            const int t = step[l];
            const auto& led = wp::index(path, g, f, t);
            for (int d = 0; d < J; ++d)
                command[d][l] = led[d] - hand.offset[d];
            rests[l] = t >= stop ? -1 : 0;
            off[f][l] = t >= stop ? 0.0 : rest.touched < 0 || t < rest.touched
                ? ROUGH : ROUGH + rest.strayed;
        }
        rest_freely(hand, command, hand_frame, up, q);
        for (int d = 0; d < J; ++d)
            q[d] = rests ? none + rest.q[d] : q[d];
        poses at;
        posed(hand, q, hand_frame, at);
        const auto* skin = (decltype(capsule.data))hand.capsules;
        for (int c = 0; c < hand.capsule_count; ++c) {
            const int j = skin[c].joint;
            start[f * C + c] = placed(at.at[j], at.turn[j], skin[c].start);
            end[f * C + c] = placed(at.at[j], at.turn[j], skin[c].end);
        }
    };
    auto place_all = [&](int first, int apart) {
        for (int l = 0; l < L; ++l)
            step[l] = first + l * apart < last ? first + l * apart : last;
        for (int f = 0; f < hands.shape[1]; ++f)
            if (looked & (1 << f))
                place(f);
    };
    struct segments { places a, b, c, d; };
    auto segments_of = [&](const auto& pair) {
        segments s = {start[pair.one * C + pair.capsule], end[pair.one * C + pair.capsule]};
        s.c = pair.two < 0 ? everywhere(wp::index(palm, pair.other, 0))
                           : start[pair.two * C + pair.other];
        s.d = pair.two < 0 ? everywhere(wp::index(palm, pair.other, 1))
                           : end[pair.two * C + pair.other];
        return s;
    };
    // A bound by balls around two axes
    auto apart_at_least = [&](const segments& s) {
        const places u = from_to(s.a, s.b), v = from_to(s.c, s.d), r = from_to(s.c, s.a);
        const places m = along(along(r, none + 0.5, u), none - 0.5, v);
        return root(dot(m, m)) - 0.5 * (root(dot(u, u)) + root(dot(v, v)));
    };
    // `segment_pair`
    auto apart_of = [&](const segments& k) {
        const places u = from_to(k.a, k.b), v = from_to(k.c, k.d), r = from_to(k.c, k.a);
        const reals uu = dot(u, u), vv = dot(v, v), uv = dot(u, v), ur = dot(u, r), vr = dot(v, r);
        const reals across = uu * vv - uv * uv, one = none + 1.0;
        auto within = [&](reals x) { return less(more(x, none), one); };
        reals s = across > 1e-12 * uu * vv ? within((uv * vr - ur * vv) / across) : none;
        reals t = (uv * s + vr) / vv;
        s = t < 0.0 ? within(-ur / uu) : t > 1.0 ? within((uv - ur) / uu) : s;
        t = within(t);
        const places between = along(along(r, s, u), -t, v);
        return root(dot(between, between));
    };
    auto come_at = [&](int f, int c, int t) {
        const int stop = wp::index(felt, w, p, g, f).step;
        return wp::index(come, g, f, c, t < stop ? t : stop);
    };
    auto moves = [&](int f) { return wp::index(felt, w, p, g, f).step >= begin; };
    for (int first = begin; first <= last; first += (L - 1) * APART) {
        place_all(first, APART);
        reals used[F * C], stray[F];  // from each place to the next
        for (int f = 0; f < hands.shape[1]; ++f) {
            stray[f] = none;
            for (int l = 0; l + 1 < L; ++l) {
                const auto& row = wp::index(truth, w, p, g, f);
                const int stop = wp::index(felt, w, p, g, f).step;
                if (step[l] < stop)
                    stray[f][l] = row.touched >= 0 && row.touched <= step[l + 1]
                        ? ROUGH + row.strayed : ROUGH;
                for (int c = 0; c < wp::index(hands, own, f).capsule_count; ++c)
                    used[f * C + c][l] = come_at(f, c, step[l + 1]) - come_at(f, c, step[l]);
            }
            for (int c = 0; c < C; ++c)
                used[f * C + c][L - 1] = 0.0;
        }
        flags doubtful = 0;
        for (int n = 0; n < count; ++n) {
            const auto& pair = wp::index(pairs, wp::index(order, world, g, n));
            if (!moves(pair.one) && (pair.two < 0 || !moves(pair.two)))
                continue;
            const segments s = segments_of(pair);
            reals way = used[pair.one * C + pair.capsule], reach = stray[pair.one];
            if (pair.two >= 0) {
                way += used[pair.two * C + pair.other];
                reach += stray[pair.two];
            }
            way = way + 3.0 * reach + 2.0 * pair.both;
            auto next = [&](reals gap) {
                reals after = gap;
                for (int l = 0; l + 1 < L; ++l)
                    after[l] = gap[l + 1];
                return gap + after;
            };
            if (__builtin_reduce_and(next(apart_at_least(s)) > way) == 0)
                doubtful |= next(apart_of(s)) <= way;
        }
        int from[L];
        __builtin_memcpy(from, step, sizeof(from));
        for (int l = 0; l < L; ++l) {
            if (!doubtful[l])
                continue;
            place_all(from[l], 1);
            flags near = 0;
            for (int n = 0; n < count; ++n) {
                const auto& pair = wp::index(pairs, wp::index(order, world, g, n));
                if (!moves(pair.one) && (pair.two < 0 || !moves(pair.two)))
                    continue;
                const segments s = segments_of(pair);
                const reals reach = pair.two < 0 ? off[pair.one] + pair.both
                                                 : off[pair.one] + off[pair.two] + pair.both;
                if (__builtin_reduce_and(apart_at_least(s) > reach) == 0)
                    near |= apart_of(s) <= reach;
            }
            for (int k = 0; k < L; ++k)
                if (near[k])
                    return step[k];
        }
    }
    return last + 1;
#else
    return begin;
#endif
"""
for _name, _text in (
        ("FINGERS", str(FINGERS)), ("= CAPSULES", f"= {CAPSULES}"), ("APART", str(_APART)),
        ("ROUGH", "1e-4")):
    _NEAR = _NEAR.replace(_name, _text)


@wp.func_native(_NEAR)
def near_in_lanes(
    hands: wp.array2d[Chain], own: int, joint: wp.array[ChainJoint],
    capsule: wp.array[ChainCapsule], base: transform, path: wp.array3d[vec6],
    come: wp.array4d[real], palm: wp.array2d[vec3], pairs: wp.array[CapsulePair],
    order: wp.array3d[int], world: int, count: int, looked: int,
    felt: wp.array4d[ChainClosingRow], truth: wp.array4d[ChainTruthRow], w: int, p: int, g: int,
    begin: int, last: int,
) -> int:
    """The first step from `begin` on at which one of the first `count` pairs in `order` is near,
    `last` + 1 if none; `looked` has a bit for each of their fingers. `joint` and `capsule` are rows
    of any finger."""
