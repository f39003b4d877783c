"""The strategy for objects of any shape: it finds what rings about the prior do not."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import belief

from strategies.foresight.occupancy import Prospect
from strategies.planners.any_object import LOOKED_AT, AnyObject, _Asked, _made
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
    for poses in (0, 1.5, True, "4"):
        with pytest.raises(ValueError, match="should be a whole number from 1 to 16"):
            AnyObject(poses=poses)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="candidates is 1; should be a whole number from 4 to"):
        AnyObject(candidates=1)
    with pytest.raises(ValueError, match="paths is 'wide'; should be 'in-turn' or 'matched'"):
        AnyObject(paths="wide")


def test_a_first_look_keeps_the_poses_that_promise_most_in_their_order() -> None:
    rng = np.random.default_rng(1)
    gain = rng.uniform(size=(2, LOOKED_AT + 40, 4))
    poses = np.tile(np.arange(gain.shape[1], dtype=float)[:, None], (2, 1, 7))
    kept = AnyObject._best_looking(poses, 0.0, np.ones(2, bool), lambda some, wanted: Prospect(
        np.zeros(some.shape[:2]), gain, np.zeros((*gain.shape, 3))))[..., 0].astype(int)
    for world, numbers in enumerate(kept):
        best = np.argsort(gain[world].sum(1))[-LOOKED_AT:]
        assert numbers.tolist() == sorted(best)
    few = poses[:, :LOOKED_AT]
    assert AnyObject._best_looking(few, 0.0, np.ones(2, bool),
                                   lambda *_: pytest.fail("nothing is left out")) is few


@pytest.mark.slow
def test_matched_paths_are_in_each_world_those_that_promise_most() -> None:
    """Several paths in one step, a world at most one of them, and not by the batch."""
    table = family_table("hammer-1")
    assert table is not None
    wide = replace(STRATEGIES["any-object"], touches=28, closings=("curl40", "from10", "from25"))
    matched = replace(wide, options=(("candidates", 4096), ("paths", "matched")))
    cell = Cell(matched, table, "hammer-1", seed=4, fit=FIT)
    block = run_block(cell, np.arange(2), "cpu", curve=False)
    by_step: dict[int, list[np.ndarray]] = {}
    for procedure in block.exploration.procedures:
        by_step.setdefault(procedure.step, []).append(procedure.took_part)
    assert max(map(len, by_step.values())) > 1
    assert all(np.sum(took, axis=0).max() <= 1 for took in by_step.values())
    assert block.touched.min() > 0.05
    rows = run_episodes(cell, np.arange(2), "cpu")
    alone = run_episodes(cell, np.arange(1, 2), "cpu")
    for name in ("touches", "touched10mm", "chamfer_mm", "robot_time_s", "contacts"):
        assert rows[name][1] == alone[name][0], name
    assert (rows["touched10mm"] == block.touched).all()


def test_what_grasps_told_is_learned_where_those_of_worlds_that_ended_were_not_made() -> None:
    """Three grasps asked for, of which the second was not made: its world ended before."""
    felt = belief(np.zeros((2, 16, 3)))
    asked = [_Asked(path, np.zeros((2, 2, 7)), np.repeat([[world == 0], [world == 1]], 2, 1),
                    np.ones((2, 2, 4), bool), np.zeros(2))
             for path, world in ((0, 0), (1, 1), (2, 0))]
    over = felt.with_active(np.array([True, False]))
    assert [(a.closing, first) for a, first in _made(asked, 0, over)] == [(0, 0), (2, 8)]
    longer = replace(felt, evidence=belief(np.zeros((2, 24, 3))).evidence)
    assert [(a.closing, first) for a, first in _made(asked, 0, longer)] == [
        (0, 0), (1, 8), (2, 16)]


@pytest.mark.slow
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


@pytest.mark.slow
def test_where_touches_are_limited_fingers_that_would_find_little_stay_open() -> None:
    """And cost nothing: more poses are made of as many touches. Time is spent by poses."""
    limited = replace(STRATEGIES["any-object"], touches=32)
    timed = replace(STRATEGIES["any-object"], touches=None, robot_time_s=40.0)
    closed = []
    for strategy in (limited, timed):
        table = family_table("hammer-1")
        assert table is not None
        block = run_block(Cell(strategy, table, "hammer-1", seed=4, fit=FIT), np.arange(2), "cpu")
        grasps = [p.felt for p in block.exploration.procedures]
        assert all(isinstance(g, Grasps) for g in grasps)
        made = np.concatenate([was_made(g.closing.status)[:, :, 0] for g in grasps], 1)
        closed.append(made[made.any(2)].sum(1))
    assert closed[0].min() >= 1
    assert closed[0].mean() < 3.0
    assert (closed[1] == 4).all()


@pytest.mark.slow
def test_gaussian_process_plans_with_the_free_form_that_it_recovers() -> None:
    """About a superquadric it finds nothing of a hammer's head."""
    table = family_table("hammer-1")
    assert table is not None
    short = replace(STRATEGIES["gaussian-process"], touches=40)
    cell = Cell(short, table, "hammer-1", seed=4, fit=replace(FIT, reconstruct="implicit"))
    rows = run_episodes(cell, np.arange(6), "cpu")
    about_model = run_episodes(replace(cell, fit=FIT), np.arange(6), "cpu")
    assert rows["touched10mm"].min() > 0.2 > 2.0 * about_model["touched10mm"].max()
    assert rows["chamfer_mm"].mean() < 0.5 * about_model["chamfer_mm"].mean()
    alone = run_episodes(cell, np.arange(1, 2), "cpu")
    for name in ("touches", "touched10mm", "chamfer_mm", "robot_time_s", "contacts"):
        assert rows[name][1] == alone[name][0], name
