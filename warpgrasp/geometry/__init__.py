"""Solids as signed distances: primitives, superquadrics, grids, and the bodies made of them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "body": ["Body", "BodyError", "Part", "distance_to_bodies", "distances_of", "scene_of",
        "signed_distance_to_bodies"],
    "body_sampling": ["GROUP", "BodySample", "KeyedBody", "body_lowered", "keyed_body",
        "sample_body", "sobol_points"],
    "meshing": ["body_mesh"],
    "outline": ["outline_of", "radius_around"],
    "scene": ["Join", "Scene", "Shape", "body_distance", "body_distance_grad", "body_is_convex",
        "body_table_distance", "body_table_distance_grad"],
    "sdf_grid": ["GRID_MARGIN_M", "mesh_distance_kernel", "mesh_gap_kernel",
        "simple_mesh_distance_kernel"],
    "sdf_primitive": ["sign_of"],
    "sdf_superquadric": ["SuperquadricShape", "deformed_gradient", "sdf_superquadric_bound_grad",
        "straighten", "superquadric_deformed_gauge", "superquadric_gauge",
        "superquadric_is_plain", "taper_and_bend"],
    "superquadric_gauges": ["gauges_at"],
    "superquadric_lanes": ["PLACED_SUPERQUADRIC_LANES", "SUPERQUADRIC_LANES"],
    "segment_distance": ["LINK_SAMPLES", "deepest_valley", "link_valley", "lower_end",
        "nearest_along", "nearest_on_link"],
    "segment_pair": ["Nearest"],
})
