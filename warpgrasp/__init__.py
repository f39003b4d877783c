"""Batched simulation of exploration by touch: robot, objects, sensors, guarded motion."""

import importlib
from typing import Any

_HOME = {  # what one needs for a batch of probes, and where it is; loaded when asked for
    "ArmTable": "parameters", "FitTable": "parameters", "HandTable": "parameters",
    "ObjectTable": "parameters", "PadTable": "parameters", "SensorTable": "parameters",
    "Body": "body", "BodyError": "body", "body_from_name": "catalogue",
    "body_from_table": "catalogue", "body_mesh": "body_mesh", "counter_key": "counter_random",
    "Grasps": "robot", "ProbeStatus": "status", "Robot": "robot", "Truth": "robot",
}
_NAMES = {"counter_key": "counter_key_host"}
__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Loads a name the first time: `import warpgrasp` itself is quick."""
    if name not in _HOME:
        raise AttributeError(f"module 'warpgrasp' has no attribute {name!r}")
    return getattr(importlib.import_module(f"warpgrasp.{_HOME[name]}"), _NAMES.get(name, name))


def __dir__() -> list[str]:
    return __all__
