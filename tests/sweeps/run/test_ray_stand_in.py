"""The Ray engine with a stand-in for Ray: what its processes inherit, and units that are lost."""

import os
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from studies import contents, plan_of, run_in

from strategies.planners.planner_file import planner_file
from sweeps.run.local_engine import Options, run
from sweeps.run.plan import Plan
from sweeps.run.progress import Progress
from sweeps.run.ray_engine import run_on_ray
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store


class FakeRay:
    """Runs tasks in this process; knows the environment that its nodes inherit."""

    exceptions = SimpleNamespace(RayError=RuntimeError)

    def init(self, **asked: Any) -> None:
        self.inherited = dict(os.environ)

    def remote(self, **about: Any) -> Any:
        return lambda function: SimpleNamespace(
            remote=lambda *arguments: partial(function, *arguments))

    def wait(self, tasks: list[Any], **asked: Any) -> tuple[list[Any], list[Any]]:
        return tasks[:1], tasks[1:]

    def get(self, task: Any) -> Any:
        return task()

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 1.0}

    def shutdown(self) -> None:
        """Nothing runs."""


def on_ray(plan: Plan, folder: Path, progress: Progress) -> Outcome:
    store = Store(folder)
    store.open_for(plan, None, "cpu")
    with store.lock((1, 1)), progress:
        return run_on_ray(plan, store, Options(1, (1, 1), "cpu", "fake_episodes:run_episodes"),
                          progress, None)


def here(plan: Plan, folder: Path, progress: Progress) -> Outcome:
    store = Store(folder)
    store.open_for(plan, None, "cpu")
    with store.lock((1, 1)), progress:
        return run(plan, store, Options(1, (1, 1), "cpu", "fake_episodes:run_episodes"), progress)


class LosesUnits(Progress):
    """Takes away the files of what is there once a number of units is done."""

    def __init__(self, total: int, folder: Path, after: int) -> None:
        super().__init__(total, quiet=True)
        self.folder, self.after = folder, after

    def done(self, episodes: int) -> None:
        super().done(episodes)
        if self.done_units == self.after:
            for file in (self.folder / "units").glob("[0-9a-f]*.parquet"):  # none half written
                file.unlink()


@pytest.mark.parametrize("engine", [on_ray, here])
def test_every_engine_counts_units_whose_files_are_gone(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: Any) -> None:
    monkeypatch.setattr("sweeps.run.ray_engine._ray", FakeRay)
    plan = plan_of(tmp_path / "spec")
    count, folder = plan.unit_count, tmp_path / "out"
    found = engine(plan, folder, LosesUnits(count, folder, 3))
    left = len(list((folder / "units").iterdir()))
    assert left < count
    assert found == Outcome(kept=0, done=count, failed=0, lost=count - left)
    again = engine(plan, folder, Progress(count, quiet=True))
    assert again == Outcome(kept=left, done=count - left, failed=0, lost=0)


def test_nodes_do_not_inherit_what_a_planner_file_sets(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_FLAGS", "as it was")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    file = tmp_path / "p.py"
    file.write_text("import os\nos.environ.update(FAKE_FLAGS='of a planner')\n")
    planner_file(file)
    fake = FakeRay()
    monkeypatch.setattr("sweeps.run.ray_engine._ray", lambda: fake)
    plan = plan_of(tmp_path / "spec")
    on_ray(plan, tmp_path / "ray", Progress(plan.unit_count, quiet=True))
    assert fake.inherited["FAKE_FLAGS"] == "as it was"
    assert fake.inherited["OMP_NUM_THREADS"] == "1"
    assert os.environ["FAKE_FLAGS"] == "of a planner"
    assert os.environ["OMP_NUM_THREADS"] == "7"
    run_in(tmp_path / "local", plan)
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")
