"""From contacts to a body: evidence, fits, choice of a model, recognition."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "belief": ["Belief", "read_only"],
    "body_distances": ["bodies_on", "contour_distances", "surface_distances"],
    "choose_model": ["Recovered", "Shape", "choose_body", "or_prior",
        "prior_superquadric", "revolution_of", "same_bodies"],
    "complete_contour": ["OPTIONS", "revolution_misfit", "revolution_of_all", "whole_profile"],
    "contact_verdict": ["ACCEPTED", "FAR", "TABLE", "accepted_contacts", "accepted_rms",
        "contact_verdicts", "explained_by"],
    "evidence": ["CONTOUR_TOUCHES", "Evidence", "FACE_TOUCHES", "TABLE_MARGIN_M", "TouchedLinks",
        "evidence_from_grasps", "evidence_from_touches", "joined_evidence", "joined_links",
        "no_evidence", "no_links", "touched_links"],
    "fit_contacts": ["recover_bodies", "refine_bodies"],
    "misfit": ["FARTHEST_M", "UNBELIEVED_M", "touch_misfit"],
    "plausibility": ["FEWEST_CONTACTS", "plausible", "swept", "within_reach"],
    "recognition": ["Recognizer", "recognizer", "right_answer"],
    "refit_policy": ["REGROWN", "contradicted", "explained", "felt_by_pads"],
    "upright": ["faces_of", "stand_upright"],
})
