"""Shapes from points, in batch: planes, superquadrics, surfaces of revolution, polyhedra."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "fit_status": ["FitStatus"],
    "plane": ["fit_plane"],
    "plane_record": ["PlaneFit"],
    "revolution.fit": ["fit_revolution"],
    "revolution.record": ["RevolutionFit", "RevolutionOptions"],
    "superquadric.fit": ["fit_superquadric"],
    "superquadric.geometry": ["Superquadric"],
    "superquadric.record": ["SuperquadricFit", "SuperquadricOptions"],
})
