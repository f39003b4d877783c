"""Superquadrics with taper and bend: residuals, fits, geometry, uncertainty."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "descent": ["begin_starts"],
    "fit": ["fit_superquadric"],
    "geometry": ["Superquadric", "SuperquadricLike", "cube_grid", "from_straight_frame",
        "straight_coordinates", "superquadric", "superquadric_areas", "superquadric_inside_outside",
        "superquadric_normals", "superquadric_points", "superquadric_surface",
        "superquadric_volume"],
    "moments": ["DESCRIPTION", "description_covariance", "superquadric_description"],
    "parameter_vector": ["Form", "Tensor", "unpack"],
    "record": ["SuperquadricFit", "SuperquadricOptions"],
    "residuals": ["normal_equations", "residual_vector"],
    "starts": ["box_starts"],
    "uncertainty": ["SuperquadricUncertainty", "distance_slopes", "superquadric_uncertainty",
        "surface_distance", "surface_std"],
})
