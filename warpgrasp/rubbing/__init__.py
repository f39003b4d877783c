"""One finger whose skin rubs: the balance of its torques, and its rest from step to step."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "balance": ["Balance", "Grip", "finger_balance"],
    "chain_balance": ["ChainGrip", "ChainRubbed", "predicted", "start_grip"],
    "friction_step": ["lagged", "lagged_rest", "next_rubbed", "refine_rubbed", "start_rubbed"],
})
