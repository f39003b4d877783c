"""Small specs for tests."""

from pathlib import Path
from typing import Any

import fake_episodes
import pytest

from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.run.local_engine import Options, run
from sweeps.run.plan import Plan, plan_study
from sweeps.run.progress import Progress
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store
from sweeps.run.unit_file import write_files
from sweeps.run.worker import run_units
from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec
from sweeps.spec.study import Study

SMALL = """\
schema = 1
seed = 7
episodes_per_cell = 70
objects = ["block", "wedge"]
[[strategy]]
name = "ring6"
[[strategy]]
name = "mine"
waypoints = { kind = "ring", count = 3, tilt_deg = 70 }
"""


def write_spec(folder: Path, text: str = SMALL) -> Path:
    file = folder / "spec.toml"
    file.write_text(text)
    return file


def read(folder: Path, text: str, *overrides: str) -> Study:
    return read_spec(write_spec(folder, text), overrides)


def refusals(folder: Path, text: str, *overrides: str) -> list[str]:
    """All that is said of a spec that is refused, without the folder."""
    with pytest.raises(SpecError) as caught:
        read(folder, text, *overrides)
    return [str(problem).removeprefix(f"{folder}/") for problem in caught.value.problems]


def plan_of(folder: Path, text: str = SMALL) -> Plan:
    folder.mkdir(exist_ok=True)
    return plan_study(read_spec(write_spec(folder, text)))


def run_in(folder: Path, plan: Plan, function: str = "run_episodes", workers: int = 1,
           shard: tuple[int, int] = (1, 1), **more: Any) -> Outcome:
    store = Store(folder)
    store.open_for(plan, None, "cpu")
    options = Options(workers, shard, "cpu", f"fake_episodes:{function}", **more)
    with store.lock(shard), Progress(plan.unit_count, quiet=True) as progress:
        return run(plan, store, options, progress)


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in (folder / "units").iterdir()}


def board(plan: Plan, *folders: Path) -> bytes:
    return make_leaderboard(plan, [Store(folder) for folder in folders]).csv()


def fill(folder: Path, plan: Plan, episodes: Any = fake_episodes.run_episodes) -> Store:
    """The store of a study run in this process."""
    store = Store(folder)
    store.open_for(plan, None, "cpu")
    for unit in plan.units():
        write_files(store.path(unit), unit.id, run_units(episodes, [unit], "cpu")[0])
    return store
