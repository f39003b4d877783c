"""From a spec to an answer: studies, episodes, scores, leaderboards, reports, the command line."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "output": ["ask_quiet", "devices", "quiet_asked", "quiet_stdout", "start_warp", "write_atomic"],
})
