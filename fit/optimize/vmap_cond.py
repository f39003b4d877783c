"""Work left out for a group of lanes where none of them needs it: a condition that survives vmap.

vmap turns `lax.cond` of a lane's own condition into both branches and a choice. Where the answer
is zero for every lane that does not need it, one condition for the group gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap


def where_any(function: Callable, needed: Any, *arguments: Any) -> Any:
    """`function(*arguments)`, worked out only if `needed` in any lane; else zeros.

    In a lane where it is not needed it must be zero anyway. Not to be differentiated.
    """

    def choose(needed, work, *arguments):
        shapes = jax.eval_shape(work, *arguments)
        nothing = lambda *_: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)  # noqa: E731
        return jax.lax.cond(needed, work, nothing, *arguments)

    @custom_vmap
    def chosen(needed, *arguments):
        return choose(needed, function, *arguments)

    @chosen.def_vmap
    def _of_lanes(lanes, batched, needed, *arguments):
        work = jax.vmap(function, in_axes=tuple(jax.tree.map(
            lambda b: 0 if b else None, batched[1:])), axis_size=lanes)
        out = choose(jnp.any(needed), work, *arguments)
        return out, jax.tree.map(lambda _: True, out)

    return chosen(needed, *arguments)
