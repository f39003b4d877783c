"""Occupancy grids: what evidence does to cells, and what is foreseen of a body that is sure."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from fit.rotation import matrix_of_quaternion
from strategies.foresight.hand_samples import SweptFingers, reached_place, samples_of_hand
from strategies.foresight.occupancy import CELLS, Occupancy, begin_occupancy
from strategies.poses.waypoints import BoundingBox, BoundingCylinder
from warpgrasp.parameters import HandTable

HAND = HandTable()
RADIUS_M = HAND.link_radius_m
CLOSINGS = ("curl40", "base_then_curl")
DOWN = [1.0, 0.0, 0.0, 0.0]
"""Half a turn about x: the hand's approach points down."""


def prior(worlds: int = 1) -> BoundingCylinder:
    one = np.ones(worlds)
    return BoundingCylinder(0.45 * one, 0.0 * one, 0.05 * one, 0.10 * one)


def centres(grid: Occupancy) -> np.ndarray:
    """Of the cells of the first world, (x, y, z, 3) [m]."""
    at = np.stack(np.meshgrid(*map(np.arange, CELLS), indexing="ij"), -1) + 0.5
    return grid.corner_m[0] + at * grid.cell_m[0]


def nearest(grid: Occupancy, point: list[float]) -> float:
    away = np.linalg.norm(centres(grid) - point, axis=-1)
    return float(grid.believed[0].reshape(-1)[away.argmin()])


def learn(grid: Occupancy, contact: list[float] | None = None, normal: tuple = (0, 0, 1)) -> None:
    grid.learn_touches(np.array([[contact or [0, 0, 0]]], float), np.array([[normal]], float),
                       np.array([[1.0 if contact else 0.0]]))


def freed(grid: Occupancy, free: np.ndarray) -> None:
    """An open hand of balls at `free` (world, ball, 3), one of them a pose."""
    one = np.zeros((1, 3))
    fingers = SweptFingers(np.zeros((1, 1, 1, 3)), np.ones((1, 1), bool), np.zeros((1, 1, 1)),
                           np.ones(1, int), np.full(1, -1))
    pose = np.concatenate([free, np.tile([0.0, 0.0, 0.0, 1.0], (*free.shape[:2], 1))], -1)
    grid.learn_swept(one, fingers, pose, np.ones(free.shape[:2], bool),
                     np.zeros((*free.shape[:2], 1), int))


def test_the_prior_falls_from_its_axis_to_nothing_outside() -> None:
    grid = begin_occupancy(prior(), RADIUS_M)
    along = [nearest(grid, [0.45 + out, 0.0, 0.05]) for out in (0.0, 0.02, 0.04, 0.06)]
    assert (np.diff(along) < 0.0).all()
    assert along[0] > 0.5
    assert nearest(grid, [0.45, 0.0, 0.12]) < 0.5 * along[0]
    c = prior()
    turned = BoundingBox(c.x_m, c.y_m, c.radius_m, c.height_m, np.array([[0.05, 0.01]]),
                         np.array([np.pi / 2]))
    box = begin_occupancy(turned, RADIUS_M)
    assert nearest(box, [0.45, 0.025, 0.05]) > nearest(box, [0.475, 0.0, 0.05])


def test_what_is_felt_moves_beliefs_the_right_way() -> None:
    grid = begin_occupancy(prior(), RADIUS_M)
    before, above = grid.believed.copy(), nearest(grid, [0.45, 0.0, 0.075])
    learn(grid, [0.45, 0.0, 0.06])
    assert nearest(grid, [0.45, 0.0, 0.055]) > 0.9  # below a contact whose normal points up
    assert nearest(grid, [0.45, 0.0, 0.075]) < 0.5 * above
    far = np.linalg.norm(centres(grid) - [0.45, 0.0, 0.06], axis=-1) > 0.08
    np.testing.assert_array_equal(grid.believed[0][far], before[0][far])
    freed(grid, np.array([[[0.45, 0.0, 0.055]]]))
    assert nearest(grid, [0.45, 0.0, 0.055]) < 0.2  # where a link has been is nothing
    learn(grid, [0.45, 0.0, 0.06])
    assert nearest(grid, [0.45, 0.0, 0.055]) < 0.2


def test_a_pose_that_was_barred_is_foreseen_to_be_barred() -> None:
    grid = begin_occupancy(prior(), RADIUS_M)
    samples = samples_of_hand(HAND, CLOSINGS)
    pose = np.array([[[0.42, 0.01, 0.18, *DOWN], [0.42, 0.01, 0.36, *DOWN]]])
    wanted = np.ones((1, 2), bool)
    worth = np.ones_like(grid.hit)

    def barred() -> np.ndarray:
        return grid.foresee(samples.open_m, samples.swept[0], pose, wanted, worth, 0.0).barred[0]

    first = barred()
    assert 0.05 < first[0] < 0.9
    assert first[1] == 0.0
    grid.learn_barred(samples.open_m, pose, np.array([[True, False]]))
    assert 0.75 <= barred()[0] < 1.0  # as believed of the likeliest cells, and by what else is met


