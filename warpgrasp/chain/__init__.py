"""Hands whose fingers are chains of any revolute joints: tables and kinematics in kernels."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "chain_hand": ["ChainHand", "capsule_ends", "chain_of", "chain_of_table",
        "chain_rows", "closing_way", "drive_angles", "fingers_apart", "hand_of_kind",
        "joint_drive", "joint_reaches", "link_frames_of", "padded", "palmar_sides",
        "tip_places", "true_chains", "weight_moments"],
    "chain_lanes": ["CHAIN_LANES"],
    "chain_move": ["chain_clearance", "palm_and_wrist", "palm_bars"],
    "chain_pairs": ["chain_opposed"],
    "chain_pads": ["fitted_pads", "own_pads", "pad_misfit", "pad_places"],
    "chain_postures": ["chain_extended"],
    "free_lanes": ["capsules_in_lanes"],
    "torque_sensor": ["KINDS", "command_range", "true_sensors"],
})
