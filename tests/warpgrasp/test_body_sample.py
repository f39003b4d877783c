"""Points a body is scored by."""

import numpy as np
import pytest
from scipy.stats import qmc

from warpgrasp.body import Body, Part
from warpgrasp.body_sample import sample_body, sobol_points
from warpgrasp.scene import Shape


def test_sobol_points_are_scipys() -> None:
    assert np.array_equal(sobol_points(12), qmc.Sobol(3, scramble=False).random_base2(12))


def test_a_sample_is_of_its_bodys_own_box() -> None:
    """Of one shape, in a box that holds it and in one that cuts it: two samples."""
    ball = (Part(Shape.SPHERE, size_m=(0.03, 0.0, 0.0)),)
    whole = sample_body(Body("whole", ball, (-0.03, -0.03, 0.0), (0.03, 0.03, 0.06)))
    half = sample_body(Body("half", ball, (-0.03, -0.03, 0.0), (0.03, 0.03, 0.03)))
    assert whole.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.03**3, rel=0.01)
    assert half.volume_m3 < 0.6 * whole.volume_m3
