"""Some rows of a record, and other rows put into it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from fit.arrays import joined, row_medians, row_products, row_sums, rows_of, with_rows


class _Pair(NamedTuple):
    left: np.ndarray
    right: np.ndarray


@dataclass(frozen=True)
class _Part:
    wide: np.ndarray


@dataclass(frozen=True)
class _Record:
    number: np.ndarray
    pair: _Pair
    part: _Part
    radius_m: float
    nothing: np.ndarray | None = None


def _record(worlds: int, begin: float = 0.0) -> _Record:
    number = begin + np.arange(float(worlds))
    wide = number[:, None] * [1.0, 10.0]
    return _Record(number, _Pair(-number, wide), _Part(2 * wide), 0.008)


def test_rows_of_every_array_are_picked_and_the_rest_stays() -> None:
    some = rows_of(_record(4), np.array([3, 1]))
    assert some.number.tolist() == [3.0, 1.0]
    assert some.pair.left.tolist() == [-3.0, -1.0]
    assert some.part.wide.tolist() == [[6.0, 60.0], [2.0, 20.0]]
    assert (some.radius_m, some.nothing) == (0.008, None)
    assert rows_of(None, np.array([0])) is None


def test_rows_are_put_into_every_array_of_a_copy() -> None:
    whole, part = _record(4), _record(2, begin=100.0)
    changed = with_rows(whole, np.array([2, 0]), part)
    assert changed.number.tolist() == [101.0, 1.0, 100.0, 3.0]
    assert changed.pair.right[:, 1].tolist() == [1010.0, 10.0, 1000.0, 30.0]
    assert changed.part.wide[0].tolist() == [202.0, 2020.0]
    assert whole.number.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_what_was_picked_can_be_put_back() -> None:
    record, rows = _record(5), np.array([False, True, True, False, True])
    again = with_rows(record, rows, rows_of(record, rows))
    assert np.array_equal(again.pair.right, record.pair.right)
    assert np.array_equal(again.part.wide, record.part.wide)


def test_parts_joined_are_the_whole() -> None:
    record = _record(5)
    again = joined([rows_of(record, slice(0, 2)), rows_of(record, slice(2, None))])
    assert np.array_equal(again.pair.right, record.pair.right)
    assert np.array_equal(again.part.wide, record.part.wide)


def test_sums_of_rows_do_not_hang_on_what_they_are_padded_with() -> None:
    values = np.random.default_rng(5).random((50, 23))
    assert row_sums(values) == pytest.approx(values.sum(1), rel=1e-12)
    for fill in (0.0, np.nan):
        wide = np.pad(values, ((0, 0), (0, 9)), constant_values=fill)
        assert np.array_equal(row_sums(wide), row_sums(values))
    assert np.array_equal(row_sums(np.zeros((3, 0))), np.zeros(3))


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


def test_products_of_rows_do_not_depend_on_their_padding() -> None:
    """BLAS sums short and long products in other orders, on some processors."""
    rng = np.random.default_rng(4)
    for points in (1, 31, 32, 37, 96):
        a, b = rng.normal(size=(3, points, 15)), rng.normal(size=(3, points, 2))
        padded = [np.concatenate([v, np.zeros((3, 300 - points, v.shape[2]))], axis=1)
                  for v in (a, b)]
        assert np.array_equal(row_products(a, b), row_products(*padded))
        np.testing.assert_allclose(row_products(a, b), np.einsum("rpi,rpj->rij", a, b), rtol=1e-12,
                                   atol=1e-13)


def test_rows_without_values_have_no_median() -> None:
    assert np.isnan(row_medians(np.zeros((3, 0)))).all()
    assert row_medians(np.zeros((0, 0))).shape == (0,)
