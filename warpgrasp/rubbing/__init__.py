"""One finger whose skin rubs: the balance of its torques, and its rest from step to step."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "balance": ["Balance", "Grip"],
    "chain_balance": ["ChainGrip", "finger_balance"],
    "friction_step": ["lagged", "next_rubbed", "refine_rubbed", "start_rubbed"],
})
