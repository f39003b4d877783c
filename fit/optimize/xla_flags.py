"""How XLA is to compile, said in its environment variable before JAX first asks for a device."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp

_EXTRA = "--xla_backend_extra_options="
OPTIONS = f"{_EXTRA}xla_cpu_use_multi_output_fusion"
"""Kernels that answer several things at once: what these share is worked out once, and programs
are half as large, so they load in half the time."""
_THREADS = "--xla_cpu_multi_thread_eigen="
ONE_THREAD = f"{_THREADS}false"
"""Groups of lanes are too small to divide; so programs are the same in commands and workers, and
on whatever number of cores they were compiled."""


def ask_for_options() -> None:
    """Adds `OPTIONS` and `ONE_THREAD` to XLA_FLAGS, each unless the user gave his own."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    if not any(flag.startswith(_EXTRA) for flag in flags):
        flags.insert(0, OPTIONS)
    if not any(flag.startswith(_THREADS) for flag in flags):
        flags.append(ONE_THREAD)
    os.environ["XLA_FLAGS"] = " ".join(flags)


@lru_cache(maxsize=1)
def in_force() -> bool:
    """Whether XLA compiles by XLA_FLAGS: not where JAX asked for a device before.

    Seen by what it makes of two functions that share a sine: as jaxlib 0.10 writes its programs,
    one kernel then holds one. Written otherwise, programs would be taken for unfused and not kept.
    """
    if OPTIONS not in os.environ.get("XLA_FLAGS", ""):
        return True
    two = jax.jit(lambda x: (jnp.sin(x) + 1.0, jnp.sin(x) * 2.0))
    text = two.lower(jax.ShapeDtypeStruct((64,), "float32")).compile().as_text()
    return text is not None and text.count(" sine(") == 1


def storing(places) -> Callable:
    """A function that gives its argument back, bit for bit, stored; `places` are any finite
    numbers of the computation, of the argument's shape and not one number for all: by such a one
    it would multiply instead."""
    one = jnp.sign(1.0 + places * places)
    return lambda value: value / one
