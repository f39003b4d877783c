"""Free-form fits: closed forms, invariances, evidence, statuses; meshes against trimesh."""

import numpy as np
import pytest
import trimesh

from fit.fit_status import FitStatus
from fit.implicit.fit import fit_implicit
from fit.implicit.mesh import felt_pieces, implicit_meshes, zero_set_meshes
from fit.implicit.query import implicit_distance, implicit_values
from fit.implicit.record import ImplicitOptions, TriangleMesh
from fit.implicit.volume import implicit_volume, surface_samples


def directions(count: int) -> np.ndarray:
    """Unit vectors, evenly spread: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    r = np.sqrt(1.0 - z**2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], 1)


def ellipsoids(count: int = 96, noise: float = 1e-3, seed: int = 0) -> np.ndarray:
    """Touches of three ellipsoids of half axes 30 x 30 x 30, 30 x 40 x 60 and 25 x 50 x 25 mm."""
    half = 1e-3 * np.array([[30, 30, 30], [30, 40, 60], [25, 50, 25]])
    draw = np.random.default_rng(seed)
    points = directions(count) * half[:, None] + [0.4, 0.1, 0.08]
    return points + noise * draw.normal(size=points.shape)


TOUCHES = 72
"""Of the fits that tests share: with points off the surface 96 rows, a full bucket."""


@pytest.fixture(scope="module")
def three() -> tuple:
    """Fits of the ellipsoids, their meshes and volumes."""
    fits = fit_implicit(ellipsoids(TOUCHES))
    meshes = implicit_meshes(fits)
    return fits, meshes, implicit_volume(fits, meshes)


def test_touches_that_do_not_err_tell_so() -> None:
    """Where its first steps were rejected a descent ended where it began, with the noise of the
    prior, and was said to have converged: intervals of volumes were ten times too wide."""
    fits = fit_implicit(ellipsoids(TOUCHES, noise=0.0))
    assert (fits.status == FitStatus.converged).all()
    assert (fits.noise_sigma_m < 4e-4).all()


def test_ellipsoids_are_recovered_within_their_noise(three) -> None:
    fits, _, volume = three
    assert (fits.status == FitStatus.converged).all()
    half = 1e-3 * np.array([[30, 30, 30], [30, 40, 60], [25, 50, 25]])
    true = 4.0 / 3.0 * np.pi * half.prod(1)
    assert np.allclose(volume.volume_m3, true, rtol=0.03)
    assert (np.abs(volume.volume_m3 - true) < 3.0 * volume.std_m3).all()
    assert (volume.std_m3 < 0.02 * true).all()
    low, high = volume.interval_m3().T
    assert np.allclose(np.log(high / volume.volume_m3), 1.645 * volume.std_m3 / volume.volume_m3,
                       rtol=0.02)
    assert np.allclose(low * high, volume.volume_m3**2)
    on = directions(700) * half[:, None] + [0.4, 0.1, 0.08]
    found = implicit_distance(fits, on)
    assert np.abs(found.distance_m).mean() < 1e-3
    held = (np.abs(found.distance_m) < 1.645 * found.std_m).mean()
    assert 0.8 < held <= 1.0


def test_meshes_are_closed_and_lie_on_the_zero_set(three) -> None:
    fits, meshes, volume = three
    vertices = np.stack([surface_samples(mesh, 300) for mesh in meshes])
    found = implicit_distance(fits, vertices)
    away = np.abs(found.distance_m) / np.linalg.norm(found.gradient, axis=2)
    assert away.max() < 6e-4  # triangles of 3 mm on radii of 25 mm and more
    for mesh in meshes:
        other = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
        assert other.is_watertight
        assert other.volume == pytest.approx(mesh.volume_m3, rel=1e-9)
    # Samples are even: their mean is the centroid of the surface.
    for mesh, surface in zip(meshes, volume.surface_m, strict=True):
        other = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
        middle = (other.triangles_center * other.area_faces[:, None]).sum(0) / other.area
        error = surface.std(0) / np.sqrt(len(surface))  # of points drawn at random; even ones less
        assert (np.abs(surface.mean(0) - middle) < 3 * error).all()


@pytest.mark.slow
def test_padding_order_and_neighbours_change_nothing(three) -> None:
    fits = three[0]
    points = ellipsoids(TOUCHES)
    order = np.random.default_rng(5).permutation(TOUCHES)
    place = slice(20, 20 + TOUCHES)
    wide = np.full((2, 140, 3), np.nan)
    wide[0, place], wide[1, :40] = points[1][order], points[2][:40]
    mask = np.isfinite(wide).all(2)
    other = fit_implicit(np.nan_to_num(wide), mask)
    for name in ("length_m", "amplitude_m", "noise_sigma_m", "cost", "rms_m"):
        assert getattr(other, name)[0] == getattr(fits, name)[1]
    assert (other.weight[0, place] == fits.weight[1][order]).all()
    assert not other.weight[0, :20].any()


@pytest.mark.slow
def test_a_motion_carries_the_body_with_it() -> None:
    points = ellipsoids()[1:2]
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    one, other = fit_implicit(points), fit_implicit(points @ turn.T + [0.0, 0.2, 0.1])
    queries = np.random.default_rng(1).uniform(-0.05, 0.05, (1, 50, 3)) + [0.4, 0.1, 0.08]
    moved = queries @ turn.T + [0.0, 0.2, 0.1]
    # The off-surface points are every third touch in the order of coordinates, which turns too.
    here, there = implicit_values(one, queries), implicit_values(other, moved)
    near = np.abs(here) < 0.01
    assert np.allclose(here[near], there[near], atol=1e-3)


@pytest.mark.slow
def test_a_mean_that_fits_stays_where_nothing_is_felt() -> None:
    centre = np.array([0.4, 0.1, 0.08])
    upper = directions(160)[:80] * 0.03 + centre

    def mean(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - centre, axis=2) - 0.03

    noise = 3e-4 * np.random.default_rng(2).normal(size=upper.shape)
    fits = fit_implicit((upper + noise)[None], mean=mean)
    below = directions(100)[60:] * 0.03 + centre
    assert np.abs(implicit_values(fits, below[None], mean)).max() < 1e-3
    assert implicit_distance(fits, below[None], mean).std_m.mean() > 2 * implicit_distance(
        fits, upper[None], mean).std_m.mean()


@pytest.mark.slow
def test_outliers_count_less_beside_a_body_that_fits() -> None:
    centre = np.array([0.4, 0.1, 0.08])
    true = directions(96) * 0.03 + centre
    points = true + 5e-4 * np.random.default_rng(3).normal(size=true.shape)
    points[::16] += 0.012 * directions(96)[::16]

    def mean(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - centre, axis=2) - 0.03

    robust = fit_implicit(points[None], mean=mean)
    plain = fit_implicit(points[None], mean=mean, options=ImplicitOptions(outlier_share=0.0))
    assert (robust.weight[0, ::16] < 0.1).all()
    assert np.median(robust.weight[0]) > 0.95
    assert (plain.weight[0] == 1.0).all()
    errors = [np.abs(implicit_values(f, true[None], mean)).mean() for f in (robust, plain)]
    assert errors[0] < 0.7 * errors[1]  # 0.108 and 0.215 mm


POLE_FREE = np.array([[0.0, 0.0, 0.030], [0.1, 0.0, 0.0]])
"""Balls of free space beside a sphere of 30 mm: on the pole, where nothing is felt, and far off."""


def test_free_balls_push_the_surface_away() -> None:
    points = directions(TOUCHES)[12:] * 0.03
    points += 1e-3 * np.random.default_rng(3).normal(size=points.shape)
    free = fit_implicit(points[None], free_points=POLE_FREE[None], free_radius=0.006)
    assert implicit_values(free, POLE_FREE[None])[0, 0] > 0.0053


@pytest.mark.slow
def test_without_free_balls_and_with_far_ones_the_surface_stays() -> None:
    points = directions(96)[16:] * 0.03
    plain = fit_implicit(points[None])
    assert implicit_values(plain, POLE_FREE[None])[0, 0] < 0.004
    far = fit_implicit(points[None], free_points=POLE_FREE[None, 1:], free_radius=0.006)
    assert np.allclose(implicit_values(far, points[None]), implicit_values(plain, points[None]),
                       atol=2e-4)


@pytest.mark.slow
def test_a_body_stands_on_its_table() -> None:
    points = ellipsoids()[1] - [0.4, 0.1, 0.08]
    fits = fit_implicit(points[None, points[:, 2] > 0.0], table_z=0.0)
    mesh = implicit_meshes(fits)[0]
    assert mesh.vertices_m[:, 2].min() == pytest.approx(0.0, abs=1e-4)
    half = 2.0 / 3.0 * np.pi * 0.03 * 0.04 * 0.06
    assert mesh.volume_m3 == pytest.approx(half, rel=0.1)


@pytest.mark.slow
def test_normals_tell_a_shell_from_a_solid() -> None:
    way = directions(96)
    points = np.concatenate([0.05 * way, 0.035 * way])
    normals = np.concatenate([way, -way])
    fits = fit_implicit(points[None], normals=normals[None])
    at = np.array([[0.0, 0.0, r] for r in (0.060, 0.0425, 0.025)])
    assert (np.sign(implicit_values(fits, at[None]))[0] == [1, -1, 1]).all()


def test_sets_that_cannot_be_fitted_have_a_status_and_finite_rows() -> None:
    points = np.zeros((4, 20, 3))
    points[0] = directions(20) * 0.03
    points[1, :, 0] = np.linspace(0, 0.1, 20)
    points[2] = np.nan
    mask = np.ones((4, 20), bool)
    mask[3, 5:] = False
    fits = fit_implicit(points, mask)
    assert fits.status.tolist() == [FitStatus.converged, FitStatus.degenerate_line,
                                    FitStatus.bad_points, FitStatus.too_few_points]
    assert all(np.isfinite(value).all() for value in vars(fits).values())
    no_mean = fit_implicit(points[:1], mean=lambda points, rows: np.full(points.shape[:2], np.nan))
    assert no_mean.status.tolist() == [FitStatus.bad_points]
    with pytest.raises(ValueError, match="multiple of 4"):
        implicit_meshes(fits, cells=30)
    with pytest.raises(ValueError, match="outlier_share"):
        ImplicitOptions(outlier_share=0.7)


def test_pieces_that_were_not_felt_are_left_out() -> None:
    def two(points: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
        return np.minimum(*(np.linalg.norm(points - [x, 0, 0], axis=2) - 0.02
                            for x in (-0.03, 0.03)))

    mesh = zero_set_meshes(two, np.full((1, 3), -0.06), np.full((1, 3), 0.06))[0]
    one = felt_pieces(mesh, np.array([[0.05, 0.0, 0.0]]))
    assert one.volume_m3 == pytest.approx(mesh.volume_m3 / 2, rel=0.02)
    assert one.vertices_m[:, 0].min() > 0.0
    assert felt_pieces(one, np.zeros((0, 3))) is one
    assert TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int)).volume_m3 == 0.0


def test_an_error_that_all_touches_share_moves_the_whole_surface(three) -> None:
    fits, meshes, volume = three
    shared = implicit_volume(fits, meshes, shared_m=0.001)
    area = [trimesh.Trimesh(mesh.vertices_m, mesh.faces).area for mesh in meshes]
    assert np.allclose(shared.std_m3**2, volume.std_m3**2 + (0.001 * np.array(area)) ** 2)
    assert np.allclose(shared.surface_std_m**2, volume.surface_std_m**2 + 1e-6)


@pytest.mark.parametrize("shared", [np.nan, -0.001, np.inf])
def test_a_shared_error_that_is_none_is_named(three, shared: float) -> None:
    fits, meshes, _ = three
    with pytest.raises(ValueError, match=r"shared_m: .*, should be a finite number, 0 or more"):
        implicit_volume(fits, meshes, shared_m=shared)


def test_a_mean_cannot_change_what_it_is_asked() -> None:
    def mean(points_m: np.ndarray, rows: np.ndarray) -> np.ndarray:
        points_m -= 0.4
        return np.linalg.norm(points_m, axis=2) - 0.04

    with pytest.raises(ValueError, match="read-only"):
        fit_implicit(ellipsoids(TOUCHES), mean=mean)
