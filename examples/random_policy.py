"""A policy that touches anywhere, in sixteen worlds at once: the floor that learning must clear.

Run it with `python examples/random_policy.py` (needs the extra: pip install '.[gym]').
"""

import gymnasium
import numpy as np

import sweeps.gym  # noqa: F401  registers warpgrasp/Grasp-v0


def main(num_envs: int = 16, probes: int = 8) -> float:
    """One episode in every world; the mean error left [mm] comes back."""
    worlds = gymnasium.make_vec("warpgrasp/Grasp-v0", num_envs=num_envs, objects="block",
                                probes=probes)
    worlds.action_space.seed(1)
    _, info = worlds.reset(seed=1)
    print(f"prior: {info['chamfer_mm'].mean():.2f} mm")
    over = np.zeros(num_envs, bool)
    while not over.all():
        _, reward, _, over, info = worlds.step(worlds.action_space.sample())
        print(f"reward {reward.mean():+.2f} mm, left {info['chamfer_mm'].mean():.2f} mm")
    worlds.close()
    return float(info["chamfer_mm"].mean())


if __name__ == "__main__":
    main()
