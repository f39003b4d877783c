"""Hands whose fingers are chains of any revolute joints: tables and kinematics in kernels."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "chain_hand": ["ChainHand", "capsule_ends", "chain_hand", "closing_way", "drive_angles",
                   "tip_places", "true_chains"],
})
