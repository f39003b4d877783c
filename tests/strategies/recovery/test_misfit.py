"""Where a body is doubted its rival is asked, and the nearer one stays."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import BODY, belief, on_side
from scipy import stats

from fit.superquadric.fit import fit_superquadric
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.misfit import FARTHEST_M, doubt, schwarz, touch_misfit
from warpgrasp.parameters import FitTable


def test_misfit_is_the_capped_mean_distance() -> None:
    evidence = belief(on_side(0, 360)).evidence
    fits = fit_superquadric(evidence.points_m, evidence.mask, table_z=0.0)
    assert (touch_misfit(fits, evidence) < 1e-3).all()
    needle = replace(fits, size_m=fits.size_m * [1e-3, 1e-3, 1.0])
    assert np.allclose(touch_misfit(needle, evidence), FARTHEST_M)
    failed = replace(fits, status=np.array([fits.status[0], 99]))
    assert np.isinf(touch_misfit(failed, evidence)).tolist() == [False, True]


def test_a_sheet_is_doubted_however_near_it_lies() -> None:
    evidence = belief(on_side(0, 360)).evidence
    fits = fit_superquadric(evidence.points_m, evidence.mask, table_z=0.0)
    np.testing.assert_array_equal(doubt(fits, evidence), touch_misfit(fits, evidence))
    assert np.isinf(doubt(replace(fits, size_m=fits.size_m * [1e-3, 1.0, 1.0]), evidence)).all()


def test_a_doubted_body_is_never_farther_from_its_touches_with_rivals() -> None:
    rng = np.random.default_rng(11)
    z = rng.uniform(0.0, 0.12, (2, 40))
    radius = np.where(z < 0.05, 0.006, 0.04)  # what no superquadric is
    angle = rng.uniform(0, 1.5, z.shape)
    points = BODY.position_m[:, None] + np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), z - 0.07], -1)
    evidence = belief(points).evidence
    plain, placed = recover_bodies(evidence, None, FitTable(rivals=False))
    tried, where = recover_bodies(evidence, None, FitTable())
    assert (touch_misfit(tried, where) <= touch_misfit(plain, placed) + 1e-12).all()


def test_schwarz_weighs_laplaces_likelihood_against_parameters() -> None:
    """Differences of twice the logarithm, at the likeliest scale: the mean distance."""
    rng = np.random.default_rng(7)

    def known(distance_m: np.ndarray, parameters: int) -> tuple[float, float]:
        misfit, count = float(np.abs(distance_m).mean()), len(distance_m)
        likely = stats.laplace.logpdf(distance_m, scale=misfit).sum()
        return (schwarz(misfit, count, parameters, 1e-4),
                -2.0 * likely + parameters * np.log(count))

    (one, own), (other, its) = (known(rng.laplace(scale=scale, size=40), parameters)
                                for scale, parameters in ((0.001, 15), (0.0015, 11)))
    assert one - other == pytest.approx(own - its)
    assert schwarz(1e-5, 40, 11, 1e-3) == schwarz(9e-4, 40, 11, 1e-3)
