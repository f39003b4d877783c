"""The simulator: a batch of robots, each before its own object, and their guarded moves."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "core.random": ["counter_key"],
    "geometry.body": ["Body", "BodyError"],
    "geometry.meshing": ["body_mesh"],
    "objects.catalogue": ["body_from_name", "body_from_table"],
    "parameters": ["ArmTable", "ContactTable", "ErrorTable", "FitTable", "HandTable", "ObjectTable",
        "PadTable", "SensorTable", "StereoTable"],
    "probe_status": ["ProbeStatus"],
    "robot": ["Grasps", "Robot", "Truth"],
})
