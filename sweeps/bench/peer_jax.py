"""The peers' closing written for JAX: every command in a scan, a fixed number of Newton steps.

One finger and one upright cylinder on a table; the same energy and the same stop. The nearest point
of a link is found by halving its bracket; derivatives are JAX's own.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from sweeps.bench.peer_closing import (
    COMMANDS_RAD,
    COUNT,
    HAND,
    HAND_POSE,
    HEIGHT_M,
    RADIUS_M,
    THRESHOLD_N,
)

_HALVINGS, _NEWTON = 24, 6


def _distance(p):
    rho = jnp.sqrt(p[0] ** 2 + p[1] ** 2 + 1e-24)
    a, b = rho - RADIUS_M, jnp.abs(p[2] - HEIGHT_M / 2) - HEIGHT_M / 2
    outside = jnp.sqrt(jnp.maximum(a, 0) ** 2 + jnp.maximum(b, 0) ** 2 + 1e-24)
    return jnp.where((a > 0) | (b > 0), outside, jnp.maximum(a, b))


def _clearance(a, u, length):
    slope = jax.grad(lambda t: _distance(a + t * u))

    def halve(_, bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        rises = slope(middle) > 0
        return jnp.where(rises, low, middle), jnp.where(rises, middle, high)

    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, (0.0, length))
    t = jax.lax.stop_gradient(0.5 * (low + high))
    return _distance(a + t * u) - HAND.link_radius_m


def _clearances(q, origin, side, palm):
    z = jnp.array([0.0, 0.0, -1.0])
    along = z * jnp.cos(q[0]) + side * jnp.sin(q[0])
    p, angle, free = origin + along * HAND.abduction_offset_m, 0.0, []
    for link, length in enumerate(HAND.link_length_m):
        angle = angle + q[link + 1]
        u = palm * jnp.sin(angle) + along * jnp.cos(angle)
        free.append(_clearance(p, u, length))
        p = p + u * length
    return jnp.stack(free)


def _rest(start, command, origin, side, palm):
    def newton(_, q):
        free = _clearances(q, origin, side, palm)
        slope = jax.jacfwd(_clearances)(q, origin, side, palm)
        depth = jnp.maximum(-free, 0.0)
        pressed = (depth > 0)[:, None] * slope
        g = -HAND.joint_stiffness_Nm_rad * (command - q) - HAND.skin_stiffness_N_m * depth @ pressed
        h = HAND.joint_stiffness_Nm_rad * jnp.eye(4) + HAND.skin_stiffness_N_m * (
            pressed.T @ pressed)
        return q - jnp.linalg.solve(h, g)

    return jax.lax.fori_loop(0, _NEWTON, newton, start)


def _close(origin, side, palm, commands):
    arm = jnp.asarray(HAND.moment_arm_m[1:])

    def step(state, s):
        q, stop = state
        command = commands[s]
        delta = command - commands[jnp.maximum(s - 1, 0)]
        q = _rest(q + delta, command, origin, side, palm)
        pull = HAND.joint_stiffness_Nm_rad * (command - q)[1:] / arm
        slack = jnp.maximum(HAND.co_contraction_N - jnp.abs(pull) / 2, HAND.tension_low_N)
        rub = HAND.tendon_friction * jnp.where(jnp.abs(delta[1:]) > 1e-12, jnp.sign(delta[1:]), 0)
        read = ((slack + jnp.maximum(pull, 0.0)) * (1 + rub)
                - (slack - jnp.minimum(pull, 0.0)) * (1 - rub))
        touches = jnp.abs(command - q).max() > 1e-9
        past = touches & (jnp.abs(read).max() > THRESHOLD_N)
        return (q, jnp.where((stop < 0) & past, s, stop)), None

    (_, stop), _ = jax.lax.scan(step, (commands[0], -1), jnp.arange(COUNT))
    return jnp.where(stop < 0, COUNT - 1, stop)


def jax_closings(batch: int) -> tuple[Callable[[], int], Callable[[], np.ndarray]]:
    """`batch` hands: a call that closes them, and the steps of one's stops, (4,)."""
    place = np.array([[-HAND.palm_gap_m / 2, -HAND.finger_spacing_m * (f - 1), HAND_POSE[2]]
                      for f in range(3)] + [[HAND.palm_gap_m / 2, 0.0, HAND_POSE[2]]])
    side = np.array([[0.0, -1.0, 0.0]] * 3 + [[0.0, 1.0, 0.0]])
    palm = np.array([[1.0, 0.0, 0.0]] * 3 + [[-1.0, 0.0, 0.0]])
    lanes = [np.tile(a, (batch, *[1] * (a.ndim - 1))) for a in (place, side, palm, COMMANDS_RAD[0])]
    close = jax.jit(jax.vmap(_close))

    def call() -> int:
        with jax.enable_x64(True):
            np.asarray(close(*lanes))
        return 4 * batch

    def one() -> np.ndarray:
        with jax.enable_x64(True):
            return np.asarray(close(*[lane[:4] for lane in lanes]))

    return call, one
