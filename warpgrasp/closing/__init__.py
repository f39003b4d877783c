"""Tendon-guarded closing of the fingers, and where the robot believes that they touched."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "closing": ["Closing", "ClosingTruth", "close_fingers"],
    "closing_record": ["stays_open"],
    "self_contact": ["MISFIT", "doubt_of", "self_contacts"],
    "contact_estimate": ["ContactEstimate", "estimate_contacts", "last_steps"],
})
