"""The quality table and equivariance of many bodies: slow; run with -s to see the figures."""

import numpy as np
import pytest
from quality_bodies import standing_bodies, touches, volume_iou

from fit.rotation import matrix_of_quaternion
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import superquadric_inside_outside, superquadric_surface
from fit.superquadric.record import SuperquadricOptions

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("count", "noise", "evidence", "options", "outliers", "median", "p10", "least"),
    [
        (60, 1e-3, {"table_z": 0.0}, {}, 0.0, 0.97, 0.95, 0.88),
        (30, 2e-3, {"table_z": 0.0}, {}, 0.0, 0.90, 0.82, 0.75),
        (60, 1e-3, {}, {}, 0.0, 0.94, 0.77, 0.45),
        (60, 1e-3, {"table_z": 0.0}, {"loss": "cauchy"}, 0.1, 0.95, 0.92, 0.85),
        (30, 2e-3, {"table_z": 0.0}, {"upright_std_rad": None}, 0.0, 0.90, 0.82, 0.65),
    ],
    ids=["plane", "few-and-noisy", "no-plane", "outliers", "few-and-noisy-may-lean"],
)
def test_quality_table(count, noise, evidence, options, outliers, median, p10, least) -> None:
    rng = np.random.default_rng(2024)
    body = standing_bodies(100, rng)
    points = touches(body, count, noise, rng, outliers=outliers)
    found = fit_superquadric(points, **evidence, options=SuperquadricOptions(**options))
    iou = volume_iou(body, found)
    print(f"\nmedian {np.median(iou):.3f}, p10 {np.quantile(iou, 0.1):.3f}, min {iou.min():.3f}")
    assert np.median(iou) >= median
    assert np.quantile(iou, 0.1) >= p10
    assert iou.min() >= least


def test_a_rigid_motion_and_a_scale_move_the_fit_with_them() -> None:
    rng = np.random.default_rng(3)
    body = standing_bodies(64, rng)
    points = touches(body, 60, 1e-3, rng)
    here = fit_superquadric(points)
    surface, _, _ = superquadric_surface(here, 200)
    q = rng.normal(size=4)
    turn = matrix_of_quaternion(q / np.linalg.norm(q))
    shift, scale = np.array([0.3, -0.2, 0.5]), 2.5
    moved = fit_superquadric(points @ turn.T + shift)
    grown = fit_superquadric(points * scale)
    size = here.size_m.max(axis=1)[:, None]
    apart = np.abs(superquadric_inside_outside(moved, surface @ turn.T + shift) - 1) * size
    larger = np.abs(superquadric_inside_outside(grown, surface * scale) - 1) * size
    for name, gap in (("rigid motion", apart), ("scale", larger)):
        worst = gap.max(axis=1)
        print(f"\n{name}: median {np.median(worst):.1e} m, p90 {np.quantile(worst, 0.9):.1e} m, "
              f"max {worst.max():.1e} m")
    assert apart.max() < 1e-6
    assert larger.max() < 1e-6
