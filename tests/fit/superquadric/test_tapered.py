"""Tapered bodies of the paper's database: a triangular wedge and a funnel's cone."""

import numpy as np
import pytest

from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import superquadric_inside_outside
from fit.superquadric.record import SuperquadricOptions

pytestmark = pytest.mark.slow
N, COUNT, NOISE = 40, 60, 2e-3


def wedge(rng):
    """Touches on the side faces of a ridge 60 x 60 x 100 mm, none on the lowest tenth."""
    z = 0.1 * (1 - 0.9 * np.sqrt(rng.random((N, COUNT))))
    side = rng.choice([-1.0, 1.0], (N, COUNT))
    wide = 0.03 * (1 - z / 0.1)
    # Two slopes 104.4 x 60 mm, two triangles 60 x 100 mm: even over their areas.
    z_slope = rng.uniform(0.01, 0.1, (N, COUNT))
    slope = rng.random((N, COUNT)) < 0.66
    on_slope = np.stack([side * 0.03 * (1 - z_slope / 0.1), rng.uniform(-0.03, 0.03, (N, COUNT)),
                         z_slope], axis=2)
    on_end = np.stack([rng.uniform(-1, 1, (N, COUNT)) * wide, side * 0.03, z], axis=2)
    return np.where(slope[..., None], on_slope, on_end)


def in_wedge(p):
    return ((np.abs(p[:, 1]) < 0.03) & (p[:, 2] > 0)
            & (np.abs(p[:, 0]) < 0.03 * (1 - p[:, 2] / 0.1)))


def funnel(rng):
    """Touches on a cone 16 mm wide below and 80 mm above, 120 mm high."""
    z = 0.012 + 0.108 * np.sqrt(rng.random((N, COUNT)))
    turn = rng.uniform(-np.pi, np.pi, (N, COUNT))
    radius = 0.008 + 0.032 * z / 0.12
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=2)


def in_funnel(p):
    return ((p[:, 2] > 0) & (p[:, 2] < 0.12)
            & (np.hypot(p[:, 0], p[:, 1]) < 0.008 + 0.032 * p[:, 2] / 0.12))


@pytest.mark.parametrize(("touch", "inside"), [(wedge, in_wedge), (funnel, in_funnel)],
                         ids=["wedge", "funnel"])
@pytest.mark.parametrize(("upright", "least"), [({}, 0.90), ({"upright_std_rad": None}, 0.88)],
                         ids=["stands", "may-lean"])
def test_tapered_bodies(touch, inside, upright, least) -> None:
    rng = np.random.default_rng(0)
    points = touch(rng) + NOISE * rng.normal(size=(N, COUNT, 3))
    options = SuperquadricOptions(taper=True, **upright)
    found = fit_superquadric(points, table_z=0.0, options=options)
    samples = rng.uniform([-0.07, -0.07, -0.02], [0.07, 0.07, 0.14], (20000, 3))
    true = inside(samples)
    ours = superquadric_inside_outside(found, np.tile(samples, (N, 1, 1))) < 1
    iou = (true & ours).sum(axis=1) / (true | ours).sum(axis=1)
    print(f"\nmedian {np.median(iou):.3f}, p10 {np.quantile(iou, 0.1):.3f}, min {iou.min():.3f}")
    assert np.median(iou) >= least
