"""Two studies side by side: what changed in their specs, and what that did to what they share."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "command": ["compare"],
    "matching": ["Match", "Shared", "changes", "shared_by"],
    "shift": ["Differences", "Shift", "measure_shift"],
})
