"""Free-form bodies after an episode: from a Gaussian process, or by a user's own function."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "bent_model": ["with_bends"],
    "free_form": ["FreeForm", "Reconstruction", "reconstruct"],
    "free_mean": ["FreeMean", "likeliest_mean"],
    "plug_in": ["Touches"],
    "plug_in_name": ["BUILT_IN", "CHOSEN", "PARTS", "call_by_content", "find_plug_in",
        "plug_in_file"],
    "prior_distance": ["DistanceToRecovered"],
})