def test_cells_that_may_have_barred_the_hand_are_raised_by_bayes_rule_and_once() -> None:
    """All cells are as likely, but for one that is nearly sure not to be."""
    grid = begin_occupancy(prior(), RADIUS_M)
    unlikely, likely = 0.001, 0.05
    grid.hit[:] = likely
    across = np.array([4.0 * grid.cell_m[0], 0.0, 0.0])
    open_m = np.array([np.zeros(3), [0.0, 0.0, 0.0005], across])
    places = centres(grid).reshape(-1, 3)
    first = np.linalg.norm(places - [0.45, 0.0, 0.05], axis=1).argmin()
    cells = [np.linalg.norm(places - places[first] - off, axis=1).argmin() for off in (0.0, across)]
    pose = np.array([[[*places[first], 0.0, 0.0, 0.0, 1.0]]])
    grid.hit[0, cells[1]] = unlikely
    before = grid.hit.copy()
    grid.learn_barred(open_m, pose, np.ones((1, 1), bool))
    foreseen = 1.0 - (1.0 - likely) ** 2 * (1.0 - unlikely)  # fewer balls than places: all count
    raised = grid.hit[0, cells]
    assert raised[0] == pytest.approx(0.75, abs=1e-6)
    assert raised[1] == pytest.approx(unlikely / foreseen, rel=1e-5)
    others = np.ones(grid.hit.shape[1], bool)
    others[cells] = False
    np.testing.assert_array_equal(grid.hit[0, others], before[0, others])


def test_what_bars_the_hand_where_nothing_was_believed_is_believed_after() -> None:
    """A prior that is too narrow: what the hand struck beside it is learned all the same."""
    grid = begin_occupancy(prior(), RADIUS_M)
    samples = samples_of_hand(HAND, CLOSINGS)
    pose, wanted = np.array([[[0.33, 0.0, 0.16, *DOWN]]]), np.ones((1, 1), bool)
    worth = np.ones_like(grid.hit)

    def barred() -> float:
        return grid.foresee(samples.open_m, samples.swept[0], pose, wanted, worth,
                            0.0).barred[0, 0]

    assert barred() < 0.05
    grid.learn_barred(samples.open_m, pose, wanted)
    assert barred() > 0.5


def test_a_first_look_finds_what_a_close_one_does() -> None:
    grid = begin_occupancy(prior(), RADIUS_M)
    samples = samples_of_hand(HAND, CLOSINGS)
    draw = np.random.default_rng(3)
    pose = np.tile([0.45, 0.0, 0.15, *DOWN], (1, 400, 1))
    pose[..., :3] += draw.normal(0.0, 0.05, (1, 400, 3))
    every, worth = np.ones((1, 400), bool), np.ones_like(grid.hit)
    close, first = (grid.foresee(some.open_m, some.swept[0], pose, every, worth, 0.0)
                    .gain.sum(-1)[0] for some in (samples, samples.thinned))
    kept = np.argsort(-first)[:40]
    assert close[kept].max() > 0.9 * close.max()
    assert close[kept].mean() > 0.8 * np.sort(close)[-40:].mean()


def test_links_free_all_cells_near_where_they_have_been() -> None:
    """Beside the distances of all cells from all balls, one by one: the open hand where it came in,
    and there the fingers as far as they closed."""
    draw = np.random.default_rng(11)
    grid = begin_occupancy(prior(2), RADIUS_M)
    samples = samples_of_hand(HAND, CLOSINGS)
    swept = samples.swept[1]
    pose = np.tile([0.45, 0.0, 0.15, *DOWN], (2, 3, 1))
    pose[..., :3] += draw.normal(0.0, 0.04, (2, 3, 3))
    came = np.array([[True, False, True], [False, True, False]])
    until = np.where(came[..., None], draw.integers(0, 40, (2, 3, 4)), 0)
    grid.learn_swept(samples.open_m, swept, pose, came, until)
    for world in range(2):
        balls = []
        for p in np.flatnonzero(came[world]):
            own = [samples.open_m] + [swept.balls_m[f, :until[world, p, f]].reshape(-1, 3)
                                      for f in range(4)]
            turn = matrix_of_quaternion(pose[world, p, 3:])
            balls.append(np.concatenate(own) @ turn.T + pose[world, p, :3])
        away = KDTree(np.concatenate(balls)).query(centres(grid).reshape(-1, 3))[0]
        cap = np.clip((away - 0.5 * grid.cell_m[world]) / 0.012, 0.0, 1.0)
        # A cell beyond those that are a reach away along an axis is left out, if it is near one.
        sure = (cap < 0.7) | (cap == 1.0)
        np.testing.assert_allclose(grid.cap[world][sure], cap[sure], atol=1e-6)
        assert (cap < 0.7).sum() > 3000
    with pytest.raises(ValueError, match="place 57: wants 0 to 56"):
        grid.learn_swept(samples.open_m, swept, pose, came, until * 0 + 57)


