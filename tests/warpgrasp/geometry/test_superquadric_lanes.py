"""Eight points side by side against one at a time: elements, distances and signed distances of
scores, which take the one way for plain bodies on a CPU and the other for all else."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sweeps.episode.scores as scores
import sweeps.episode.surface_elements as elements
from fit.superquadric.geometry import Superquadric, superquadric, superquadric_inside_outside
from warpgrasp.core.kernel_launch import launch
from warpgrasp.core.lanes import LANES
from warpgrasp.geometry.body_sampling import BodySample, sample_body
from warpgrasp.objects.catalogue import body_from_name

WORLDS = 120


def bodies(taper: float = 0.74) -> Superquadric:
    """Of all exponents, beside and about a block."""
    rng = np.random.default_rng(7)
    turn = rng.normal(size=(WORLDS, 4))
    return superquadric(
        rng.uniform(0.008, 0.08, (WORLDS, 3)), rng.uniform(0.1, 1.95, (WORLDS, 2)),
        rng.normal(0.0, 0.03, (WORLDS, 3)) + [0.0, 0.0, 0.06],
        turn / np.linalg.norm(turn, axis=1, keepdims=True),
        rng.uniform(-taper, taper, (WORLDS, 2)))


@pytest.fixture
def one_by_one(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Kernels told to take one point at a time, from a call of this on."""
    def alone(kernel: Any, extents: Any, shapes: Any, given: dict[str, Any], **how: Any) -> None:
        launch(kernel, extents, shapes, given | ({"lanes": False} if "lanes" in given else {}),
               **how)

    def begin() -> None:
        monkeypatch.setattr(scores, "launch", alone)
        monkeypatch.setattr(elements, "launch", alone)

    return begin


@pytest.fixture(scope="module")
def sample() -> BodySample:
    return sample_body(body_from_name("block"), surface=2048, inside=3072)


def not_plain() -> Superquadric:
    """Bodies of which only one at a time can be taken: tapered to a thin end across one axis, and
    bent."""
    taper = np.tile([[0.9, 0.1], [0.1, -0.9], [0.2, 0.2]], (WORLDS // 3, 1))
    bend = np.tile([[0.0, 0.0], [0.0, 0.0], [4.0, 0.5]], (WORLDS // 3, 1))
    return bodies()._replace(taper=taper, bend=bend)


@pytest.mark.parametrize("made", [bodies, not_plain])
def test_scores_are_the_same_side_by_side_and_one_by_one(
    made: Callable[[], Superquadric], one_by_one, sample: BodySample
) -> None:
    body = made()
    found = []
    for begin in (lambda: None, one_by_one):
        begin()
        on = elements.surface_elements(body, 1536, device="cpu", graded=True)
        found.append((*on, scores._distance_to_superquadrics(sample, on, body, "cpu"),
                      scores._signed_distance(body, sample, "cpu")))
    for name, here, there, atol in zip(("point", "normal", "area", "away", "signed"), *found, (
            1e-14, 1e-8, 1e-15, 1e-11, 1e-13), strict=True):
        if name == "signed":  # of what is far inside the sign alone is known
            here, there = (np.clip(v, -sample.ramp_m, None) for v in (here, there))
        if name == "away":  # which element is nearest is found within a tenth of a micrometre
            assert (np.abs(here - there) > atol).mean() < 1e-4
            atol = 1e-7
        np.testing.assert_allclose(here, there, rtol=1e-11, atol=atol, err_msg=name)


def test_signs_are_those_of_the_inside_outside_function(sample: BodySample) -> None:
    body = bodies()
    signed = scores._signed_distance(body, sample, "cpu")
    radius = superquadric_inside_outside(body, np.tile(sample.about_m, (WORLDS, 1, 1)))
    near = np.abs(radius - 1.0) > 1e-6
    straight = np.abs(body.taper).max(1) < 0.5  # a gauge tapered more folds beside its thin end
    assert ((signed < 0.0) == (radius < 1.0))[straight][near[straight]].mean() > 0.999


@pytest.mark.parametrize("count", [1, LANES - 1, LANES + 1])
def test_numbers_that_are_no_multiple_of_lanes(count: int) -> None:
    """Directions at the ends of a grid: the last block is not full, and the middle of a face has
    axes on which nothing is."""
    body = superquadric(np.full((1, 3), 0.03), np.array([[0.1, 1.9]]), np.zeros((1, 3)),
                        np.array([[0.0, 0.0, 0.0, 1.0]]))
    on = elements.surface_elements(body, 6 * count**2, device="cpu", graded=False)
    assert on.area.shape[1] == 6 * count**2
    assert np.isfinite(on.point).all()
    assert np.allclose(np.linalg.norm(on.normal, axis=-1), 1.0)
    np.testing.assert_allclose(superquadric_inside_outside(body, on.point), 1.0, atol=1e-9)


@pytest.mark.parametrize("field", ["size_m", "exponents", "position_m"])
def test_a_body_that_is_not_finite_has_no_scores(field: str, sample: BodySample) -> None:
    """Never a number that could be believed."""
    body = bodies()
    values = getattr(body, field).copy()
    values[3, 0] = np.nan
    body = body._replace(**{field: values})
    at = np.tile([0.0, 0, 0, 0, 0, 0, 1.0], (WORLDS, 1))
    found = scores.score_superquadrics(body, body_from_name("block"), at)
    assert np.isnan(found.chamfer_m[3])
    assert np.isnan(found.iou[3])
    assert np.isfinite(np.delete(found.chamfer_m, 3)).all()


def test_points_on_the_axes_and_in_the_middle_have_distances() -> None:
    """Where one or all coordinates are 0 no power is of a number."""
    body = superquadric(np.full((1, 3), 0.03), np.array([[1.5, 1.7]]), np.zeros((1, 3)),
                        np.array([[0.0, 0.0, 0.0, 1.0]]))
    block = sample_body(body_from_name("block"), surface=512, inside=768)
    along = np.linspace(-0.05, 0.05, 11)
    at = np.concatenate([along[:, None] * np.eye(3)[k] for k in range(3)])
    asked = replace(block, about_m=at, distance_m=np.zeros(len(at)), ramp_m=1.0)
    signed = scores._signed_distance(body, asked, "cpu")[0]
    assert np.isfinite(signed).all()
    expected = np.abs(np.tile(along, 3)) - 0.03  # exact along the axes
    outer = np.abs(np.tile(along, 3)) > 0.02
    np.testing.assert_allclose(signed[outer], expected[outer], atol=1e-12)
