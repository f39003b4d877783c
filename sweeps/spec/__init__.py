"""What a spec accepts: TOML with line numbers, units of keys, all errors at once."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "cell": ["APART", "CONTACTS", "Cell", "ENDED", "SECTIONS", "TABLES", "batch_key", "own_code"],
    "checks": ["arms_of", "changed", "closes_fingers", "feels_with_pads", "swept_points",
        "told_of"],
    "errors": ["Held", "OtherStudy", "Problem", "Problems", "SpecError", "StoreError",
        "choose", "short"],
    "hands": ["TORQUES", "hands_of", "misfit_of", "read_hand", "sense_of"],
    "named_files": ["KEPT", "UNSWEPT", "names_of", "read_arm",
        "read_reconstruct", "with_models"],
    "objects": ["files_digest", "floating_notes", "object_of_argument", "read_objects"],
    "reader": ["read_spec", "resolve", "spec_text"],
    "search": ["Factor", "Search", "canonical_search", "refuse_search", "search_of",
        "with_points"],
    "strategies": ["idle_grasp_notes"],
    "study": ["Axis", "Body", "ARM_KEY", "FILE_KEYS", "HAND_KEY", "Study", "StudyTable"],
    "template": ["spec_template"],
    "toml_reader": ["read_content"],
    "units": ["read_table", "spec_fields"],
})
