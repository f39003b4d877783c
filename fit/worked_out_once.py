"""Keeps XLA's CPU compiler from working a shared value out again for each of its users.

It fuses sums and products into every fusion that reads them, however long the chain behind them
(optimization_barrier is gone by then), but never a division: that is dear, so it is stored. A
division by a one that it cannot see to be one costs two cycles a number, a fifth of what it saves.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp


def storing(places) -> Callable:
    """A function that gives its argument back, bit for bit, stored; `places` are any finite
    numbers of the computation, of the argument's shape and not one number for all: by such a one
    it would multiply instead."""
    one = jnp.sign(1.0 + places * places)
    return lambda value: value / one
