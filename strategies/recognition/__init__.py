"""Which object was felt: recovered bodies compared with models that were recovered before."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "answers": ["ALIGNMENT", "NONE", "Recognition", "recognize"],
    "catalogue_alignment": ["Recognizer", "recognizer"],
    "descriptions": ["described", "different_faces"],
    "known_models": ["KnownModels", "KnownObject", "ModelsError", "models_from_file",
                     "models_text"],
    "lessons": ["UNLISTED", "Lesson", "add_objects", "learn_models", "lesson_of",
                "taught"],
})
