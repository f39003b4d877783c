"""Grids of a Gaussian process: sure where a ball was felt all over, the given grid elsewhere."""

import numpy as np
from scipy.special import logit

from fit.implicit.known import KnownProcess, fit_known
from fit.implicit.record import ImplicitFit
from strategies.foresight.occupancy import CELLS, Occupancy, begin_occupancy
from strategies.foresight.process_occupancy import HARDLY, occupancy_by_process
from strategies.poses.waypoints import BoundingCylinder

PROCESS = KnownProcess(length_m=0.05)
RADIUS_M = 0.008
MIDDLE, BALL_M = np.array([0.45, 0.0, 0.06]), 0.035


def prior(worlds: int) -> BoundingCylinder:
    one = np.ones(worlds)
    return BoundingCylinder(0.45 * one, 0.0 * one, 0.14 * one, 0.10 * one)


def centres(grid: Occupancy) -> np.ndarray:
    """Of the cells of the first world, (x, y, z, 3) [m]."""
    at = np.stack(np.meshgrid(*map(np.arange, CELLS), indexing="ij"), -1) + 0.5
    return grid.corner_m[0] + at * grid.cell_m[0]


def felt_ball(count: int, upper: bool = False) -> ImplicitFit:
    """A ball felt at `count` places all over it, or over its upper half."""
    way = np.random.default_rng(4).normal(size=(1, count, 3))
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    if upper:
        way[..., 2] = np.abs(way[..., 2])
    return fit_known(MIDDLE + BALL_M * way, np.ones((1, count), bool), way,
                     np.full((1, count), 0.0005), PROCESS)


def seen(fit: ImplicitFit) -> tuple[Occupancy, Occupancy, np.ndarray, np.ndarray]:
    """The grid given, that of the process, what touches are worth, and distances from the ball."""
    given = begin_occupancy(prior(2), RADIUS_M)
    grid, worth = occupancy_by_process(given, fit, np.array([1]), PROCESS)
    return given, grid, worth, np.linalg.norm(centres(grid) - MIDDLE, axis=-1).ravel() - BALL_M


def test_a_ball_felt_all_over_is_where_it_is() -> None:
    _, grid, worth, away = seen(felt_ball(150))
    believed = grid.believed[1].ravel()
    # A ball of a link's radius touches what is nearer than that to its middle.
    assert believed[np.abs(away) < RADIUS_M - 0.004].min() > 0.9
    assert believed[(away > RADIUS_M + 0.006) & (away < 0.02)].max() < 0.1
    assert worth[1][np.abs(away) < 0.003].max() < 0.4
    assert worth.min() >= 0.0
    assert worth.max() <= 1.0


def test_what_was_not_felt_stays_as_it_was_given() -> None:
    given, grid, worth, away = seen(felt_ball(80, upper=True))
    place = centres(grid).reshape(-1, 3)
    far = np.linalg.norm(place - MIDDLE, axis=-1) > 0.16
    np.testing.assert_allclose(grid.believed[1].ravel()[far], given.believed[1].ravel()[far],
                               atol=0.06)
    assert worth[1][far].min() > 0.9
    on = np.abs(away) < 0.004
    below, above = (worth[1][on & (side * (place[:, 2] - MIDDLE[2]) > 0.02)].mean()
                    for side in (-1, 1))
    assert below > 1.5 * above


def test_worlds_not_asked_for_and_fits_of_nothing_change_nothing() -> None:
    given, grid, worth, _ = seen(felt_ball(2))  # too few touches for a body
    np.testing.assert_allclose(grid.believed, given.believed, atol=1e-6)
    np.testing.assert_array_equal(worth, 1.0)
    _, other, _, _ = seen(felt_ball(150))
    np.testing.assert_array_equal(other.believed[0], given.believed[0])
    assert (given.believed == begin_occupancy(prior(2), RADIUS_M).believed).all()


def test_pooled_opinions_are_the_mean_of_the_logarithms_of_their_odds() -> None:
    given, alone, worth, _ = seen(felt_ball(150))
    pooled, also = occupancy_by_process(given, felt_ball(150), np.array([1]), PROCESS,
                                        pooled=True)
    blocks = given.believed[1].reshape(20, 2, 20, 2, 14, 2).max((1, 3, 5)) > HARDLY
    asked = blocks.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    assert 0.05 < asked.mean() < 0.95
    one, other, both = (np.clip(grid.believed[1].astype(float), 1e-9, 1 - 1e-7)
                        for grid in (given, alone, pooled))
    inner = asked & (np.abs(other - 0.5) < 0.49)
    np.testing.assert_allclose(logit(both)[inner], (0.5 * (logit(one) + logit(other)))[inner],
                               atol=0.02)
    np.testing.assert_array_equal(pooled.believed[1][~asked], given.believed[1][~asked])
    np.testing.assert_allclose(also[1].reshape(CELLS)[inner], worth[1].reshape(CELLS)[inner],
                               atol=0.3)  # deviations between nodes lean on those not asked about
