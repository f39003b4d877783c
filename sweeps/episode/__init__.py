"""A batch of episodes, their scores and columns; the Gymnasium environment."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "columns": ["NODES", "contour_nodes", "revolution_parameters", "superquadric_parameters"],
    "contact_rows": ["COLUMNS", "VECTORS", "contact_columns"],
    "episodes": ["EpisodeBlock", "place_objects", "run_block", "run_episodes", "cell_body"],
    "given_prior": ["draw_prior", "seen_prior"],
    "scores": ["Scorer", "Scores", "score_recovered", "score_superquadrics"],
})
