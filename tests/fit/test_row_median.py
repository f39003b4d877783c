"""Medians of rows with gaps."""

import numpy as np

from fit.row_median import row_medians


def test_medians_are_those_of_numpy_to_the_last_bit() -> None:
    rng = np.random.default_rng(2)
    for width in (1, 2, 7, 64):
        values = rng.normal(size=(50, width)) * 10.0 ** rng.integers(-8, 3, size=(50, 1))
        values[rng.uniform(size=values.shape) < 0.4] = np.nan
        values[:, 0] = np.where(np.isnan(values).all(axis=1), 1.0, values[:, 0])
        assert np.array_equal(row_medians(values), np.nanmedian(values, axis=1))


def test_a_row_of_gaps_has_no_median() -> None:
    medians = row_medians(np.array([[np.nan, np.nan], [1.0, np.nan], [1.0, 3.0]]))
    assert np.array_equal(medians, [np.nan, 1.0, 2.0], equal_nan=True)
