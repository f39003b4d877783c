"""The soft maximum of two numbers, elementwise, in JAX: what a superquadric is made of."""

from __future__ import annotations

import jax
import jax.numpy as jnp


@jax.custom_vjp
def soft_maximum(a, b, heat):
    """heat log(exp(a/heat) + exp(b/heat)), and the weight of a, elementwise."""
    return soft_maximum_parts(a, b, heat)[:2]


def soft_maximum_parts(a, b, heat):
    """The soft maximum, the weight of a, (a - b)/heat, the product of the two weights, and their
    entropy, which is the slope along the heat."""
    gap = (a - b) / heat
    decay = jnp.exp(-jnp.abs(gap))
    spill = jnp.log1p(decay)
    larger = 1.0 / (1.0 + decay)
    weight = jnp.where(gap > 0.0, larger, 1.0 - larger)
    entropy = spill + jnp.abs(gap) * (1.0 - larger)
    return jnp.maximum(a, b) + heat * spill, weight, gap, decay * larger**2, entropy


def _forward(a, b, heat):
    value, weight, gap, spread, entropy = soft_maximum_parts(a, b, heat)
    return (value, weight), (weight, gap, spread / heat, entropy)


def _backward(kept, cotangents):
    weight, gap, spread, entropy = kept
    of_value, of_weight = cotangents
    steep = of_weight * spread
    return (of_value * weight + steep, of_value * (1.0 - weight) - steep,
            of_value * entropy - steep * gap)


soft_maximum.defvjp(_forward, _backward)
