"""The exploratory procedures of Allen and Michelman (1990), and the touches they return."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "containment": ["check_closings", "closing_names", "explore_by_containment", "padded_commands"],
    "contour_follower": ["explore_contour"],
    "contour_record": ["Axis", "ContourExploration", "ContourOptions"],
    "contour_sections": ["SectionProfile", "profile_by_sections"],
    "contour_shape": ["Profile", "later_profile", "match_profiles", "profile_of", "with_profiles"],
    "lean": ["face_axes"],
    "options": ["ContourTable", "DecideTable", "PlanarTable"],
    "planar_explorer": ["explore_plane"],
    "planar_faces": ["Face", "angle_between", "planes_of"],
    "planar_record": ["PlanarExploration", "PlanarOptions"],
    "possible": ["FAILED", "NotPossible", "STATUS", "check_foreseeable", "check_possible",
        "extended_of", "fault_status", "opposed_of"],
    "stereo_axis": ["StereoAxis", "see_axis"],
    "depth_prior": ["SeenBox", "believed_after", "or_drawn", "see_box"],
    "stereo_prior": ["see_cylinder"],
    "touches": ["EndReason", "MissedTips", "REASON_TEXT", "TABLE_MARGIN_M", "TouchTable",
        "true_touches"],
})
