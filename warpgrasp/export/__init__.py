"""The robot and its object as files for other simulators: MJCF and URDF."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "convex_solids": ["Solid", "hull_excess", "object_solids"],
    "mjcf": ["mjcf_text"],
    "model_tree": ["arm_model_tree", "hand_model_tree"],
    "robot_tree": ["DENSITY_KG_M3", "FINGERS", "PHALANGES", "STILL", "arm_hand_tree", "hand_tree"],
    "urdf": ["urdf_text"],
})
