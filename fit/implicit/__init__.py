"""Free-form bodies: Gaussian processes over signed distance, their zero sets as meshes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "fit": ["fit_implicit"],
    "free_bodies": ["fit_free_forms"],
    "known": ["KnownProcess", "fit_known", "known_deviations", "known_kernel", "known_slopes",
        "log_evidence", "of_fit", "shared_error_means"],
    "mean_errors": ["MeanErrors", "errors_left"],
    "mesh": ["implicit_meshes", "zero_set_meshes"],
    "query": ["ImplicitValues", "implicit_distance", "implicit_slopes",
        "implicit_values", "of_rows"],
    "record": ["FreeForms", "ImplicitFit", "ImplicitOptions", "Mean", "TriangleMesh"],
    "volume": ["NORMAL_90", "VolumeEstimate", "implicit_volume", "surface_samples"],
})
