"""Guarded closing of hands whose fingers are chains, and where the robot believes they touched."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "chain_closing": ["ChainClosing", "close_chains"],
    "chain_estimate": ["ChainEstimate", "estimate_chain_contacts"],
    "chain_meeting": ["palm_of"],
    "chain_path": ["closing_misfit", "come_bounds", "no_chain_errors"],
    "chain_self_contact": ["chain_self_contacts"],
})
