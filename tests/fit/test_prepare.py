"""Sets made ready for a batch: which covariances are none, and how many are fitted at a time."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from fit import prepare
from fit.fit_status import FitStatus
from fit.plane import fit_plane
from fit.prepare import _semidefinite
from fit.revolution.fit import fit_revolution
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.record import SuperquadricOptions


def test_semidefinite_is_told_as_by_eigenvalues() -> None:
    """Needles, discs, points and what is none of them, of every size."""
    rng = np.random.default_rng(12)
    turn = np.linalg.qr(rng.normal(size=(4000, 3, 3)))[0]
    variance = rng.choice([1.0, 1e-3, 1e-8, 0.0, -1e-10, -1e-4, -1.0], (4000, 3))
    variance *= 10.0 ** rng.uniform(-20, 5, (4000, 1))
    matrix = np.einsum("nij,nj,nkj->nik", turn, variance, turn)
    least, most = variance.min(1), variance.max(1)
    told = _semidefinite(matrix)
    clear = (np.abs(least) > 1e-10 * np.abs(variance).max(1)) | (least == 0.0)
    assert (told == ((least >= -1e-6 * most) & (most >= 0.0)))[clear].all()


def test_a_point_that_is_repeated_counts_once() -> None:
    rng = np.random.default_rng(6)
    points = rng.normal(size=(3, 8, 3))
    points[1, 7], points[2, 4:] = points[1, 2], points[2, :4]
    repeated = np.stack([of_set[rng.permutation(80)] for of_set in np.repeat(points, 10, axis=1)])
    ok, few = FitStatus.converged, FitStatus.too_few_points
    for given in (points, repeated):
        assert prepare.prepare(given, None).status.tolist() == [ok, few, few]
        assert prepare.prepare(given, None, least_points=4, solid=False).status.tolist() == [ok] * 3


def test_sets_fitted_in_parts_are_those_fitted_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of seven, of sets in two buckets and one that cannot be fitted; starts go with them."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(20, 40, 3)) * [0.02, 0.03, 0.05] + [0.4, 0.0, 0.1]
    mask = np.arange(40) < np.where(np.arange(20) % 3 == 0, 40, 24)[:, None]
    mask[4] = False
    options = SuperquadricOptions(iterations=3)
    rough = SuperquadricOptions(iterations=0)

    def fitted() -> list:
        start = fit_superquadric(points, mask, table_z=0.0, options=rough)
        return [fit_superquadric(points, mask, table_z=0.0, options=options, start=start),
                fit_plane(points, mask)]

    whole = fitted()
    monkeypatch.setattr(prepare, "SETS_AT_ONCE", 7)
    for one, other in zip(whole, fitted(), strict=True):
        for field in fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


@pytest.mark.parametrize(("table", "found"), [
    (0.0, FitStatus.converged), (0.05, FitStatus.converged), (-0.4, FitStatus.converged),
    (5.0, FitStatus.bad_points), (0.11, FitStatus.bad_points), (-50.0, FitStatus.bad_points)])
def test_a_table_that_no_touches_stand_on_is_a_status(table: float, found: FitStatus) -> None:
    """Of its own set alone; a set that cannot be fitted for another reason keeps that one."""
    points = np.random.default_rng(9).uniform(-1, 1, (3, 20, 3)) * [0.03, 0.04, 0.05] + [0, 0, 0.05]
    points[2] = points[2, :1]
    heights = np.array([0.0, table, table])
    for status in (fit_superquadric(points, table_z=heights).status,
                   fit_revolution(points, table_z=heights).status):
        assert status[0] in (FitStatus.converged, FitStatus.not_converged)
        assert (status[1] == FitStatus.bad_points) == (found == FitStatus.bad_points)
        assert status[2] == FitStatus.degenerate_point


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("fit", [fit_plane, fit_revolution, fit_superquadric])
def test_masked_and_complex_touches_are_refused(fit: Any) -> None:
    """What lies under a mask would be fitted, and an imaginary part dropped."""
    points = np.random.default_rng(0).normal(size=(1, 20, 3))
    hidden = np.ma.masked_array(points, mask=np.zeros_like(points, bool))
    hidden[0, 3] = np.ma.masked
    with pytest.raises(ValueError, match="points: has masked values, should be a plain array"):
        fit(hidden)
    with pytest.raises(ValueError, match="mask: has masked values"):
        fit(points, np.ma.masked_array(np.ones((1, 20), bool), mask=np.arange(20)[None] < 2))
    with pytest.raises(ValueError, match="points: has complex numbers, should have real ones"):
        fit(points + 1j)


@pytest.mark.parametrize(("wrong", "said"), [
    ({"table_z": [0, 0, 0]}, r"table_z: shape \(3,\), should be one number or \(2\)"),
    ({"free_points": np.zeros((2, 4, 3)), "free_radius": np.ones(3)},
     r"free_radius: shape \(3,\), should be one number or \(2, 4\)")])
def test_heights_and_radii_for_other_sets_are_named(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        prepare.prepare(np.random.default_rng(0).normal(size=(2, 20, 3)), None, **wrong)
