"""The scores that a race reads from its units."""

from pathlib import Path

import fake_episodes
import numpy as np
from studies import SMALL, plan_of

from sweeps.race.race_units import RaceUnits
from sweeps.run.store import Store
from sweeps.run.unit_file import write_files
from sweeps.run.worker import run_units


def test_a_unit_that_failed_counts_as_the_worst_that_any_entry_had_or_was_given(
        tmp_path: Path) -> None:
    plan, store = plan_of(tmp_path, SMALL), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    units = RaceUnits(plan, store, "chamfer_mm", "these")
    asked = [(0, 0, 8), (1, 0, 8)]
    worst: dict[str, float] = {}
    for unit in units.units(asked):
        if unit.cell.strategy.name == "mine":
            store.log(unit).write_text("hung")
            continue
        rows = run_units(fake_episodes.given_episodes, [unit], "cpu")[0]
        rows["prior_chamfer_mm"] += 20.0
        worst[unit.cell.object_name] = rows["prior_chamfer_mm"].max()
        write_files(store.path(unit), unit.id, rows)
    found = units.scores(asked)[1]  # (object, episode)
    assert np.array_equal(found, np.tile([[worst["block"]], [worst["wedge"]]], 8))
