"""A study as one HTML page, episodes as replays, the files of a single episode."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "html": ["asset", "source_hash"],
    "episode_files": ["explore"],
    "picture_process": ["PictureProcess"],
    "replay": ["check_viser"],
})
