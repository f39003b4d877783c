"""The strategy for objects of any shape: it finds what rings about the prior do not."""

from dataclasses import replace

import numpy as np
import pytest

from strategies.planners.any_object import AnyObject
from strategies.ready_made import STRATEGIES
from strategies.strategy import Strategy
from sweeps.episode.episodes import run_block, run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.motion_cost import was_made
from warpgrasp.objects.families import family_table
from warpgrasp.parameters import FitTable
from warpgrasp.robot import Grasps

FIT = FitTable(taper=False, rivals=False, rounds=0)


def episodes(strategy: Strategy, name: str, numbers: np.ndarray) -> dict[str, np.ndarray]:
    table = family_table(name)
    assert table is not None
    return run_episodes(Cell(strategy, table, name, seed=4, fit=FIT), numbers, "cpu")


def test_options_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match="poses is 0; should be from 1 to 16"):
        AnyObject(poses=0)
    with pytest.raises(ValueError, match="candidates is 1; should be from 4 to 65536"):
        AnyObject(candidates=1)


def test_it_finds_a_hammer_that_rings_miss_and_not_by_the_batch() -> None:
    short = replace(STRATEGIES["any-object"], touches=32)
    rows = episodes(short, "hammer-1", np.arange(8))
    rings = episodes(STRATEGIES["rim6-ring12"], "hammer-1", np.arange(8))
    assert ((rows["touches"] >= 32) & (rows["touches"] < 36)).all(), "the last pose is whole"
    assert rows["touched10mm"].mean() > 2.0 * rings["touched10mm"].mean()
    assert rows["touched10mm"].min() > 0.05
    alone = episodes(short, "hammer-1", np.arange(1, 2))
    for name in ("touches", "touched10mm", "chamfer_mm", "robot_time_s", "contacts"):
        assert rows[name][1] == alone[name][0], name


def test_where_touches_are_limited_fingers_that_would_find_little_stay_open() -> None:
    """And cost nothing: more poses are made of as many touches. Time is spent by poses."""
    limited = replace(STRATEGIES["any-object"], touches=32)
    timed = replace(STRATEGIES["any-object"], touches=None, robot_time_s=40.0)
    closed = []
    for strategy in (limited, timed):
        table = family_table("hammer-1")
        assert table is not None
        block = run_block(Cell(strategy, table, "hammer-1", seed=4, fit=FIT), np.arange(4), "cpu")
        grasps = [p.felt for p in block.exploration.procedures]
        assert all(isinstance(g, Grasps) for g in grasps)
        made = np.concatenate([was_made(g.closing.status)[:, :, 0] for g in grasps], 1)
        closed.append(made[made.any(2)].sum(1))
    assert closed[0].min() >= 1
    assert closed[0].mean() < 3.0
    assert (closed[1] == 4).all()


def test_gaussian_process_plans_with_the_free_form_that_it_recovers() -> None:
    """About a superquadric it finds nothing of a hammer's head."""
    table = family_table("hammer-1")
    assert table is not None
    short = replace(STRATEGIES["gaussian-process"], touches=40)
    cell = Cell(short, table, "hammer-1", seed=4, fit=replace(FIT, reconstruct="implicit"))
    rows = run_episodes(cell, np.arange(3), "cpu")
    about_model = run_episodes(replace(cell, fit=FIT), np.arange(3), "cpu")
    assert rows["touched10mm"].min() > 0.2 > 2.0 * about_model["touched10mm"].max()
    assert rows["chamfer_mm"].mean() < 0.5 * about_model["chamfer_mm"].mean()
    alone = run_episodes(cell, np.arange(1, 2), "cpu")
    for name in ("touches", "touched10mm", "chamfer_mm", "robot_time_s", "contacts"):
        assert rows[name][1] == alone[name][0], name
