"""What is skipped of a closing changes nothing, and nearest points are nearest."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp

from strategies.poses.hand_poses import waypoint_poses
from strategies.procedures.containment import padded_commands
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior
from warpgrasp.closing.closing import Closing, ClosingTruth, close_fingers
from warpgrasp.core.dtypes import real, vec2, vec3
from warpgrasp.core.kernel_launch import launch
from warpgrasp.core.random import counter_key
from warpgrasp.core.turns import sine_cosine
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import LINK_SAMPLES, nearest_along, nearest_on_link
from warpgrasp.objects.body_baking import touched_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.mesh_import import body_from_mesh
from warpgrasp.parameters import ContactTable, HandTable, ObjectTable, SensorTable

HAND = HandTable()


def grasped(body: Body, prior: Body, sensors: SensorTable, worlds: int = 8, **options: Any
            ) -> tuple[Closing, ClosingTruth]:
    """The closings of `ring6` about `prior` in worlds where `body` stands."""
    key = counter_key(3, np.arange(worlds))
    pose = place_objects(ObjectTable(), key)
    strategy = STRATEGIES["ring6"]
    given = draw_prior(prior, pose, ObjectTable(), key)
    hands = waypoint_poses(strategy.waypoints, given, HAND, key)
    commands, count = padded_commands(strategy.closings)
    made = np.ones((*hands.shape[:2], len(count)), int)
    return close_fingers(scene_of([body], "cpu"), np.zeros(1, int), pose, HAND, sensors, key, made,
                         hands, commands, count, **options)


def test_a_superquadric_all_but_a_block_stops_fingers_as_the_block_does() -> None:
    """It is touched at distances baked to a grid, a block at those of its formula."""
    block = body_from_name("block")
    half = 500.0 * (np.asarray(block.high_m) - block.low_m)
    nearly = body_from_table({"name": "nearly", "superquadric": {
        "size_mm": half.tolist(), "exponents": [0.1, 0.1]}}, Path())
    (felt, truth), (nearly_felt, nearly_truth) = (
        grasped(body, block, SensorTable(), 64,
                contact=ContactTable(self_contact=False, friction=0.0))
        for body in (block, touched_body(nearly)))
    touched = (truth.link >= 0) & (nearly_truth.link >= 0)
    assert touched.sum() > 1200
    assert touched.sum() > 0.95 * (truth.link >= 0).sum()
    assert (np.abs(felt.step - nearly_felt.step)[touched] <= 3).mean() > 0.9
    apart = np.linalg.norm(truth.point_m - nearly_truth.point_m, axis=-1)[touched]
    assert np.median(apart) < 2e-4
    torque = np.abs(truth.torque_Nm - nearly_truth.torque_Nm).max(-1)[touched]
    assert np.median(torque) < 0.002


@pytest.mark.parametrize("name", ["block", "lightbulb"])
def test_looking_more_often_changes_no_stop(name: str) -> None:
    """`march_scale` shortens every jump: other steps are looked at, the same happens."""
    body, sensors = body_from_name(name), SensorTable(tendon_threshold_N=2.6)
    (felt, truth), (again, truth_again) = (
        grasped(body, body, sensors, march_scale=scale) for scale in (1.0, 0.3))
    assert 0.05 < (truth.link == -1).mean() < 0.95  # false stops and contacts
    np.testing.assert_array_equal(felt.step, again.step)
    np.testing.assert_array_equal(truth.link, truth_again.link)
    np.testing.assert_allclose(truth.q_rad, truth_again.q_rad, atol=1e-6)


@wp.kernel(enable_backward=False)
def _near_kernel(
    first: int, scene: Scene, body: int, a: wp.array[vec3], u: wp.array[vec3], length: real,
    out: wp.array[vec2],
):
    i = wp.tid() + first
    out[i] = nearest_along(scene, body, a[i], u[i], length, real(1.0))


@pytest.mark.parametrize("name", ["block", "small_cylinder", "wedge", "wine_bottle", "lightbulb"])
def test_nearest_point_of_a_link_against_fine_sampling(name: str) -> None:
    body, length, n = body_from_name(name), 0.043, 400
    rng = np.random.default_rng(1)
    a = rng.uniform([-0.08, -0.08, 0.02], [0.08, 0.08, 0.2], (n, 3))
    u = rng.normal(size=(n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    scene = scene_of([body], "cpu")
    out = wp.zeros(n, dtype=vec2, device="cpu")
    launch(_near_kernel, {"row": n}, {"a": "row", "u": "row", "out": "row"}, {
        "scene": scene, "body": 0, "a": wp.array(a, dtype=vec3, device="cpu"),
        "u": wp.array(u, dtype=vec3, device="cpu"), "length": length, "out": out}, device="cpu")
    along, distance = out.numpy().T
    places = a[:, None] + u[:, None] * np.linspace(0, length, 2001)[:, None]
    sampled = np.minimum(distance_to_bodies(scene, np.zeros(1, int), places)[0], places[..., 2])
    at = a + u * along[:, None]
    exact = np.minimum(distance_to_bodies(scene, np.zeros(1, int), at[:, None])[0][:, 0], at[:, 2])
    np.testing.assert_allclose(distance, exact, atol=1e-12)
    outside = sampled.min(1) > 0.002
    # Bodies that are not convex may have a second valley between samples.
    missed = distance[outside] > sampled.min(1)[outside] + 1e-7
    assert missed.mean() <= (0.0 if name in ("block", "small_cylinder", "wedge") else 0.02)


@wp.kernel(enable_backward=False)
def _followed_kernel(
    first: int, scene: Scene, a: wp.array[vec3], u: wp.array[vec3], guess: wp.array[real],
    length: real, enough: real, out: wp.array[real],
):
    i = wp.tid() + first
    out[i] = nearest_on_link(scene, 0, a[i], u[i], length, guess[i], real(1.0), LINK_SAMPLES,
                          enough).distance


@pytest.mark.parametrize("name", ["dumbbell", "wine_bottle", "lightbulb"])
def test_a_link_followed_from_the_wrong_valley_is_no_farther_than_its_samples(name: str) -> None:
    """Unless all of it is farther than asked, and what comes back is a lower bound."""
    ball = {"shape": "sphere", "radius_mm": 20.0}
    body = body_from_name(name) if name != "dumbbell" else body_from_table(
        {"name": name, "compound": [ball, {**ball, "at_mm": [50.0, 0.0, 0.0]}]}, Path())
    length, enough, n = 0.043, 0.008, 4000
    rng = np.random.default_rng(4)
    scene = scene_of([body], "cpu")
    low, high = np.array(body.low_m) - 0.01, np.array(body.high_m) + 0.01
    a = rng.uniform(low, high, (n, 3))
    u = rng.normal(size=(n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    guess = rng.uniform(0.0, length, n)
    out = wp.zeros(n, dtype=real, device="cpu")
    launch(_followed_kernel, {"row": n}, {"a": "row", "u": "row", "guess": "row", "out": "row"}, {
        "scene": scene, "a": wp.array(a, dtype=vec3, device="cpu"),
        "u": wp.array(u, dtype=vec3, device="cpu"),
        "guess": wp.array(guess, dtype=real, device="cpu"), "length": length, "enough": enough,
        "out": out}, device="cpu")
    places = a[:, None] + u[:, None] * np.linspace(0, length, int(LINK_SAMPLES))[:, None]
    sampled = distance_to_bodies(scene, np.zeros(1, int), places)[0].min(1)
    assert (sampled < enough).sum() > n / 10
    # Samples next to the bottom found are not asked for again.
    assert (out.numpy() > sampled + 1e-8)[sampled < enough].mean() < 0.005
    assert (out.numpy() > enough)[sampled > enough + length].all()


def test_a_baked_mesh_is_as_far_as_it_is_where_links_touch(tmp_path) -> None:
    """A link's axis lies 8 mm from what its skin touches: that is inside the grid."""
    mesh = trimesh.creation.box([0.03, 0.04, 0.06])
    mesh.export(tmp_path / "box.ply")
    scene = scene_of([body_from_mesh(tmp_path / "box.ply", units="m")], "cpu")
    gap = np.linspace(0.004, 0.011, 15)
    for axis, half, middle in ((0, 0.015, 0.03), (1, 0.02, 0.03), (2, 0.03, 0.03)):
        at = np.tile([0.0, 0.0, middle], (len(gap), 1))
        at[:, axis] += half + gap
        distance, gradient = distance_to_bodies(scene, np.zeros(1, int), at[None])
        np.testing.assert_allclose(distance[0], gap, atol=2e-5)
        np.testing.assert_allclose(gradient[0, :, axis], 1.0, atol=1e-3)


