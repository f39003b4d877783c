"""Batched least squares: one place that vmaps, one file for jaxopt, compiled programs kept."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "batch": ["POINT_BUCKETS", "Program", "map_lanes", "point_bucket", "take", "vmap_cond"],
    "multistart": ["CONCLUSIVE_DAMPING", "Problem", "Solution", "advance", "finish", "screen"],
    "pieces": ["PIECE", "Span", "divided", "sum_of_pieces", "undivided"],
    "program_cache": ["has_cached_programs"],
    "solver": ["NormalEquations", "normal_equations_of", "robust"],
    "xla_flags": ["ONE_THREAD", "OPTIONS", "force_materialize"],
})
