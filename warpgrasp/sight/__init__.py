"""What cameras see of an object: silhouettes, with their faults, and depths from one side."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "depth_view": ["DepthView", "seen_depths"],
    "silhouette": ["Cameras", "depths", "silhouettes", "stereo_cameras"],
    "silhouette_faults": ["faulty_silhouettes", "object_regions", "silhouette_edges"],
})
