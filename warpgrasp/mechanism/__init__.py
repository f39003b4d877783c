"""The robot: PUMA 560 arm, Utah-MIT hand, tendons; kinematics, motion, clearances."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "arm_motion": ["ArmMoves", "ArmState", "HOME_RAD", "arm_hand_links", "mount_error",
        "move_hand"],
    "arm_motion_kernel": ["RETREAT_M"],
    "arm_reach": ["hand_reachable", "travel_time"],
    "hand_clearance": ["finger_clearance", "palm_clearance"],
    "puma560": ["ALPHA_RAD", "arm_of", "puma_forward_batch", "puma_inverse_batch"],
    "puma560_kernel": ["Arm", "move_time", "puma_forward", "puma_reach"],
    "tendon": ["tendon_sensor_of"],
    "tendon_kernel": ["TendonSensor", "moving_sign", "tendon_tensions", "tension_difference_read",
        "tension_mean_read", "tension_noise", "torque_from_tensions"],
    "utah_mit_hand": ["FINGER_COUNT", "LINK_COUNT", "hand_links", "hand_of"],
    "utah_mit_hand_kernel": ["FingerPose", "Hand", "finger_base", "finger_jacobian",
        "finger_length", "finger_pose", "fingertip_point", "link_direction", "link_start"],
})
