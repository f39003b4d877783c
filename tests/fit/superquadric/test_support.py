"""The reach of tapered and bent bodies against their sampled surface and against differences."""

import jax
import jax.numpy as jnp
import numpy as np

from fit.rotation import matrix_of_quaternion
from fit.superquadric.field import Shape
from fit.superquadric.geometry import superquadric, superquadric_surface
from fit.superquadric.support import support

N, DOWN = 24, np.array([0.0, 0.0, -1.0])


def test_support_is_the_highest_point_and_its_slopes_are_exact() -> None:
    rng = np.random.default_rng(0)
    q = rng.normal(size=(N, 4))
    q[::3] = [0.003, 0.002, 0.0, 1.0]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    bend = np.stack([np.tile([0.0, 0.4], N // 2), rng.uniform(-3.0, 3.0, N)], axis=1)
    vector = bend[:, :1] * np.stack([np.cos(bend[:, 1]), np.sin(bend[:, 1])], axis=1)
    numbers = [rng.uniform(0.3, 1.0, (N, 3)), rng.uniform(0.1, 1.2, (N, 2)),
               rng.uniform(-1.0, 1.0, (N, 2)), vector]
    turn, step = matrix_of_quaternion(q), 1e-6

    def reach(flat, rotation):
        size, exponents, taper, bent = jnp.split(flat, [3, 5, 7])
        return support(Shape(size, exponents, taper, bent), rotation.T @ DOWN)

    flat = np.concatenate(numbers, axis=1)
    with jax.enable_x64(True):
        at = jax.jit(jax.vmap(jax.value_and_grad(reach)))
        value, slopes = jax.device_get(at(flat, turn))
        for k in range(9):
            up, down = (at(flat + s * step * np.eye(9)[k], turn)[0] for s in (1, -1))
            assert np.allclose((up - down) / (2 * step), slopes[:, k], atol=1e-5)
    body = superquadric(*numbers[:2], [[0.0, 0.0, 0.0]], q, numbers[2], bend)
    sampled = (superquadric_surface(body, 6000)[0] @ DOWN).max(axis=1)
    assert (value > sampled - 1e-6).all()
    assert np.allclose(value, sampled, atol=4e-3)
