"""Points a body is scored by."""

import numpy as np
from scipy.stats import qmc

from warpgrasp.body_sample import sobol_points


def test_sobol_points_are_scipys() -> None:
    assert np.array_equal(sobol_points(12), qmc.Sobol(3, scramble=False).random_base2(12))
