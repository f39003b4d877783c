"""What a hand pose is expected to touch, by what is believed of the object."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "aimed_poses": ["draw_aimed_poses"],
    "first_touch": ["first_touches"],
    "hand_samples": ["HandSamples", "SweptFingers", "reached_place", "samples_of_hand"],
    "occupancy": ["Occupancy", "Prospect", "begin_occupancy"],
    "process_occupancy": ["occupancy_by_process"],
    "surface_process": ["SurfaceProcess", "matern"],
})
