"""Objects to explore: the catalogue, tables of a spec, meshes from files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "catalogue": ["body_from_name", "body_from_table"],
    "catalogue_names": ["BODY_NAMES", "FAMILY_NAMES", "MOST_SEED", "NAME_LIMIT", "NONE_OF_THESE",
        "NO_ANSWER", "PUBLIC", "SETS", "family_hint", "member_of_family"],
    "families": ["family_table"],
    "floating": ["floating_parts"],
    "mesh_import": ["body_from_mesh", "mesh_triangles"],
    "mesh_orientation": ["mesh_distance", "mesh_gap", "mesh_of", "outward_faces",
        "simple_mesh_distance"],
    "stable_pose": ["body_in_stable_pose", "stable_poses"],
    "body_baking": ["check_walls", "touched_body"],
})
