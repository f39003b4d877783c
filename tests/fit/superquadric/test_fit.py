"""The batch fit: quality, invariances, bad sets; on small batches."""

from dataclasses import replace

import numpy as np
import pytest
from quality_bodies import standing_bodies, touches, volume_iou

from fit.fit_status import FitStatus
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import (
    superquadric,
    superquadric_inside_outside,
    superquadric_points,
    superquadric_volume,
)
from fit.superquadric.record import SuperquadricFit, SuperquadricOptions
from fit.superquadric.uncertainty import superquadric_uncertainty

RNG_SEED = 11


@pytest.fixture(scope="module")
def sets():
    rng = np.random.default_rng(RNG_SEED)
    body = standing_bodies(8, rng)
    return body, touches(body, 60, 1e-3, rng)


@pytest.fixture(scope="module")
def fitted(sets) -> SuperquadricFit:
    return fit_superquadric(sets[1], table_z=0.0)


def same_bits(a: SuperquadricFit, b: SuperquadricFit) -> bool:
    return all(np.array_equal(value, vars(b)[name]) for name, value in vars(a).items())


def test_recovers_bodies_from_sixty_touches(sets, fitted) -> None:
    iou = volume_iou(sets[0], fitted)
    assert np.median(iou) > 0.95
    assert iou.min() > 0.88
    assert (fitted.status == FitStatus.converged).all()
    assert (fitted.rms_m < 1.3e-3).all()


def test_a_finish_goes_on_where_the_descent_settled(fitted) -> None:
    """Begun anew with the damping of a first start it took twelve iterations and more."""
    assert np.median(fitted.iterations) <= 8


@pytest.mark.slow
def test_a_converged_fit_stays_where_it_is() -> None:
    """A round of steps refused for being too long is no optimum: it was taken for one in a fit of
    twelve, whose cost could still fall by more than a tenth in one of twenty."""
    rng = np.random.default_rng(5)
    points = np.zeros((120, 20, 3))
    for number in range(len(points)):
        size = rng.uniform(0.015, 0.09, 3)
        body = superquadric(size, rng.uniform(0.05, 1.8, 2), [0.0, 0.0, size[2]])
        on = superquadric_points(body, 600)[0]
        on = on[on[:, 2] > size[2]] if number % 2 else on
        points[number] = on[rng.permutation(len(on))[:20]]
    points += rng.normal(0.0, 1e-3, points.shape)
    found = fit_superquadric(points, table_z=0.0, options=SuperquadricOptions(taper=True))
    longer = fit_superquadric(points, table_z=0.0, options=SuperquadricOptions(
        taper=True, round_iterations=12, iterations=240))
    converged = found.status == FitStatus.converged
    assert converged.mean() > 0.8
    assert (found.cost <= longer.cost * 1.001)[converged].all()


def test_a_fit_may_be_left_where_its_cost_hardly_falls(sets, fitted) -> None:
    left = fit_superquadric(sets[1], table_z=0.0, options=SuperquadricOptions(least_fall=1e-5))
    assert (left.status == FitStatus.converged).all()
    assert (left.iterations <= fitted.iterations).all()
    assert left.iterations.mean() < 0.8 * fitted.iterations.mean()
    assert (left.cost <= fitted.cost * (1.0 + 1e-4)).all()
    assert np.abs(left.size_m - fitted.size_m).max() < 1e-5


def test_padding_order_and_neighbours_change_no_bit(sets, fitted) -> None:
    points = sets[1]
    padded = np.full((8, 100, 3), np.nan)
    mask = np.zeros((8, 100), bool)
    order = np.random.default_rng(0).permutation(100)[:60]
    padded[:, order], mask[:, order] = points, True
    assert same_bits(fit_superquadric(padded, mask, table_z=0.0), fitted)
    alone = fit_superquadric(points[3:4], table_z=0.0)
    assert same_bits(alone, fitted[3:4])


def test_an_upright_cylinder_has_small_e1_and_round_e2() -> None:
    body = superquadric([0.03, 0.03, 0.05], [0.1, 1.0], [0.45, 0.0, 0.05])
    rng = np.random.default_rng(5)
    found = fit_superquadric(touches(body, 100, 2e-4, rng), table_z=0.0)
    upright = superquadric_inside_outside(found, np.array([[[0.45, 0.0, 0.1]]]))
    assert upright == pytest.approx(1, abs=0.03)
    assert found.exponents[0] == pytest.approx([0.1, 1.0], abs=0.1)


