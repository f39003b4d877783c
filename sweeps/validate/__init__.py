"""Comparisons with other engines: MuJoCo, roboticstoolbox, trimesh, SciPy."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "command": ["validate"],
    "comparison": ["engine"],
    "mujoco_hand": ["MujocoHand"],
})
