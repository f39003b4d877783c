"""The soft maximum of two numbers, elementwise, in JAX: what a superquadric is made of."""

from __future__ import annotations

import jax
import jax.numpy as jnp


@jax.custom_vjp
def soft_maximum(a, b, heat):
    """heat log(exp(a/heat) + exp(b/heat)), elementwise."""
    return soft_maximum_parts(a, b, heat)[0]


def soft_maximum_parts(a, b, heat):
    """The soft maximum, the weight of a, (a - b)/heat, the product of the two weights, and their
    entropy. The weights are the slopes along a and b, the entropy is that along the heat."""
    gap = (a - b) / heat
    decay = jnp.exp(-jnp.abs(gap))
    spill = jnp.log1p(decay)
    larger = 1.0 / (1.0 + decay)
    weight = jnp.where(gap > 0.0, larger, 1.0 - larger)
    entropy = spill + jnp.abs(gap) * (1.0 - larger)
    return jnp.maximum(a, b) + heat * spill, weight, gap, decay * larger**2, entropy


def _forward(a, b, heat):
    value, weight, _, _, entropy = soft_maximum_parts(a, b, heat)
    return value, (weight, entropy)


def _backward(kept, cotangent):
    weight, entropy = kept
    return cotangent * weight, cotangent * (1.0 - weight), cotangent * entropy


soft_maximum.defvjp(_forward, _backward)
