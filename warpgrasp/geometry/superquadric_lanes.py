"""Straight superquadrics at several points side by side: C++ for Clang, which compiles Warp's
kernels for CPUs.

The same formulas as `sdf_superquadric`, for one body without bend and `LANES` points in the
processor's vectors. A power is an exponential of a logarithm, both series of their own, since a
library takes one number at a time; four powers a point cost a tenth of what they cost there. The
text begins the body of a `wp.func_native` that has a body as `s`, a `SuperquadricShape`, and its
`pose`.
"""

from math import factorial, log

LANES = 8
"""As many doubles as a vector of AVX-512 holds; others take two or four vectors."""
_TERMS_LOGARITHM = 11
"""Of the series of log((1 + t) / (1 - t)), |t| up to 0.1716: the first left out is 1e-18."""
_TERMS_EXPONENTIAL = 14
"""Of 2^r, |r| up to a half: the first left out is 4e-18."""


def _polynomial(by: str, coefficients: list[float]) -> str:
    """A polynomial, lowest power first, as sums of pairs, of pairs of pairs and so on (Estrin
    1960): no product waits for more than four others."""
    terms, power = [f"{c!r}" for c in coefficients], by
    while len(terms) > 1:
        pairs = [" + ".join([low, *(f"{power} * {high}" for high in above)])
                 for low, *above in (terms[n:n + 2] for n in range(0, len(terms), 2))]
        terms = [f"({pair})" for pair in pairs]
        power = f"({power} * {power})"
    return terms[0]


