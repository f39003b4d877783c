"""Planners whose poses nothing felt changes: their order, and that it does not depend on when their
bodies are fitted."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import belief
from scipy.spatial.transform import Rotation

from strategies.planners.adaptive import GreedyCoverage
from strategies.planners.from_strategy import fits_on_way
from strategies.planners.probes import Grasp
from strategies.planners.register import Planner
from strategies.planners.registry import make_planner
from strategies.planners.unguided import EvenPoses, RandomPose, Unguided, far_from_taken
from strategies.ready_made import STRATEGIES
from strategies.recovery.belief import Belief
from sweeps.episode.episodes import run_episodes
from sweeps.spec.cell import Cell


def grasp(planner: Planner, here: Belief) -> tuple[np.ndarray, np.ndarray]:
    """Hand poses and which of them are wanted, as the planner answers."""
    probe, = planner(here)
    assert isinstance(probe, Grasp)
    assert probe.wanted is not None
    return probe.hand_pose, probe.wanted


def test_even_poses_take_the_farthest_first_and_none_twice() -> None:
    planner, here = EvenPoses(), belief()
    taken: list[np.ndarray] = []
    for step in range(6):
        taken.append(grasp(planner, replace(here, step=step))[0][:, 0])
    chosen = np.stack(taken, 1)
    for world in range(2):
        apart = np.linalg.norm(chosen[world, :, None, :3] - chosen[world, None, :, :3], axis=-1)
        turned = np.abs(np.einsum("ik,jk->ij", chosen[world, :, 3:], chosen[world, :, 3:])) < 0.999
        assert ((apart > 0.01) | turned | np.eye(6, dtype=bool)).all()


def test_poses_are_apart_by_place_approach_and_half_of_the_turn_about_it() -> None:
    """A tenth of a metre counts as much as a radian."""
    rng = np.random.default_rng(2)
    turn = Rotation.random(12, rng).as_matrix()
    poses = np.concatenate([rng.normal(0.0, 0.1, (12, 3)), Rotation.from_matrix(turn).as_quat()], 1)
    taken = np.arange(12) < 3
    place = np.concatenate([10.0 * poses[:, :3], turn[:, :, 2], 0.5 * turn[:, :, 0]], axis=1)
    expected = [min(np.linalg.norm(one - other) for other in place[taken]) for one in place]
    np.testing.assert_allclose(far_from_taken(poses[None], taken[None])[0], expected, atol=1e-12)
    assert (far_from_taken(poses[None], np.zeros((1, 12), bool)) == 1.0).all()


def test_random_draws_depend_on_world_and_step_alone() -> None:
    here = belief()
    one, other = make_planner("random", {}), make_planner("random", {})
    first, again = grasp(one, here)[0], grasp(other, here)[0]
    assert np.array_equal(first, again)
    assert not np.array_equal(first, grasp(one, replace(here, step=1))[0])


@pytest.mark.parametrize("kind", [EvenPoses, RandomPose])
def test_many_poses_at_once_are_those_of_single_steps(kind: type[Unguided]) -> None:
    """As many as 20 touches have room for, eight each: two for half of them, then three for as many
    again; none of a world that has ended."""
    here = replace(belief(), touches_left=np.array([20, 96]), active=np.array([True, False]))
    single, many = kind(), kind()
    many.at_once = None
    for count in (2, 3):
        poses, wanted = grasp(many, here)
        assert wanted.tolist() == [[True] * count, [False] * count]
        for place in range(count):
            np.testing.assert_array_equal(grasp(single, here)[0][0, 0], poses[0, place])


def test_every_pose_in_reach_is_taken_once() -> None:
    planner, here = RandomPose(), belief()
    planner.at_once = None
    for poses, wanted in zip(*grasp(planner, here), strict=True):
        assert len(np.unique(poses[wanted].round(9), axis=0)) == wanted.sum() > 10
    assert not grasp(planner, here)[1].any()


def test_what_is_felt_does_not_depend_on_when_bodies_are_fitted() -> None:
    """Of one fit halfway and one at the end there are two points, the last of which is the row's.
    """
    rows = []
    for every in (0, 1):
        strategy = replace(STRATEGIES["even"], refit_every=every, touches=40)
        rows.append(run_episodes(Cell(strategy, {"name": "block"}, "block", seed=4), np.arange(3),
                                 "cpu"))
    seldom, each = rows
    for name in ("touches", "contacts", "probes", "unreachable", "collisions", "touched10mm",
                 "robot_time_s", "arm_path_m"):
        np.testing.assert_allclose(seldom[name], each[name], rtol=1e-12, err_msg=name)
    assert {len(curve) for curve in seldom["curve_touches"]} == {2}
    assert min(len(curve) for curve in each["curve_touches"]) > 3
    np.testing.assert_array_equal([curve[-1] for curve in seldom["curve_chamfer_mm"]],
                                  seldom["chamfer_mm"])


def test_a_budget_of_time_is_looked_at_after_every_pose() -> None:
    strategy = replace(STRATEGIES["random"], touches=None, robot_time_s=40.0)
    planner = RandomPose()
    assert fits_on_way(strategy, planner)
    assert not fits_on_way(STRATEGIES["random"], planner)
    assert fits_on_way(replace(STRATEGIES["random"], refit_every=2), planner)
    assert fits_on_way(replace(STRATEGIES["random"], volume_ratio=1.5), planner)
    assert fits_on_way(STRATEGIES["coverage"], GreedyCoverage())
