"""Random numbers from counters: (seed, episode, probe, ...) in, the same number out, anywhere.

Nothing is carried from draw to draw, so results do not depend on batch, slicing or order. The hash
chains the finaliser of SplitMix64 (Steele, Lea, Flood 2014, Fast splittable pseudorandom number
generators) over the counters. These functions are for NumPy; `random_kernel` has the same for
kernels.
"""

from enum import IntEnum

import numpy as np

from warpgrasp.core.random_kernel import _GAMMA


class Purpose(IntEnum):
    """What a stream is for; part of the key, so that no two uses share numbers."""

    PLACEMENT = 1
    PRIOR = 2
    MOUNT = 3
    ARM = 4
    # 5 is free. Numbers stay: another number gives a use other random numbers.
    TENSION_STEP = 6
    TENSION_REST = 7
    JOINT = 8
    WAYPOINT = 9
    STRATEGY = 10
    PAD_GAIN = 11
    PAD_DEAD = 12
    PAD_READING = 13
    PAD_FALSE = 14
    PAD_JOINT = 15
    LINE_ARM = 16
    CAMERA = 17
    NOISE_STREAM = 18
    OBJECT = 19
    CALIBRATION = 20
    CLOSING = 21


def counter_key(key: np.ndarray | int, *counters: np.ndarray | int) -> np.ndarray:
    """`counter_key` over several counters, broadcast, uint64.

    Raises TypeError for what is no whole number, ValueError for a negative or too large `key`.
    """
    for name, value in (("key", key), *(("counter", counter) for counter in counters)):
        array = np.asarray(value)
        if array.size and array.dtype.kind not in "biuO":
            raise TypeError(f"{name}: is {array.dtype}; should be whole numbers")
    try:
        z = np.asarray(key)
        if z.dtype.kind in "iO" and (z < 0).any():  # NumPy would turn an array's around
            raise OverflowError
        z = z.astype(np.uint64)
    except OverflowError:
        raise ValueError(f"key: is {key!s:.80}; should be from 0 to 2^64 - 1") from None
    with np.errstate(over="ignore"):
        for counter in counters:
            z = (z ^ np.asarray(counter).astype(np.int64).astype(np.uint64)) + np.uint64(_GAMMA)
            z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            z = z ^ (z >> np.uint64(31))
    return z


def counter_uniform(key: np.ndarray) -> np.ndarray:
    """Uniform in (0, 1) for each key."""
    return (key >> np.uint64(11)).astype(float) * 2.0**-53 + 2.0**-54


def counter_normal(key: np.ndarray) -> np.ndarray:
    """Standard normal for each key."""
    u = counter_uniform(counter_key(key, 1))
    v = counter_uniform(counter_key(key, 2))
    return np.sqrt(-2.0 * np.log(u)) * np.cos(2.0 * np.pi * v)


def normal_vector(key: np.ndarray, size: int) -> np.ndarray:
    """`size` standard normals for each key, shape (*key.shape, size)."""
    return counter_normal(counter_key(key[..., None], np.arange(size) + 16))
