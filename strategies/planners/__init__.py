"""Planners, which choose the next probe from what was felt, and what they are given."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "from_strategy": ["Budget", "MOST_STEPS", "budget_of", "fits_on_way", "planner_of",
                      "within_budget"],
    "guarded_call": ["told_apart"],
    "next_procedure": ["contour_to_follow", "faces_to_cross"],
    "oracle": ["Oracle"],
    "planner_file": ["PlannerError", "environment_without_planners", "files_beside"],
    "ordered": ["axis_unseen"],
    "probes": ["CrossFaces", "FollowContour", "Grasp", "Probe", "listed", "misfits",
               "wanted_of"],
    "register": ["Foreseeing", "Planner", "fault_text", "place_of", "planner"],
    "registry": ["make_planner"],
})
