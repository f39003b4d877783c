"""Arms as data: serial chains of up to seven revolute joints, from a TOML file or a URDF, and their
kinematics in kernels."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "arm_column": ["in_column"],
    "arm_file": ["SHIPPED_ARMS", "arm_from_file", "arm_named", "arm_text"],
    "arm_model": ["ARM_JOINTS", "ArmError", "ArmJoint", "ArmModel"],
    "serial_arm": ["arm_reach_m", "flange_poses", "joint_choices", "nearest_joints", "padded",
        "serial_of", "serial_places"],
    "urdf_arm": ["arm_from_urdf"],
})
