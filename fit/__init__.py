"""Shapes from sparse touches, in batch: arrays in, frozen results out."""

import importlib
from typing import Any

_HOME = {  # the public verbs and records, and where they are; loaded when asked for
    "FitStatus": "status", "PlaneFit": "plane", "RevolutionFit": "revolution",
    "Superquadric": "superquadric_shape", "SuperquadricOptions": "superquadric_record",
    "choose_shape": "choice", "fit_faces": "plane", "fit_plane": "plane",
    "fit_revolution": "revolution", "fit_superquadric": "superquadric",
}
__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Loads a name the first time: `import fit` itself is quick."""
    if name not in __all__:
        raise AttributeError(f"module 'fit' has no attribute {name!r}")
    return getattr(importlib.import_module(f"fit.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
