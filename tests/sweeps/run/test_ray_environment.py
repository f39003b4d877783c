"""What Ray's processes inherit, with a stand-in for Ray."""

import os
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from studies import contents, plan_of, run_in

from strategies.planners.planner_file import planner_file
from sweeps.run.local_engine import Options
from sweeps.run.progress import Progress
from sweeps.run.ray_engine import run_on_ray
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
    store = Store(tmp_path / "ray")
    store.open_for(plan, None, "cpu")
    with store.lock((1, 1)), Progress(plan.unit_count, quiet=True) as progress:
        run_on_ray(plan, store, Options(1, (1, 1), "cpu", "fake_episodes:run_episodes"), progress,
                   None)
    assert fake.inherited["FAKE_FLAGS"] == "as it was"
    assert fake.inherited["OMP_NUM_THREADS"] == "1"
    assert os.environ["FAKE_FLAGS"] == "of a planner"
    assert os.environ["OMP_NUM_THREADS"] == "7"
    run_in(tmp_path / "local", plan)
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")
