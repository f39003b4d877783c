"""Sets made ready for a batch: which covariances are none."""

import numpy as np

from fit.prepare import _semidefinite


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
