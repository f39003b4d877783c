"""A sweep or a race as it goes on: read from its directory, shown in a browser or a terminal."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "server": ["watch"],
    "terminal": ["watch_in_terminal"],
    "view": ["watched_metric"],
})
