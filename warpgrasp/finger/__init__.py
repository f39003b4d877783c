"""One finger against object and table: its energy, where it rests, and how it moves freely."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "energy": ["Equilibrium", "finger_energy", "free_equilibrium", "largest_magnitude", "pick",
        "put"],
    "equilibrium": ["finger_equilibrium"],
    "chain_energy": ["ChainRest", "finger_length", "free_chain", "links_moved",
        "loosened"],
    "chain_friction": ["ChainFriction", "chain_places", "place_jacobian"],
    "equilibrium_refine": ["refine_equilibrium"],
    "valley_energy": ["refined_energy"],
    "friction": ["NO_FRICTION", "SHEAR", "Friction", "end_friction", "note_friction", "places",
        "start_friction", "with_friction"],
    "free_motion": ["FreeFinger", "advance_free", "start_free"],
    "path_record": ["LinkStep", "PathStep", "true_command"],
    "path_table": ["path_on_device"],
    "sliding": ["FLAT", "LEAN_ASIDE", "LEAN_MOST", "LEAN_SIGMA", "LEAN_UNKNOWN", "LEAST", "STEPS",
        "STILL_M", "Lean", "force_lean"],
    "torque_bounds": ["agree", "bound_shares", "intersect_balls", "may_stop", "predict_joints",
        "stop_reading", "torque_bound"],
})
