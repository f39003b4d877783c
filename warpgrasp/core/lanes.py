"""Several numbers side by side: C++ for Clang, which compiles Warp's kernels for CPUs.

`lanes_begin` begins the body of a `wp.func_native` and `#endif` ends it: on a GPU, whose threads
are side by side already, the body is empty. A logarithm is a series of its own, since a library
takes one number at a time.
"""

from math import log

LANES = 8
"""As many doubles as a vector of AVX-512 holds; others take two or four vectors."""
_TERMS_LOGARITHM = 11
"""Of the series of log((1 + t) / (1 - t)), |t| up to 0.1716: the first left out is 1e-18."""


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
"""
_LOGARITHM = polynomial("tt", [2.0 / ((2 * k + 1) * log(2.0)) for k in range(_TERMS_LOGARITHM)])


def lanes_begin(count: int = LANES) -> str:
    """Types and functions of `count` lanes; more than a vector holds overlap their waiting."""
    return _BEGIN.replace("COUNT", str(count)).replace("LOGARITHM", _LOGARITHM)
