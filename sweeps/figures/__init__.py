"""Drawings of a study and of single episodes, as SVG, PDF or PNG."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "confusion": ["draw_confusion"],
    "contacts": ["draw_contacts"],
    "contour": ["draw_contour"],
    "curves": ["draw_curves"],
    "faces": ["crossed_faces", "draw_faces"],
    "fits": ["draw_fits"],
    "forest": ["draw_forest"],
    "meshes": ["capsule_mesh", "recovered_grid", "surface_mesh"],
    "pareto": ["draw_pareto"],
    "replay_frames": ["Replay", "make_replay", "replay_of"],
    "settings": ["draw_settings"],
    "style": ["UNITS", "encode"],
    "taxels": ["pad_touches", "taxels_figure"],
})
