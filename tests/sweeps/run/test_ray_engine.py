"""The Ray engine against the local one; needs the optional extra."""

import os
import signal
import sys
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from places import PYTHONPATH
from studies import SMALL, board, contents, plan_of, run_in

from sweeps.run.local_engine import Options
from sweeps.run.plan import Plan
from sweeps.run.progress import Progress
from sweeps.run.ray_engine import run_on_ray
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store
from sweeps.spec.errors import StoreError

pytest.importorskip("ray")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # Ray's own warnings


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray's own processes find the stand-in."""
    monkeypatch.setenv("PYTHONPATH", PYTHONPATH)


def run_on(folder: Path, plan: Plan, address: str | None, function: str = "run_episodes",
           progress: Progress | None = None) -> Outcome:
    store = Store(folder)
    store.open_for(plan, None, "cpu")
    options = Options(2, (1, 1), "cpu", f"fake_episodes:{function}")
    with store.lock((1, 1)), progress or Progress(plan.unit_count, quiet=True) as shown:
        return run_on_ray(plan, store, options, shown, address)


def test_ray_gives_the_same_bytes(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec")
    run_in(tmp_path / "local", plan)
    assert run_on(tmp_path / "ray", plan, None).done == 8
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")
    assert board(plan, tmp_path / "ray") == board(plan, tmp_path / "local")


def test_units_that_raise_are_set_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = SMALL.replace('"wedge"', '"lightbulb"').replace("= 70\no", "= 3\no")
    outcome = run_on(tmp_path, plan_of(tmp_path / "spec", text), None, "deadly_episodes")
    assert outcome == Outcome(kept=0, done=2, failed=2)


class Terminates(Progress):
    """Sends this process SIGTERM when the first unit is done, as a batch system does."""

    def done(self, episodes: int) -> None:
        super().done(episodes)
        os.kill(os.getpid(), signal.SIGTERM)


def be_terminated(folder: Path) -> None:
    plan = plan_of(folder / "spec")
    try:
        run_on(folder, plan, None, progress=Terminates(plan.unit_count, quiet=True))
    except KeyboardInterrupt:
        sys.exit(130)


def test_sigterm_ends_a_run_as_an_interrupt_does(tmp_path: Path) -> None:
    process = get_context("spawn").Process(target=be_terminated, args=(tmp_path,))
    process.start()
    process.join(60)
    assert process.exitcode == 130
    assert not list((tmp_path / "units").glob(".*"))  # nothing is left half written


class KillsANode(Progress):
    """Takes a node away once a third of the units is done."""

    def __init__(self, total: int, cluster: Any, node: Any) -> None:
        super().__init__(total, quiet=True)
        self.cluster, self.node = cluster, node

    def done(self, episodes: int) -> None:
        super().done(episodes)
        if self.node and self.done_units > self.total // 3:
            self.cluster.remove_node(self.node, allow_graceful=False)
            self.node = None


@pytest.fixture
def cluster(importable: None) -> Iterator[Any]:
    from ray.cluster_utils import Cluster

    found = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    yield found
    found.shutdown()


def test_a_lost_node_changes_nothing(tmp_path: Path, cluster: Any) -> None:
    plan = plan_of(tmp_path / "spec", SMALL.replace("= 70\no", "= 640\no"))
    run_in(tmp_path / "local", plan)
    progress = KillsANode(plan.unit_count, cluster, cluster.add_node(num_cpus=1))
    outcome = run_on(tmp_path / "ray", plan, cluster.address, "slow_episodes", progress)
    assert progress.node is None
    assert outcome == Outcome(kept=0, done=40, failed=0)
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")


def test_without_an_address_it_runs_here_where_a_cluster_runs(tmp_path: Path, cluster: Any,
                                                              monkeypatch: pytest.MonkeyPatch
                                                              ) -> None:
    monkeypatch.setenv("RAY_ADDRESS", cluster.address)
    assert run_on(tmp_path, plan_of(tmp_path / "spec"), None).done == 8


def test_what_is_no_address_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="--address: is 'my head'; should be that of a running"):
        run_on(tmp_path, plan_of(tmp_path / "spec"), "my head")