def test_bad_sets_have_a_status_and_finite_rows_and_spoil_nobody(sets, fitted) -> None:
    good = sets[1][0]
    line = np.linspace(0, 1, 60)[:, None] * [0.1, 0.05, 0.02]
    flat = good * [1, 1, 0]
    nan, infinite = good.copy(), good.copy()
    nan[7, 1], infinite[3, 2] = np.nan, np.inf
    one = np.tile(good[:1], (60, 1))
    points = np.stack([good, line, flat, nan, infinite, one, good, good])
    mask = np.ones((8, 60), bool)
    mask[6, 5:] = False
    mask[7] = False
    found = fit_superquadric(points, mask, table_z=0.0)
    assert [FitStatus(s).name for s in found.status] == [
        "converged", "degenerate_line", "degenerate_plane", "bad_points", "bad_points",
        "degenerate_point", "too_few_points", "too_few_points"]
    assert all(np.isfinite(value).all() for value in vars(found).values())
    assert same_bits(found[0:1], fitted[0:1])


@pytest.mark.slow
def test_taper_and_bend_are_found() -> None:
    rng = np.random.default_rng(2)
    body = standing_bodies(4, rng, taper=0.6, bend=6.0)
    found = fit_superquadric(touches(body, 120, 5e-4, rng), table_z=0.0,
                             options=SuperquadricOptions(taper=True, bend=True))
    assert np.median(volume_iou(body, found)) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("residual", ["solina_box", "volume_distance"])
def test_a_face_that_was_felt_is_no_pyramid_on_its_tip(residual) -> None:
    """Touches on a block's top alone: nothing tells how its sides go down, so they go as they may.

    Before the box's factor the tapers were all 1.
    """
    rng = np.random.default_rng(6)
    points = np.concatenate([rng.uniform([-0.11, -0.08], [0.11, 0.08], (12, 60, 2)),
                             np.full((12, 60, 1), 0.12)], axis=2)
    points += 5e-4 * rng.normal(size=points.shape)
    found = fit_superquadric(points, table_z=0.0, options=SuperquadricOptions(
        taper=True, residual=residual, loss="cauchy"))
    assert np.abs(found.taper).max() < 0.45
    volume = np.prod(2.0 * found.size_m, axis=1) * (1.0 + np.prod(found.taper, axis=1) / 3.0)
    assert np.median(volume) > 0.7 * 0.22 * 0.16 * 0.12


@pytest.mark.slow
def test_outliers_with_a_robust_loss(sets) -> None:
    rng = np.random.default_rng(RNG_SEED)
    points = touches(sets[0], 60, 1e-3, rng, outliers=0.1)
    found = fit_superquadric(points, table_z=0.0, options=SuperquadricOptions(loss="cauchy"))
    assert np.quantile(volume_iou(sets[0], found), 0.1) > 0.85


def test_normals_that_err_do_not_shrink_a_box() -> None:
    """A wrong normal pulls its plane inwards whichever way it errs, by its error times the arm."""
    rng = np.random.default_rng(7)
    half = np.array([0.03, 0.04, 0.05])
    points = rng.uniform(-1.0, 1.0, (16, 60, 3))
    fit, row, axis = np.arange(16)[:, None], np.arange(60), np.arange(60) % 3
    points[fit, row, axis] = np.where(rng.random((16, 60)) < 0.5, -1.0, 1.0)
    normals = np.zeros(points.shape)
    normals[fit, row, axis] = points[fit, row, axis]
    normals += np.radians(5) * rng.normal(size=normals.shape)
    points = points * half + [0, 0, 0.05] + 1e-3 * rng.normal(size=points.shape)
    blind = superquadric_volume(fit_superquadric(points, table_z=0.0))
    for options, most in ((SuperquadricOptions(), 0.007),
                          (SuperquadricOptions(normal_std_rad=np.radians(5)), 0.004)):
        for covariance in (None, np.broadcast_to(1e-6 * np.eye(3), (16, 60, 3, 3))):
            told = fit_superquadric(points, normals=normals, table_z=0.0, options=options,
                                    covariance=covariance)
            assert np.abs(np.median(np.log(superquadric_volume(told) / blind))) < most
    with pytest.raises(ValueError, match=r"normal_std_rad: -1\.0, should be"):
        SuperquadricOptions(normal_std_rad=-1.0)


@pytest.mark.slow
def test_covariance_and_free_balls_and_normals_run_and_help_or_do_no_harm(sets) -> None:
    body, points = sets
    rng = np.random.default_rng(1)
    poor = points.copy()
    poor[:, ::3] += 8e-3 * rng.normal(size=poor[:, ::3].shape)
    covariance = np.broadcast_to(np.eye(3) * 1e-8, (8, 60, 3, 3)).copy()
    covariance[:, ::3] = np.eye(3) * 64e-6
    known = volume_iou(body, fit_superquadric(poor, covariance=covariance, table_z=0.0))
    blind = volume_iou(body, fit_superquadric(poor, table_z=0.0))
    assert np.median(known) > np.median(blind)
    free = np.array([[0.45, 0.0, 0.2], [0.6, 0.1, 0.05]])
    found = fit_superquadric(points, table_z=0.0, free_points=np.tile(free, (8, 1, 1)),
                             free_radius=0.008)
    assert np.median(volume_iou(body, found)) > 0.95


