"""The robot: PUMA 560 arm, Utah-MIT hand, tendons; kinematics, motion, clearances."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "arm": ["arm_home", "arm_of", "floating_joints", "is_floating",
        "serial_model"],
    "arm_motion": ["ArmMoves", "ArmState", "Clearance", "ClearanceKernel", "arm_hand_links",
        "move_hand"],
    "arm_reach": ["hand_reachable", "nearest_reachable", "pose_reachable", "travel_time"],
    "calibration": ["Calibration", "arm_variance", "draw_calibration", "no_errors",
        "place_variance", "true_arms", "true_hands", "true_tendons"],
    "hand_clearance": ["finger_clearance", "palm_clearance", "segment_clearance"],
    "puma560": ["ALPHA_RAD", "HOME_RAD", "home_misfit", "puma_forward_batch",
        "puma_inverse_batch", "puma_misfit"],
    "tendon": ["tendon_sensor_of"],
    "touch_postures": ["ExtendedFinger", "OpposedPair", "index_abduction_rad",
        "utah_mit_extended", "utah_mit_opposed"],
    "utah_mit_hand": ["FINGER_COUNT", "LINK_COUNT", "hand_links", "hand_of"],
    "utah_mit_weight": ["GRAVITY_M_S2", "overlap_misfit", "weight_askew",
        "weight_misfit"],
})
