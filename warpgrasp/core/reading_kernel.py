# type: ignore  # Warp functions, which type checkers cannot follow
"""What a sensor reads, in kernels: with noise, in steps of its converter, once or in the mean."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, real
from warpgrasp.core.random_kernel import counter_key, counter_normal


@wp.func
def quantised(value: real, step: real):
    """The nearest number of steps; as it is, without steps."""
    if step <= ZERO:
        return value
    return step * wp.floor(value / step + HALF)


@wp.func
def averages_out(noise: real, step: real):
    """Whether noise of this deviation makes quantisation independent from reading to reading
    (dither; Gray and Stockham 1993). With less, all readings are off alike."""
    return noise >= HALF * step


@wp.func
def mean_variance(noise: real, step: real, readings: int):
    """Of the mean of some readings about the true value; that of quantisation is step^2 / 12."""
    spread = step * step / real(12.0)
    if averages_out(noise, step):
        return (noise * noise + spread) / real(readings)
    return noise * noise / real(readings) + spread


@wp.func
def mean_read(value: real, noise: real, step: real, readings: int, key: wp.uint64):
    """Mean of some readings of one value. Where quantisation averages out it enters as its
    variance; else each reading is drawn."""
    if averages_out(noise, step):
        return value + wp.sqrt(mean_variance(noise, step, readings)) * counter_normal(key)
    total = real(0.0)
    for n in range(readings):
        total += quantised(value + noise * counter_normal(counter_key(key, n)), step)
    return total / real(readings)
