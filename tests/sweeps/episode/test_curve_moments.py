"""Curves of episodes: those of the bodies that are scored, whatever makes them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strategies.poses.waypoints import BoundingCylinder
from strategies.ready_made import STRATEGIES
from sweeps.episode.curve_moments import CURVES, GROWTH, Grown, Moment, curves, no_scores
from sweeps.episode.episodes import run_block, run_episodes
from sweeps.episode.given_prior import prior_recovered
from sweeps.spec.cell import Cell
from sweeps.spec.object_sets import member_table
from warpgrasp.parameters import FitTable

EPISODES = np.arange(2)
CELL = Cell(replace(STRATEGIES["coverage"], touches=40), {"name": "block"}, "block", seed=5)
MUG = replace(CELL, object_name="mug-1", body_table=member_table("mug-1"),
              strategy=replace(CELL.strategy, touches=24))
NOTHING = prior_recovered(BoundingCylinder(*np.ones((4, 1))))
BALL = '''
import numpy as np

def ball(touches):
    middle = (touches.low_m + touches.high_m) / 2
    return lambda points, worlds: np.linalg.norm(
        points - middle[worlds][:, None], axis=2) - 0.03

def broken(touches):
    raise RuntimeError("no weights")
'''


def rows(word: str, cell: Cell = CELL, episodes: np.ndarray = EPISODES) -> dict[str, np.ndarray]:
    return run_episodes(replace(cell, fit=FitTable(reconstruct=word)), episodes, "cpu")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file of functions that recover bodies."""
    (tmp_path / "mine.py").write_text(BALL)
    return tmp_path / "mine.py"


@pytest.fixture(scope="module")
def plain() -> dict[str, np.ndarray]:
    """Rows whose curves are those of superquadrics."""
    return rows("superquadric")


def test_a_curve_is_that_of_the_body_scored(file: Path, plain) -> None:
    """A body that is the same whatever was felt has the same error at each point of its curve."""
    found = rows(f"{file}:ball")
    for world in EPISODES:
        error, touches = found["curve_chamfer_mm"][world], found["curve_touches"][world]
        assert error[-1] == found["chamfer_mm"][world] != plain["chamfer_mm"][world]
        np.testing.assert_allclose(error, found["chamfer_mm"][world], rtol=0.03)  # rougher scores
        assert touches[-1] == found["touches"][world]
        assert len(touches) >= 4
        assert (touches[1:-1] >= GROWTH * touches[:-2]).all()
        assert set(zip(touches, found["curve_time_s"][world], strict=True)) <= set(
            zip(plain["curve_touches"][world], plain["curve_time_s"][world], strict=True))


@pytest.mark.slow
def test_a_point_is_what_an_episode_would_score_that_ended_there() -> None:
    """Episodes of a budget of touches are the beginnings of those of a larger one."""
    long = rows("implicit", MUG, EPISODES[1:])
    number = len(long["curve_touches"][0]) // 2
    budget = int(long["curve_touches"][0][number])
    short = rows("implicit", replace(MUG, strategy=replace(CELL.strategy, touches=budget)),
                 EPISODES[1:])
    assert short["touches"][0] == budget
    assert long["curve_chamfer_mm"][0][number] == pytest.approx(
        short["chamfer_mm"][0], rel=0.1)  # the last fit of an episode is a finer one


def test_where_no_body_is_made_the_curve_is_the_models(file: Path, plain) -> None:
    found = rows(f"{file}:broken")
    for world in EPISODES:
        kept = np.isin(plain["curve_time_s"][world], found["curve_time_s"][world])
        for name in CURVES:
            np.testing.assert_array_equal(found[name][world], plain[name][world][kept])


@pytest.mark.slow
def test_worlds_have_the_curves_that_they_have_alone() -> None:
    every = rows("chosen", MUG)
    alone = rows("chosen", MUG, EPISODES[1:])
    for name in CURVES:
        np.testing.assert_array_equal(every[name][1], alone[name][0])


def test_touches_have_grown_when_they_are_half_as_many_again() -> None:
    grown = Grown(2)
    found = [grown(np.array(touches)).tolist() for touches in ([0, 8], [8, 11], [11, 12], [12, 17])]
    assert found == [[False, True], [True, False], [False, True], [True, False]]


def test_a_neighbours_step_takes_no_point_away() -> None:
    """A world that sits out a step has the same touches and time again, and makes no body."""
    def moment(touches: float, made: bool) -> Moment:
        scores = replace(no_scores(1), chamfer_m=np.full(1, touches), iou=np.ones(1))
        return Moment(0, np.array([touches]), np.array([touches]), no_scores(1), NOTHING,
                      np.zeros(1), scores, np.array([made]))

    found = curves([moment(8, True), moment(8, False), moment(20, True)], 1)
    assert list(found["curve_touches"][0]) == [8, 20]
    assert list(found["curve_chamfer_mm"][0]) == [8e3, 20e3]


def test_without_curves_nothing_is_made_on_the_way() -> None:
    block = run_block(replace(CELL, fit=FitTable(reconstruct="implicit")), EPISODES, "cpu",
                      curve=False)
    assert all(moment.rebuilt is None for moment in block.moments)