SUPERQUADRIC_LANES = """
#if !defined(__CUDA_ARCH__)
    enum { L = LANES };
    typedef double reals __attribute__((ext_vector_type(L)));
    typedef double anywhere __attribute__((ext_vector_type(L), aligned(8)));  // in an array
    typedef decltype(reals() < reals()) flags;  // 0, or all bits of 64
    struct places { reals x, y, z; };
    const double tiny = 1e-12, thin = 0.02;
    auto bits = [](reals x) { return __builtin_bit_cast(flags, x); };
    auto real_of = [](flags x) { return __builtin_bit_cast(reals, x); };
    auto less = [](reals a, reals b) { return a < b ? a : b; };
    auto more = [](reals a, reals b) { return a > b ? a : b; };
    auto size_of = [](reals a) { return a < 0.0 ? -a : a; };
    auto root = [](reals a) { return __builtin_elementwise_sqrt(a); };
    auto dot = [](places a, places b) { return a.x * b.x + a.y * b.y + a.z * b.z; };
    auto from_to = [](places a, places b) { return places{b.x - a.x, b.y - a.y, b.z - a.z}; };
    auto along = [](places a, reals t, places b) {
        return places{a.x + t * b.x, a.y + t * b.y, a.z + t * b.z}; };

    auto gathered = [](const wp::vec3d* from, auto at) {
        places p;
        for (int l = 0; l < L; ++l) {
            const wp::vec3d& one = from[at(l)];
            p.x[l] = one[0];
            p.y[l] = one[1];
            p.z[l] = one[2];
        }
        return p;
    };
    const wp::mat33d turn = wp::quat_to_matrix(pose.q);
    auto turned = [&](places a) {
        return places{turn.data[0][0] * a.x + turn.data[0][1] * a.y + turn.data[0][2] * a.z,
                      turn.data[1][0] * a.x + turn.data[1][1] * a.y + turn.data[1][2] * a.z,
                      turn.data[2][0] * a.x + turn.data[2][1] * a.y + turn.data[2][2] * a.z};
    };
    auto turned_back = [&](places a) {
        return places{turn.data[0][0] * a.x + turn.data[1][0] * a.y + turn.data[2][0] * a.z,
                      turn.data[0][1] * a.x + turn.data[1][1] * a.y + turn.data[2][1] * a.z,
                      turn.data[0][2] * a.x + turn.data[1][2] * a.y + turn.data[2][2] * a.z};
    };
    auto in_frame = [&](places a) {
        return turned_back(places{a.x - pose.p[0], a.y - pose.p[1], a.z - pose.p[2]}); };

    auto power = [&](reals base, double exponent) {
        const flags held = bits(more(base, (reals)tiny));
        reals c = real_of((held & 0xfffffffffffffLL) | 0x3ff0000000000000LL);
        const flags wide = c > 1.4142135623730951;
        c = wide ? c * 0.5 : c;
        const reals t = (c - 1.0) / (c + 1.0), tt = t * t;
        reals y = __builtin_convertvector((held >> 52) - 1023 - wide, reals) + t * LOGARITHM;
        y = more(y * exponent, (reals)-1022.0);
        const double shift = 6755399441055744.0;  // leaves whole numbers in the last bits
        const reals n = y + shift, r = y - (n - shift);
        const reals two = real_of(bits(EXPONENTIAL) + (bits(n) << 52));
        return base < tiny ? (reals)0.0 : two;
    };

    // `superquadric_gauge`. Of two that are compared the greater is one, and so are its powers.
    struct slopes { places by; reals value; };
    const double across_x = 1.0 / s.size[0], across_y = 1.0 / s.size[1], upwards = 1.0 / s.size[2];
    auto gauge = [&](places p) {
        const reals x = size_of(p.x) * across_x, y = size_of(p.y) * across_y;
        const reals z = size_of(p.z) * upwards;
        const flags wide = x >= y;
        const reals broad = more(wide ? x : y, (reals)tiny), most = more(broad, z);
        const reals narrow = (wide ? y : x) / broad, low = less(broad, z) / most;
        const flags beside = broad >= z;
        const reals of_narrow = power(narrow, 2.0 / s.e2), a = of_narrow + 1.0;
        const reals of_low = power(low, 2.0 / s.e1);
        const reals ring = (beside ? (reals)1.0 : of_low) * power(a, s.e2 / s.e1);
        const reals top = beside ? of_low : (reals)1.0;
        const reals total = ring + top, f = power(total, 0.5 * s.e1), common = f / total;
        // Slopes have powers less by one: quotients of those above.
        const reals side = common * ring / (beside ? a : a * more(low, (reals)tiny));
        const reals far = side * of_narrow / more(narrow, (reals)tiny);
        slopes g;
        g.by.x = (wide ? side : far) * across_x;
        g.by.y = (wide ? far : side) * across_y;
        g.by.z = common * (beside ? of_low / more(low, (reals)tiny) : (reals)1.0) * upwards;
        g.by.x = p.x < 0.0 ? -g.by.x : g.by.x;
        g.by.y = p.y < 0.0 ? -g.by.y : g.by.y;
        g.by.z = p.z < 0.0 ? -g.by.z : g.by.z;
        g.value = most * f;
        return g;
    };

    // `straighten`, `taper_and_bend` and `deformed_gradient` without a bend.
    struct sections { reals x, y; flags sloping_x, sloping_y; };
    auto sections_at = [&](reals z) {
        const reals height = less(more(z * upwards, (reals)-1.0), (reals)1.0);
        const reals x = s.kx * height + 1.0, y = s.ky * height + 1.0;
        const flags within = size_of(z) <= s.size[2];
        return sections{more(x, (reals)thin), more(y, (reals)thin),
                        (x >= thin) & within, (y >= thin) & within};
    };
    auto untapered = [&](places p) {
        const sections at = sections_at(p.z);
        return places{p.x / at.x, p.y / at.y, p.z};
    };
    auto tapered = [&](places p) {
        const sections at = sections_at(p.z);
        return places{p.x * at.x, p.y * at.y, p.z};
    };
    auto tapered_slopes = [&](places by, places p) {
        const sections at = sections_at(p.z);
        const reals x = 1.0 / at.x, y = 1.0 / at.y;
        places g = {by.x * x, by.y * y, by.z};
        g.z -= at.sloping_x ? g.x * p.x * x * (s.kx * upwards) : (reals)0.0;
        g.z -= at.sloping_y ? g.y * p.y * y * (s.ky * upwards) : (reals)0.0;
        return g;
    };
"""
_LOGARITHM = _polynomial("tt", [2.0 / ((2 * k + 1) * log(2.0)) for k in range(_TERMS_LOGARITHM)])
_EXPONENTIAL = _polynomial("r", [log(2.0) ** k / factorial(k) for k in range(_TERMS_EXPONENTIAL)])
for _name, _text in (("LANES", str(LANES)), ("LOGARITHM", _LOGARITHM),
                     ("EXPONENTIAL", _EXPONENTIAL)):
    SUPERQUADRIC_LANES = SUPERQUADRIC_LANES.replace(_name, _text)
