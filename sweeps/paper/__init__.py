"""The experiments of Allen and Michelman (1990) beside their printed results."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "command": ["paper"],
})
