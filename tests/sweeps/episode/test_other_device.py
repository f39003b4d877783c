"""Episodes on a device that is no CPU touch nothing that is on another."""

from typing import Any

import numpy as np
import pytest
from other_device import other_device

from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.parameters import ArmTable, HandTable

LEAP = {"hand": HandTable(kind="leap")}
QUICK: list[tuple[str, str, dict[str, Any]]] = [
    ("ring6", "funnel", {}),
    ("ring6", "block", {"hand": HandTable(kind="allegro"), "arm": ArmTable(kind="panda")}),
    ("contour-first", "beer_bottle", {}), ("ring6", "wedge", {"arm": ArmTable(kind="none")})]


def same(a: Any, b: Any) -> bool:
    """Also where a column holds arrays, or numbers that are not."""
    if isinstance(a, np.ndarray) and a.dtype == object:
        return len(a) == len(b) and all(map(same, a, b))
    return bool(np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f"))


@pytest.mark.parametrize(("name", "of", "tables"), [
    *QUICK, *(pytest.param(name, "block", tables, marks=pytest.mark.slow)
              for name in STRATEGIES for tables in ({}, LEAP))])
def test_rows_are_those_of_the_cpu(name: str, of: str, tables: dict[str, Any]) -> None:
    cell = Cell(STRATEGIES[name], {"name": of}, of, **tables)
    here = run_episodes(cell, np.arange(2), "cpu")
    with other_device() as device:
        there = run_episodes(cell, np.arange(2), device)
    assert not {"strategy_failed", "crashed"} & set(there["status"])
    assert [column for column in here if not same(here[column], there[column])] == []
