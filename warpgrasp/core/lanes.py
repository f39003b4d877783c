"""Several numbers side by side: C++ for Clang, which compiles Warp's kernels for CPUs.

`lanes_begin` begins the body of a `wp.func_native` and `#endif` ends it: on a GPU, whose threads
are side by side already, the body is empty. Logarithm and exponential are series of their own,
since a library takes one number at a time.
"""

from math import factorial, log

import warp as wp

LANES = 8
"""As many doubles as a vector of AVX-512 holds; others take two or four vectors."""
_TERMS_LOGARITHM = 11
"""Of the series of log((1 + t) / (1 - t)), |t| up to 0.1716: the first left out is 1e-18."""
_TERMS_EXPONENTIAL = 14
"""Of 2^r, |r| up to a half: the first left out is 4e-18."""


def has_lanes(device: str) -> bool:
    """Whether kernels on a device have vectors; those of others go one by one."""
    return wp.get_device(device).is_cpu


def polynomial(by: str, coefficients: list[float]) -> str:
    """A polynomial, lowest power first, as sums of pairs, of pairs of pairs and so on (Estrin
    1960): no product waits for more than four others."""
    terms, power = [f"{c!r}" for c in coefficients], by
    while len(terms) > 1:
        pairs = [" + ".join([low, *(f"{power} * {high}" for high in above)])
                 for low, *above in (terms[n:n + 2] for n in range(0, len(terms), 2))]
        terms = [f"({pair})" for pair in pairs]
        power = f"({power} * {power})"
    return terms[0]


_BEGIN = """
#if !defined(__CUDA_ARCH__)
    enum { L = COUNT };
    typedef double reals __attribute__((ext_vector_type(L)));
    typedef double anywhere __attribute__((ext_vector_type(L), aligned(8)));  // in an array
    typedef decltype(reals() < reals()) flags;  // 0, or all bits of 64
    auto bits = [](reals x) { return __builtin_bit_cast(flags, x); };
    auto real_of = [](flags x) { return __builtin_bit_cast(reals, x); };
    auto less = [](reals a, reals b) { return a < b ? a : b; };
    auto more = [](reals a, reals b) { return a > b ? a : b; };
    auto size_of = [](reals a) { return a < 0.0 ? -a : a; };
    auto root = [](reals a) { return __builtin_elementwise_sqrt(a); };
    auto binary_logarithm = [&](reals positive) {
        const flags held = bits(positive);
        reals c = real_of((held & 0xfffffffffffffLL) | 0x3ff0000000000000LL);
        const flags wide = c > 1.4142135623730951;
        c = wide ? c * 0.5 : c;
        const reals t = (c - 1.0) / (c + 1.0), tt = t * t;
        return __builtin_convertvector((held >> 52) - 1023 - wide, reals) + t * LOGARITHM;
    };
    auto power_of_two = [&](reals y) {  // from -1022 to 1023
        const double shift = 6755399441055744.0;  // leaves whole numbers in the last bits
        const reals n = y + shift, r = y - (n - shift);
        return real_of(bits(EXPONENTIAL) + (bits(n) << 52));
    };
    struct places { reals x, y, z; };
    auto dot = [](places a, places b) { return a.x * b.x + a.y * b.y + a.z * b.z; };
    auto cross = [](places a, places b) {
        return places{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; };
    auto from_to = [](places a, places b) { return places{b.x - a.x, b.y - a.y, b.z - a.z}; };
    auto along = [](places a, reals t, places b) {
        return places{a.x + t * b.x, a.y + t * b.y, a.z + t * b.z}; };
    auto everywhere = [](const wp::vec3d& a) {
        return places{(reals)a[0], (reals)a[1], (reals)a[2]}; };
"""
_LOGARITHM = polynomial("tt", [2.0 / ((2 * k + 1) * log(2.0)) for k in range(_TERMS_LOGARITHM)])
_EXPONENTIAL = polynomial("r", [log(2.0) ** k / factorial(k) for k in range(_TERMS_EXPONENTIAL)])


def lanes_begin(count: int = LANES) -> str:
    """Types and functions of `count` lanes; more than a vector holds overlap their waiting."""
    return _BEGIN.replace("COUNT", str(count)).replace("LOGARITHM", _LOGARITHM).replace(
        "EXPONENTIAL", _EXPONENTIAL)
