"""Hand poses around an object, postures of the hand, and closing paths."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "chain_paths": ["chain_commands", "chain_path_names"],
    "closing_paths": ["CLOSING_PATHS", "closing_commands", "commands_within"],
    "hand_outline": ["HandOutline", "outline_of"],
    "hand_poses": ["pose_about", "poses_from_csv", "waypoint_poses"],
    "postures": ["extended_finger", "opposed_pair", "poking_pose"],
    "waypoints": ["BoundingBox", "BoundingCylinder", "Column", "Hemisphere", "Opposing",
        "PRIOR_MARGIN_M", "Placement", "Random", "Ring", "Spiral", "Top", "WAYPOINT_KINDS",
        "WaypointError", "check_prior"],
})
