"""What to touch next, and what was felt: procedures, planners, recovery of a body."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "contacts.finger_touch": ["touched_links"],
    "exploration": ["explore"],
    "planners.probes": ["CrossFaces", "FollowContour", "Grasp"],
    "planners.register": ["planner"],
    "poses.waypoints": ["BoundingCylinder", "Ring", "Top"],
    "procedures.containment": ["explore_by_containment"],
    "ready_made": ["STRATEGIES", "UNGUIDED", "run_together"],
    "recovery.belief": ["Belief"],
    "recovery.evidence": ["Evidence", "evidence_from_grasps"],
    "recovery.fit_contacts": ["recover_bodies"],
    "strategy": ["Strategy"],
})