def test_touches_without_noise_are_fitted_and_impossible_noise_is_named(sets) -> None:
    points = np.concatenate([sets[1][:2]] * 2)
    covariance = np.zeros((4, 60, 3, 3))
    covariance[1] = np.diag([1e-6, 0.0, 0.0])  # known to the last digit along two axes
    covariance[2, 7] = -1e-4 * np.eye(3)
    covariance[3, 7] = [[0, 1e-6, 0], [1e-6, 0, 0], [0, 0, 0]]
    evidence = {"covariance": covariance, "table_z": 0.0}
    found = fit_superquadric(points, options=SuperquadricOptions(sigma_floor_m=0.0), **evidence)
    assert set(found.status[:2]) <= {FitStatus.converged, FitStatus.not_converged}
    assert set(found.status[2:]) == {FitStatus.bad_points}
    known = superquadric_uncertainty(found, points, sigma_floor_m=0.0, **evidence)
    assert all(np.isfinite(value).all() for value in vars(found).values())
    # What is no fit has no uncertainty either.
    for name, value in vars(known).items():
        assert np.isfinite(value[:2]).all(), name
    assert np.isnan(known.volume_m3[2:]).all()
    assert np.isnan(known.covariance[2:]).all()
    assert volume_iou(superquadric(*(v[:1] for v in sets[0])), found[:1]) > 0.9


def test_numbers_that_no_touch_can_have_spoil_nobody(sets, fitted) -> None:
    points = sets[1][:3].copy()
    far = np.array([0.0, 1e200, 0.0])
    found = fit_superquadric(points, table_z=far)
    assert found.status[1] == FitStatus.bad_points
    assert all(np.isfinite(value).all() for value in vars(found).values())
    assert same_bits(found[[0, 2]], fitted[[0, 2]])


@pytest.mark.usefixtures("unchecked")
def test_unknown_words_are_named() -> None:
    with pytest.raises(ValueError, match="residual: 'Solina', should be one of solina, solina_box"):
        SuperquadricOptions(residual="Solina")  # pyright: ignore
    with pytest.raises(ValueError, match="loss: 'huber', should be one of none, pseudo_huber"):
        SuperquadricOptions(loss="huber")  # pyright: ignore


def test_a_fit_goes_on_from_a_former_one_and_fits_without_one_are_screened(sets, fitted) -> None:
    body, points = sets
    former = fit_superquadric(points[:, :50], table_z=0.0)
    former.status[2] = FitStatus.bad_points
    found = fit_superquadric(points, table_z=0.0, start=former)
    assert volume_iou(body, found).min() > 0.88
    assert same_bits(found[2:3], fitted[2:3])
    alone = fit_superquadric(points[5:6], table_z=0.0, start=former[5:6])
    assert same_bits(alone, found[5:6])
    again = fit_superquadric(points, table_z=0.0, start=fitted)
    assert np.allclose(again.position_m, fitted.position_m, atol=1e-5)
    assert (again.cost <= fitted.cost * 1.01).all()
    others = fit_superquadric(points, table_z=0.0, start=fitted[::-1])
    assert not np.isclose(others.cost, fitted.cost, rtol=0.01).all()
    with pytest.raises(ValueError, match="start: 3 fits for 8 sets"):
        fit_superquadric(points, start=former[:3])


@pytest.mark.usefixtures("unchecked")
def test_wrong_shapes_are_named() -> None:
    with pytest.raises(ValueError, match="points: shape"):
        fit_superquadric(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="covariance: shape"):
        fit_superquadric(np.zeros((1, 9, 3)), covariance=np.zeros((1, 9, 3)))


@pytest.mark.parametrize("field", ["size_m", "position_m", "quaternion_xyzw"])
def test_a_start_that_is_not_finite_is_none(sets, fitted, field: str) -> None:
    """It is screened as without a start; the others go on from theirs."""
    broken = vars(fitted)[field].copy()
    broken[1] = np.nan
    found = fit_superquadric(sets[1], table_z=0.0, start=replace(fitted, **{field: broken}))
    assert all(np.isfinite(value).all() for value in vars(found).values())
    assert same_bits(found[1], fitted[1])
    assert same_bits(found[2:], fit_superquadric(sets[1], table_z=0.0, start=fitted)[2:])


@pytest.mark.usefixtures("unchecked")
def test_a_start_that_is_no_fit_is_refused(sets) -> None:
    with pytest.raises(ValueError, match="start: int, should be a SuperquadricFit"):
        fit_superquadric(sets[1], start=3)  # type: ignore
