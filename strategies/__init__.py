"""Exploratory procedures, waypoint sequences and their orderings."""

import importlib
from typing import Any

_HOME = {  # what one needs for a batch of probes, and where it is; loaded when asked for
    "Belief": "belief", "BoundingCylinder": "waypoints", "CrossFaces": "probes",
    "Evidence": "evidence", "FollowContour": "probes", "Grasp": "probes", "Ring": "waypoints",
    "STRATEGIES": "catalogue", "Strategy": "strategy", "Top": "waypoints",
    "evidence_from_grasps": "evidence", "explore": "exploration",
    "explore_by_containment": "containment", "planner": "registry",
    "recover_bodies": "recovery", "touched_links": "evidence",
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Loads a name the first time: `import strategies` itself is quick."""
    if name not in __all__:
        raise AttributeError(f"module 'strategies' has no attribute {name!r}")
    return getattr(importlib.import_module(f"strategies.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
