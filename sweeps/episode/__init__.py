"""A batch of episodes, their scores and columns; the Gymnasium environment."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "columns": ["NODES", "contour_nodes", "interval_columns", "model_names",
        "revolution_parameters",
        "superquadric_parameters"],
    "contact_rows": ["COLUMNS", "VECTORS", "contact_columns", "contacts_csv"],
    "episodes": ["EpisodeBlock", "REBUILD_FAILED", "cell_body", "episode_notes", "place_objects",
        "run_block", "run_cells", "run_episodes"],
    "given_prior": ["SEEN", "draw_prior", "normalized_chamfer", "seen_prior"],
    "recognition_columns": ["columns_of_recognition", "recognize_objects", "right_ones"],
    "mesh_scores": ["score_meshes"],
    "scores": ["FINE", "SAMPLES", "Samples", "Scorer", "Scores", "score_recovered",
               "score_superquadrics"],
    "teaching": ["TEACHERS", "contents_of", "teach", "unlisted_table"],
})
