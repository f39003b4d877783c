"""Running a study: plan, units of work, worker processes, the study directory."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "environment": ["PACKAGES", "describe_environment"],
    "estimate": ["estimate_cost"],
    "false_contacts": ["false_contact_warnings"],
    "grown_units": ["begun_in", "kept_units", "reuse_units"],
    "inputs": ["kept_cell"],
    "local_engine": ["Options", "UNIT_TIMEOUT_S", "as_a_worker", "run",
                     "terminated_as_interrupted"],
    "plan": ["BLOCK", "LEAST_RUNS", "Plan", "Unit", "by_key", "canonical_body", "cell_hash",
             "differences", "digest", "part_of", "plan_study", "same_bodies", "unit_id"],
    "progress": ["Progress", "read_note"],
    "race_record": ["RACE_NOTE", "object_order", "open_sweep", "race_blocks", "race_of",
                    "read_race_note", "refuse_races", "swept_before", "taken_blocks"],
    "ray_engine": ["run_on_ray"],
    "scheduler": ["Outcome"],
    "store": ["Store", "damaged_notes", "open_study", "plan_of"],
    "unit_file": ["Columns", "DamagedUnit", "holds_lists", "read_unit", "write_unit"],
    "worker": ["ENVIRONMENT", "EPISODES"],
})
