"""XLA compiler flags, set in the environment before JAX first asks for a device.

JAX is imported where it is used: who runs a sweep reads the flags and does without it.
"""

import os
from collections.abc import Callable
from functools import lru_cache

_EXTRA = "--xla_backend_extra_options="
OPTIONS = f"{_EXTRA}xla_cpu_use_multi_output_fusion"
"""Fuse kernels with several outputs: shared values are computed once and programs are half as
large, so they load in half the time."""
_THREADS = "--xla_cpu_multi_thread_eigen="
ONE_THREAD = f"{_THREADS}false"
"""Groups of lanes are too small to divide among threads; and without threads compiled programs do
not depend on the number of cores."""


def set_xla_flags() -> None:
    """Add `OPTIONS` and `ONE_THREAD` to XLA_FLAGS, each unless the user set that flag."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    if not any(flag.startswith(_EXTRA) for flag in flags):
        flags.insert(0, OPTIONS)
    if not any(flag.startswith(_THREADS) for flag in flags):
        flags.append(ONE_THREAD)
    os.environ["XLA_FLAGS"] = " ".join(flags)


@lru_cache(maxsize=1)
def xla_flags_active() -> bool:
    """Whether XLA uses XLA_FLAGS; it does not if JAX asked for a device before they were set.

    Tested by compiling two functions that share a sine: fused, the program text (of jaxlib 0.10)
    contains one sine. In another text format, programs would not be cached.
    """
    if OPTIONS not in os.environ.get("XLA_FLAGS", ""):
        return True
    import jax
    import jax.numpy as jnp

    two = jax.jit(lambda x: (jnp.sin(x) + 1.0, jnp.sin(x) * 2.0))
    text = two.lower(jax.ShapeDtypeStruct((64,), "float32")).compile().as_text()
    return text is not None and text.count(" sine(") == 1


def force_materialize(places) -> Callable:
    """A function that returns its argument unchanged but makes XLA materialize it.

    It divides by ones that XLA cannot simplify away. `places` are any finite values of the
    computation with the argument's shape; a scalar would not do, because XLA turns a division by a
    broadcast scalar into a multiplication.
    """
    import jax.numpy as jnp

    one = jnp.sign(1.0 + places * places)
    return lambda value: value / one
