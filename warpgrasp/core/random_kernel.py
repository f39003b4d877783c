# type: ignore  # Warp functions, which type checkers cannot follow
"""Random numbers from counters, in kernels: the same as those of `random` on the host."""

import warp as wp

from warpgrasp.core.dtypes import TWO, TWO_PI, real
from warpgrasp.core.turns import sine_cosine

_GAMMA = 0x9E3779B97F4A7C15
_GAMMA_W = wp.constant(wp.uint64(_GAMMA))
_M1 = wp.constant(wp.uint64(0xBF58476D1CE4E5B9))
_M2 = wp.constant(wp.uint64(0x94D049BB133111EB))
_S30 = wp.constant(wp.uint64(30))
_S27 = wp.constant(wp.uint64(27))
_S31 = wp.constant(wp.uint64(31))
_S11 = wp.constant(wp.uint64(11))
_QUARTER_TURN, _HALF_TURN = wp.constant(wp.uint64(1 << 62)), wp.constant(wp.uint64(1 << 63))
_TO_UNIT = wp.constant(real(2.0**-53))
_HALF_UNIT = wp.constant(real(2.0**-54))


@wp.func
def counter_key(key: wp.uint64, counter: int):
    """The key of a sub-stream: one more counter hashed into `key`."""
    z = (key ^ wp.uint64(counter)) + _GAMMA_W
    z = (z ^ (z >> _S30)) * _M1
    z = (z ^ (z >> _S27)) * _M2
    return z ^ (z >> _S31)


@wp.func
def counter_uniform(key: wp.uint64):
    """Uniform in (0, 1), never 0 or 1."""
    return real(key >> _S11) * _TO_UNIT + _HALF_UNIT


@wp.func
def counter_normal(key: wp.uint64):
    """Standard normal (Box-Muller, one of the pair)."""
    u = counter_uniform(counter_key(key, 1))
    v = counter_uniform(counter_key(key, 2))
    return wp.sqrt(-TWO * wp.log(u)) * sine_cosine(TWO_PI * v)[1]


@wp.func
def counter_normal_is_negative(key: wp.uint64):
    """Whether `counter_normal` is negative: its angle lies in the second or third quarter."""
    return counter_key(key, 2) + _QUARTER_TURN >= _HALF_TURN
