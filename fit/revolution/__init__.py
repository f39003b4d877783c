"""Surfaces of revolution with contours of linear segments: residuals, fits, geometry."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "fit": ["fit_revolution"],
    "geometry": ["RevolutionBody", "closed_contours", "revolution_inside", "revolution_surface",
        "revolution_volume"],
    "record": ["STANDS", "Middle", "RevolutionFit", "RevolutionOptions"],
})