def test_touches_of_a_sure_body_are_foreseen_on_it_and_count_as_they_are_worth() -> None:
    """A post that the fingers stand around: each meets it, and rests a radius from its side."""
    grid = begin_occupancy(prior(), RADIUS_M)
    x, y, z = np.moveaxis(centres(grid), -1, 0)
    post = 0.015
    gap = np.hypot(x - 0.45, y) - post
    grid.hit[:] = ((gap < RADIUS_M) & (z < 0.10 + RADIUS_M)).reshape(1, -1)
    samples = samples_of_hand(HAND, CLOSINGS)
    pose = np.array([[[0.45, 0.0, 0.17, *DOWN]]])
    wanted = np.ones((1, 1), bool)
    none = np.ones_like(grid.hit)
    seen = grid.foresee(samples.open_m, samples.swept[1], pose, wanted, none, 0.0)
    assert seen.barred[0, 0] == 0.0
    met = seen.gain[0, 0] > 0.5
    assert met[[1, 3]].all()  # the middle finger and the thumb; the outer two may pass beside it
    away = np.hypot(seen.place_m[0, 0, met, 0] - 0.45, seen.place_m[0, 0, met, 1]) - post
    np.testing.assert_allclose(away, RADIUS_M, atol=1.8 * grid.cell_m[0])
    there = seen.place_m[0, 0][met]
    apart = KDTree(there).query(centres(grid).reshape(-1, 3))[0]
    worth = np.clip((apart - RADIUS_M) / 0.020, 0.0, 1.0)[None].astype(np.float32)
    again = grid.foresee(samples.open_m, samples.swept[1], pose, wanted, worth, 0.0)
    assert again.gain.sum() < 0.2 * seen.gain.sum()


def test_a_world_does_not_depend_on_those_beside_it() -> None:
    draw = np.random.default_rng(5)
    samples = samples_of_hand(HAND, CLOSINGS)
    pose = np.tile([0.45, 0.0, 0.15, *DOWN], (3, 8, 1))
    pose[..., :3] += draw.normal(0.0, 0.03, (3, 8, 3))
    contact = [0.45, 0.0, 0.05] + draw.normal(0.0, 0.02, (3, 4, 3))
    normal = np.tile([0.0, 0.0, 1.0], (3, 4, 1))
    free = [0.45, 0.0, 0.08] + draw.normal(0.0, 0.03, (3, 50, 3))

    def gains(rows: slice) -> np.ndarray:
        grid = begin_occupancy(prior(len(pose[rows])), RADIUS_M)
        ones = np.ones(contact[rows].shape[:2])
        grid.learn_touches(contact[rows], normal[rows], ones)
        freed(grid, free[rows])
        grid.learn_barred(samples.open_m, pose[rows, :1], ones[:, :1] > 0)
        return grid.foresee(samples.open_m, samples.swept[0], pose[rows],
                            np.ones(pose[rows].shape[:2], bool), np.ones_like(grid.hit), 0.01).gain

    np.testing.assert_array_equal(gains(slice(0, 3))[1:2], gains(slice(1, 2)))


def test_where_a_finger_stopped_is_read_from_its_joints() -> None:
    swept = samples_of_hand(HAND, CLOSINGS).swept[0]
    finger = np.array([0, 1, 2, 3])
    place = np.array([0, 5, 20, 31])
    q = swept.joints_rad[finger, place] + np.radians(0.3)
    np.testing.assert_array_equal(reached_place(swept, finger, q), place)
    both = reached_place(swept, finger, np.stack([q, swept.joints_rad[:, 7]]))
    np.testing.assert_array_equal(both, [place, [7] * 4])


def test_the_lowest_place_of_a_hand_that_points_down_is_a_fingertip() -> None:
    samples = samples_of_hand(HAND, CLOSINGS)
    length = sum(HAND.link_length_m)
    back = HAND.abduction_offset_m + np.cos(np.radians(10)) * length + RADIUS_M
    np.testing.assert_allclose(samples.outermost_m[:, 2].max() + RADIUS_M, back, atol=1e-9)


def test_a_grid_that_would_not_learn_is_refused() -> None:
    """Kernels write to NumPy's arrays: to a copy of one, what is learned would be lost."""
    grid = begin_occupancy(prior(), RADIUS_M)
    grid.hit = grid.hit.astype(float)
    with pytest.raises(ValueError, match=r"hit: float64 .* should be contiguous float32"):
        learn(grid, [0.45, 0.0, 0.06])


@pytest.mark.parametrize(("name", "wrong", "told"), [
    ("meets", np.array([1]), "meets 1: wants -1 to 0"), ("met", np.array([8]), "met 8: wants 0 to"),
    ("met", np.zeros(2, int), r"met: .* should be \(finger 1,\)"),
    ("feels", np.ones((1, 3), bool), r"feels: .* should be \(finger 1, ball 2\)")])
def test_fingers_meet_others_that_there_are(name: str, wrong: np.ndarray, told: str) -> None:
    """Kernels read places of a path and fingers by these numbers."""
    given = {"balls_m": np.zeros((1, 7, 2, 3)), "feels": np.ones((1, 2), bool),
             "joints_rad": np.zeros((1, 7, 1)), "met": np.full(1, 7), "meets": np.full(1, -1)}
    SweptFingers(**given)
    with pytest.raises(ValueError, match=told):
        SweptFingers(**given | {name: wrong})
