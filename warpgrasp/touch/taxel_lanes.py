# type: ignore  # Warp functions, which type checkers cannot follow
"""The counts of unloaded taxels side by side (`core.lanes`): what noise alone reads.

Of the 256 taxels of an image few are pressed, and each takes a logarithm and a cosine.
"""

from math import factorial, log, pi

import warp as wp

from warpgrasp.core.dtypes import real
from warpgrasp.core.lanes import lanes_begin, polynomial
from warpgrasp.core.random import Purpose

TAXELS_AT_ONCE = 32
_TERMS = 9
"""Of the series of sine and cosine, to an eighth of a turn: the first left out is 1e-18."""

_COUNTS = lanes_begin(TAXELS_AT_ONCE) + """
    typedef wp::uint64 keys __attribute__((ext_vector_type(L)));
    // `counter_key`, `counter_uniform`
    auto hashed = [](keys key, keys counter) {
        keys z = (key ^ counter) + 0x9E3779B97F4A7C15ull;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
        return z ^ (z >> 31);
    };
    auto uniform = [](keys key) {
        return __builtin_convertvector(key >> 11, reals) * 0x1p-53 + 0x1p-54; };
    keys taxel;
    for (int l = 0; l < L; ++l)
        taxel[l] = first + l;
    const keys own = hashed(hashed((keys)reading, taxel), (keys)1ull);
    // `counter_normal`
    const reals far = root(binary_logarithm(uniform(hashed(own, (keys)1ull))) * LESS);
    const reals quarters = uniform(hashed(own, (keys)2ull)) * 4.0;
    const reals whole = __builtin_elementwise_floor(quarters + 0.5);
    const reals r = (quarters - whole) * QUARTER, rr = r * r;
    const reals sine = r * SINE, cosine = COSINE;
    // Turns of 0 to 4 quarters: cosine, -sine, -cosine, sine, cosine.
    const reals level = noise * far * (
        whole == 1.0 ? -sine : whole == 2.0 ? -cosine : whole == 3.0 ? sine : cosine) + 0.5;
    const reals count = __builtin_elementwise_floor(level);
    const flags dead = uniform(hashed(hashed((keys)pad, taxel), (keys)DEADull)) < dead_share;
    const reals level_read = count > 0.0 ? (dead ? (reals)0.0 : count) : (reals)0.0;
    typedef wp::uint8 bytes __attribute__((ext_vector_type(L)));
    const bytes read = __builtin_convertvector(
        __builtin_convertvector(level_read, flags), bytes);
    __builtin_memcpy(image.data + (size_t)row * image.shape[1] * image.shape[2] + first, &read, L);
    // Rounding, that of this series or of the library's, must not decide.
    const flags sure = (size_of(level - __builtin_elementwise_floor(level + 0.5)) > 1e-9)
                       & (count < 255.5);
    return __builtin_reduce_and(sure) != 0;
#else
    return false;
#endif
"""
for _name, _text in (
        ("LESS", repr(-2.0 * log(2.0))), ("QUARTER", repr(pi / 2.0)),
        ("DEAD", str(int(Purpose.PAD_DEAD))),
        ("COSINE", polynomial("rr", [(-1) ** k / factorial(2 * k) for k in range(_TERMS)])),
        ("SINE", polynomial("rr", [(-1) ** k / factorial(2 * k + 1) for k in range(_TERMS)]))):
    _COUNTS = _COUNTS.replace(_name, _text)


@wp.func_native(_COUNTS)
def read_unloaded(
    noise: real, dead_share: real, pad: wp.uint64, reading: wp.uint64, first: int,
    image: wp.array3d[wp.uint8], row: int
) -> bool:
    """Write counts of taxels `first` on into row `row` of `image`; whether all are certain, which
    they are not on a GPU.

    `pad` is `pad_key`, of which a taxel's is made, `reading` `pad_reading_key`.
    """


_GREATEST = """
    const wp::uint8* counts = image.data + (size_t)row * image.shape[1] * image.shape[2];
    const int taxels = image.shape[1] * image.shape[2];
    int greatest = 0;
#if !defined(__CUDA_ARCH__)
    typedef wp::uint8 bytes __attribute__((ext_vector_type(32), aligned(1)));
    for (int k = 0; k < taxels; k += 32)
        greatest = wp::max(greatest, (int)__builtin_reduce_max(*(const bytes*)(counts + k)));
#else
    for (int k = 0; k < taxels; ++k)
        greatest = wp::max(greatest, (int)counts[k]);
#endif
    return greatest;
"""


@wp.func_native(_GREATEST)
def greatest_count(image: wp.array3d[wp.uint8], row: int) -> int:
    """The greatest count of an image, whose taxels are a multiple of 32."""
