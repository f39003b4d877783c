"""Hands as data: records, the files they are kept in, the URDFs they come from, kinematics."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "hand_checks": ["MOST_MEETING", "check_hand"],
    "hand_file": ["SHIPPED", "hand_from_file", "hand_named"],
    "hand_frames": ["driven_angles", "finger_tips", "fixed_angles", "link_frames", "matrix_of",
                    "place_of", "posture_angles"],
    "hand_guesses": ["other_guesses"],
    "hand_model": ["BASE_FIRST", "Box", "CURLS_DEG", "Capsule", "HandClosing", "Finger",
                   "Follow", "HandError", "HandJoint", "HandModel", "PadPlace", "PadSize", "Place",
                   "Posture", "STILL", "Shape", "UNITS_OF_FILES", "vector_of"],
    "hand_writer": ["hand_text"],
    "capsule_fit": ["skin_notes"],
    "frames_batch": ["link_frames_batch"],
    "strict_toml": ["read_strict"],
    "touch_shapes": ["Bulk", "bulk_of", "palmar_directions", "touch_model"],
    "urdf_hand": ["FRAMED", "hand_from_urdf"],
    "urdf_tree": ["FRAME_LINK", "NO_LIMIT_NM", "UrdfJoint", "UrdfTree", "read_urdf"],
})
