"""Drawings of a study and of single episodes, as SVG, PDF or PNG."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "contacts": ["draw_contacts"],
    "contour": ["draw_contour"],
    "curves": ["BANDS"],
    "faces": ["crossed_faces", "draw_faces"],
    "fits": ["draw_fits"],
    "meshes": ["capsule_mesh", "recovered_grid", "surface_mesh"],
    "replay_frames": ["Replay", "make_replay", "replay_of"],
    "style": ["MARKERS", "UNITS", "encode"],
    "taxels": ["pad_touches", "taxels_figure"],
})
