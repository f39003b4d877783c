"""From a spec to an answer: studies, episodes, scores, leaderboards, reports, the command line."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "output": ["devices", "init_warp", "is_quiet", "quiet_stdout", "quietly", "write_atomic"],
})
