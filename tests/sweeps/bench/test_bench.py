"""The bench: what it runs, what it writes. Rates themselves are no tests."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from sweeps.bench.bench_table import markdown
from sweeps.bench.command import bench, device_rows, rows
from sweeps.bench.measure import Workload, measure
from sweeps.bench.rows import ON_DEVICES, ROWS
from sweeps.bench.whole_study import marginal
from sweeps.cli.main import run
from sweeps.spec.errors import StoreError


def test_rows_name_what_there_is() -> None:
    every = list(rows(quick=False, peers=False))
    assert len(set(every)) == len(every)
    assert {row for row, *_ in every} == set(ROWS)
    assert set(rows(quick=True, peers=False)) < set(every)


def test_rows_on_a_device_are_of_kernels() -> None:
    every = list(device_rows(quick=False))
    assert len(set(every)) == len(every)
    assert {row for row, *_ in every} == set(ON_DEVICES)
    assert {row for row, *_ in device_rows(quick=True)} < set(ON_DEVICES)


def test_a_device_is_measured_beside_the_cores_of_its_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def row(asked: Any, quick: bool, device: str) -> dict[str, Any]:
        what, of, batch, threads = asked
        line = {"row": what, "of": of, "batch": batch, "threads": threads, "device": device}
        if of == "mesh" and device != "cpu":
            return {**line, "failed": "out of memory"}
        return {**line, "per_s": 3e5 if device == "cpu" else 6e5, "per_cpu_s": 2e3, "first_s": 0.2}

    monkeypatch.setattr("sweeps.bench.command._measure", row)
    assert bench(tmp_path, quick=False, peers=False, device="cuda:0") == 1  # one failed
    table = (tmp_path / "bench.md").read_text()
    assert re.search(r"\| closings \| block \| 4096 \| \d+ \| 300,000 \| 600,000 \| 2 \| 0.2 \|",
                     table)
    assert re.search(r"\| closings \| mesh \| 65536 \| \d+ \| 300,000 \| failed \|  \|", table)
    with pytest.raises(StoreError, match=r"no row 'fits' on cuda:0"):
        bench(tmp_path, quick=False, peers=False, only=["fits"], device="cuda:0")
    with pytest.raises(StoreError, match=r"--peers: run on a CPU"):
        bench(tmp_path, quick=False, peers=True, device="cuda:0")


def test_a_name_that_no_row_has_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"--only: no row 'fits,touches'.*fits"):
        bench(tmp_path / "out", quick=True, peers=False, only=["fits,touches"])
    for name, quick, peers in (("mujoco_rollout", False, False), ("scipy_fits", True, True)):
        with pytest.raises(StoreError, match=f"no row '{name}' with --quick or without --peers"):
            bench(tmp_path / "out", quick=quick, peers=peers, only=[name])
    assert not (tmp_path / "out").exists()


def test_a_bench_that_is_stopped_keeps_what_it_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[Any] = []

    def row(asked: Any, quick: bool) -> dict[str, Any]:
        if measured:
            raise KeyboardInterrupt
        measured.append(asked)
        return {"row": "closings", "of": "block", "batch": 64, "threads": 1, "per_s": 4e3,
                "per_cpu_s": 2e3}

    monkeypatch.setattr("sweeps.bench.command._measure", row)
    with pytest.raises(KeyboardInterrupt):
        bench(tmp_path / "out", quick=True, peers=False)
    lines = (tmp_path / "out" / "bench.jsonl").read_text().splitlines()
    assert [json.loads(line)["row"] for line in lines] == ["environment", "closings"]
    assert "| closings | block | 64 |" in (tmp_path / "out" / "bench.md").read_text()


def test_help_lists_every_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "--help"]) == 0
    listed = set(re.findall(r"\w+", capsys.readouterr().out))
    assert {row for row, *_ in rows(quick=False, peers=True)} | {"start", "study"} <= listed


def test_measure_keeps_the_first_call_apart() -> None:
    calls = []
    found = measure(Workload("things", lambda: calls.append(1) or 5), quick=True)
    assert len(calls) == 2
    assert found["count"] == 5
    assert found["per_s"] > 0
    assert found["first_s"] >= 0


def test_calls_of_half_a_minute_are_repeated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    now, calls = [0.0], []
    monkeypatch.setattr("time.perf_counter", lambda: now[0])

    def call() -> int:
        now[0] += seconds
        calls.append(1)
        return 5

    for seconds, wanted in ((30.0, 2), (20.0, 4)):
        calls.clear()
        assert measure(Workload("things", call))["per_s"] == 5 / seconds
        assert len(calls) == wanted


def test_the_table_gives_ratios_of_one_run_and_says_what_failed() -> None:
    line = {"batch": 64, "threads": 2, "per_s": 4000.0, "per_cpu_s": 2000.0}
    text = markdown([
        {"row": "environment", "commit": "0123456789abcdef", "cores": 2, "load": [0, 0, 0]},
        {**line, "row": "closings", "of": "block"},
        {"row": "touches", "of": "block", "batch": 64, "threads": 2, "failed": "no"},
        {**line, "row": "same_closing", "of": "-"},
        {**line, "row": "mujoco_rollout", "of": "2", "per_s": 8.0, "per_cpu_s": 4.0},
        {"row": "start", "of": "help", "s": 0.4, "cpu_s": 0.3},
        {**line, **marginal({"batch": 1002, "s": 6.0, "cpu_s": 10.0},
                            {"batch": 2, "s": 4.0, "cpu_s": 5.0}),
         "row": "study", "of": "ring6", "batch": 1002, "s": 6.0},
    ])
    assert "| closings | block | 64 | 2 | 4,000 | 2,000 |" in text
    assert "| touches | block | 64 | 2 | failed |" in text
    assert "| mujoco_rollout | 2 | 8 | 4 | 500.0 |" in text
    assert "| help | 0.4 | 0.3 |" in text
    assert "| ring6 | 1002 | 2 | 6.0 | 4,000 | 2,000 | 2.0 | 5.0 |" in text
