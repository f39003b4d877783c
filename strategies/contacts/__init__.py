"""Contacts of links: which link touched a believed body, where, and what errors contacts share."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "body_uncertainty": ["BodyUncertainty", "INADEQUATE_FROM", "calibrated_uncertainty",
        "UNFELT", "parameter_uncertainty", "surface_spread"],
    "field_placing": ["field_of_process", "link_stations", "places_on_field",
        "possible_stations", "sampled_field", "superquadric_field"],
    "felt": ["Felt", "unfelt_distance"],
    "volume_spread": ["FeltBy", "VolumeSigns", "interval_trusted"],
    "finger_touch": ["TouchedLinks", "joined_links", "links_of_touches", "no_links",
        "touched_links"],
    "placing_hands": ["told_by_torques"],
    "shared_errors": ["shared_shifts", "shared_vectors"],
})
