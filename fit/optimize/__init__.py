"""Batched least squares: one place that vmaps, one file for jaxopt, compiled programs kept."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "batch": ["POINT_BUCKETS", "Program", "map_lanes", "point_bucket", "take"],
    "multistart": ["Finished", "Problem", "advance", "finish", "screen"],
    "robust_loss": ["robust"],
    "solver": ["Normal", "descend", "normal_of"],
    "vmap_cond": ["where_any"],
    "xla_flags": ["storing"],
})
