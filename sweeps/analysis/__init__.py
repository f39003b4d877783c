"""Comparing the rows of a study: means, intervals, leaderboard, tables."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "arrow": ["read_rows", "write_rows"],
    "bootstrap": ["Estimate", "OVER", "population", "replicate_means"],
    "confusion": ["Confusion", "confusion_table", "read_confusion"],
    "curves": ["AXES", "Curves", "ERROR", "KNOWN", "Steps", "episode_steps", "grid_of",
        "mean_curve", "on_grid", "once_notes", "reach_table", "read_curves"],
    "entries": ["CHANCES", "Entry", "HIGHER_IS_BETTER", "LeaderboardError", "asked_to_recognize",
        "averaged_points", "bounds_of", "check_metric", "digits_of", "entries_of", "entry_axes",
        "fault_line", "fault_of", "prior_column", "ranked_values", "setting_index", "sign_of",
        "value_text", "values_of"],
    "interval": ["LEVEL", "ObjectMeans", "critical_difference", "small_sample_widening",
        "students_t"],
    "leaderboard": ["MORE", "Leaderboard", "few_lines", "make_leaderboard"],
    "objects": ["ALSO", "BESIDE", "beside_table", "objects_table"],
    "paired": ["MANY_OBJECTS", "ObjectRows", "Paired", "by_episode", "failure_score", "filled",
        "interval_note", "read_objects", "read_paired"],
    "pairs": ["pairs_table"],
    "pareto": ["COST", "Pareto", "columns_of", "find_front", "pareto_table"],
    "rerun_episode": ["Episode", "OTHERWISE", "WorkerDied", "cell_of", "choose_episode",
        "ended_otherwise", "in_a_worker", "rerun", "rerun_all"],
    "sensitivity": ["EPISODES", "HEADER", "check_study", "sensitivity_spec", "sensitivity_table"],
    "settings": ["Effect", "effects", "read_settings", "settings_table"],
})
