"""The check of free forms: what it compares, and that it would notice."""

import numpy as np
import pytest

from sweeps.validate.bodies import free_forms


@pytest.fixture
def one_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_forms, "SHAPES", ("funnel",))


def test_a_shape_is_recovered_from_its_true_contacts(one_shape: None) -> None:
    chamfer, bands = free_forms.compare_free_forms()
    assert chamfer.ok
    assert chamfer.difference < 0.0015
    assert bands.ours > 0.8


def test_contacts_that_are_not_of_the_shape_break_the_bound(
        one_shape: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_forms, "SIGMA_M", 0.012)
    assert not free_forms.compare_free_forms()[0].ok


def test_touches_are_spread_over_the_whole_shape() -> None:
    body = free_forms.shape("mug-1")
    points, normals = free_forms.touches(body, np.random.default_rng(0))
    assert points.shape == normals.shape == (free_forms.SETS, free_forms.TOUCHES, 3)
    apart = np.linalg.norm(points[0][:, None] - points[0][None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    assert apart.min() > 0.005
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(1.0)
