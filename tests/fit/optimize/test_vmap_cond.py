"""Work is left out only where that changes nothing, lane by lane."""

import jax
import jax.numpy as jnp
import numpy as np

from fit.optimize.batch import vmap_cond


def _weighted(weight, points):
    return vmap_cond(lambda w, p: {"sum": (w * p).sum(), "all": w * p}, jnp.any(weight > 0),
                     weight, points)


def test_lanes_in_need_and_others_give_what_the_function_gives() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(4, 5))
    for needy in ([], [1], [0, 1, 2, 3]):
        weight = np.zeros((4, 5))
        weight[needy] = rng.uniform(1.0, 2.0, (len(needy), 5))
        found = jax.jit(jax.vmap(_weighted))(weight, points)
        np.testing.assert_allclose(found["all"], (weight * points).astype(np.float32), rtol=1e-6)
        np.testing.assert_allclose(found["sum"], (weight * points).sum(1), rtol=1e-5, atol=1e-6)


def test_a_group_without_need_does_not_run_the_function() -> None:
    runs = []

    def counted(x):
        jax.debug.callback(lambda: runs.append(1))
        return x

    lanes = jax.jit(jax.vmap(lambda needed, x: vmap_cond(counted, needed, x)))
    jax.block_until_ready(lanes(np.zeros(3, bool), np.zeros(3)))
    assert not runs
    jax.block_until_ready(lanes(np.array([False, True, False]), np.zeros(3)))
    assert runs