def test_a_grid_s_gradient_is_its_value_s() -> None:
    """Inside and outside the grid, where the value is a bound."""
    scene = scene_of([_ellipsoid()], "cpu")
    at = np.random.default_rng(2).uniform([-0.08, -0.08, -0.02], [0.08, 0.08, 0.2], (500, 3))
    step = 1e-6
    slopes = [(distance_to_bodies(scene, np.zeros(1, int), at[None] + step * e)[0]
               - distance_to_bodies(scene, np.zeros(1, int), at[None] - step * e)[0]) / (2 * step)
              for e in np.eye(3)]
    _, gradient = distance_to_bodies(scene, np.zeros(1, int), at[None])
    error = np.abs(np.stack(slopes, -1) - gradient)[0].max(1)
    assert np.quantile(error, 0.99) < 1e-4  # but for points whose neighbours lie across a border


def _ellipsoid():
    from sweeps.bench.measure import mesh_body

    return mesh_body()


@wp.kernel(enable_backward=False)
def _sine_kernel(first: int, x: wp.array[real], out: wp.array[vec2]):
    i = wp.tid() + first
    out[i] = sine_cosine(x[i])


def test_sine_and_cosine_to_the_last_digits() -> None:
    x = np.concatenate([np.random.default_rng(0).uniform(-20, 20, 10_000),
                        np.arange(-16, 17) * np.pi / 4])
    out = wp.zeros(len(x), dtype=vec2, device="cpu")
    launch(_sine_kernel, {"row": len(x)}, {"x": "row", "out": "row"},
           {"x": wp.array(x, dtype=real, device="cpu"), "out": out}, device="cpu")
    np.testing.assert_allclose(out.numpy(), np.stack([np.sin(x), np.cos(x)], 1), atol=3e-16)
