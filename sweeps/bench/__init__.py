"""What the simulator and the fits cost on this machine, and beside other programs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "command": ["bench"],
})
