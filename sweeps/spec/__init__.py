"""What a spec accepts: TOML with line numbers, units of keys, all errors at once."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "cell": ["CONTACTS", "Cell", "SECTIONS", "TABLES", "differ_in_object_alone"],
    "errors": ["Held", "OtherStudy", "Problem", "Problems", "SpecError", "StoreError",
        "choose", "short"],
    "objects": ["files_digest", "object_of_argument", "read_objects"],
    "reader": ["read_spec"],
    "reconstruct": ["read_reconstruct"],
    "study": ["Axis", "Body", "FILE_KEYS", "Study", "StudyTable"],
    "template": ["spec_template"],
    "units": ["read_table", "spec_fields"],
})
