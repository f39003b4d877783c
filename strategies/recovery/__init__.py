"""From contacts to a body: evidence, fits, choice of a model."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "belief": ["Belief", "read_only"],
    "body_distances": ["bodies_on", "contour_distances", "surface_distances"],
    "choose_model": ["CONTRADICTS_M", "MOST_STRAYED", "OF_A_SUPERQUADRIC", "PREFERENCE",
        "Recovered", "Shape", "choose_body", "or_prior", "parameter_count", "prior_superquadric",
        "revolution_of", "same_bodies", "superquadric_of"],
    "complete_contour": ["OPTIONS", "revolution_misfit", "revolution_of_all", "whole_profile"],
    "contact_verdict": ["ACCEPTED", "DOUBTED_M", "FAR", "TABLE", "UNEXPLAINED_M",
                        "accepted_contacts", "accepted_rms", "contact_verdicts", "doubted",
                        "gaps_to_mesh", "known_gaps", "mean_contradiction", "mean_gap",
                        "mean_gap_to_mesh", "refuted", "surface_gaps",
                        "unexplained", "verdicts_by_gap"],
    "evidence": ["CONTOUR_TOUCHES", "CONTRADICTED_FROM", "Evidence", "FACE_TOUCHES", "PLACED",
        "SURE_LINK",
        "evidence_from_grasps", "evidence_from_touches", "joined_evidence",
        "no_evidence", "slots_of_touches"],
    "fit_contacts": ["NORMAL_SIGMA_M", "PLACE_SIGMA_M", "TURN_SIGMA_RAD",
        "recover_bodies"],
    "free_contacts": ["BODY", "LATER_SIGMA_M", "LEFT_M", "PAD_SIGMA_M",
        "begun_freely", "believed_freely", "fit_placed", "fitted_freely", "placed_freely"],
    "misfit": ["FARTHEST_M", "LEAST_MISFIT_M", "RIVALS_FROM_M", "UNBELIEVED_M", "schwarz",
        "touch_misfit"],
    "plausibility": ["FEWEST_CONTACTS", "FLOATING_M", "plausible", "plausible_vertices", "swept",
        "swept_by", "why_implausible", "within_reach"],
    "recovery_failure": ["why_failed"],
    "refit_policy": ["finished", "newly_felt", "refitted", "straightened", "unfitted"],
    "upright": ["faces_of", "stand_upright"],
})
