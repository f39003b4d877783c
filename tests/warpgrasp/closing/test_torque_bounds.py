"""Torques between looks: balls that hold what a convex energy can do, and no stop hidden."""

import numpy as np
import pytest
import warp as wp

from strategies.poses.hand_poses import waypoint_poses
from strategies.procedures.containment import padded_commands
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior
from warpgrasp.closing.closing import close_fingers
from warpgrasp.core.dtypes import HALF, real, vec2, vec4
from warpgrasp.core.kernel_launch import launch
from warpgrasp.core.random import counter_key
from warpgrasp.finger.energy import free_equilibrium
from warpgrasp.finger.torque_bounds import (
    Ball,
    agree,
    intersect_balls,
    may_stop,
    stop_reading,
    torque_bound,
)
from warpgrasp.geometry.body import scene_of
from warpgrasp.mechanism.tendon import tendon_sensor_of
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ContactTable, HandTable, ObjectTable, SensorTable

HAND, ALONE = HandTable(), ContactTable(self_contact=False, friction=0.0)


@wp.kernel(enable_backward=False)
def _between_kernel(
    first: int, stiffness: real, command: wp.array2d[vec4], q: wp.array2d[vec4],
    centre: wp.array2d[vec4], radius: wp.array2d[real], agreed: wp.array[int],
):
    i = wp.tid() + first
    low = free_equilibrium(q[i, 0])
    high = free_equilibrium(q[i, 2])
    half = vec2(HALF, HALF)  # no joint at a stop
    after = torque_bound(command[i, 0], low, command[i, 1], stiffness, half)
    both = intersect_balls(
        after, torque_bound(command[i, 2], high, command[i, 1], stiffness, half))
    centre[i, 0] = after.centre
    radius[i, 0] = after.radius
    centre[i, 1] = both.centre
    radius[i, 1] = both.radius
    agreed[i] = int(agree(command[i, 0], low, command[i, 2], high, stiffness))


def between(command: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Balls at the middle one of three commands, by the first alone and by both others."""
    n = len(command)
    centre = wp.zeros((n, 2), dtype=vec4, device="cpu")
    radius = wp.zeros((n, 2), dtype=real, device="cpu")
    agreed = wp.zeros(n, dtype=int, device="cpu")
    launch(_between_kernel, {"row": n}, {
        "command": "row 3", "q": "row 3", "centre": "row 2", "radius": "row 2", "agreed": "row"}, {
        "stiffness": HAND.joint_stiffness_Nm_rad,
        "command": wp.array(command, dtype=vec4, device="cpu"),
        "q": wp.array(q, dtype=vec4, device="cpu"),
        "centre": centre, "radius": radius, "agreed": agreed}, device="cpu")
    return centre.numpy(), radius.numpy(), agreed.numpy().astype(bool)


def test_torques_lie_in_the_balls_where_contacts_are_convex() -> None:
    """Walls that joints press into, 1/2 skin max(0, n . q - level)^2: rests by their formula."""
    rng = np.random.default_rng(0)
    n, k, skin = 2000, HAND.joint_stiffness_Nm_rad, 10.0 ** rng.uniform(-1, 4, (2000, 1))
    normal = rng.normal(size=(n, 4))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    level = rng.normal(scale=0.02, size=(n, 1))
    way = rng.normal(scale=0.03, size=(n, 4))
    command = way[:, None] * np.array([0.0, 1.0, 2.0])[:, None]
    command[:, 1:] += rng.normal(scale=0.01, size=(n, 2, 4))  # not along a line
    past = np.maximum((command * normal[:, None]).sum(-1) - level, 0.0)
    q = command - (past * skin / (k + skin))[..., None] * normal[:, None]
    centre, radius, agreed = between(command, q)
    torque = k * (command[:, 1] - q[:, 1])
    off = np.linalg.norm(centre - torque[:, None], axis=2)
    assert (off <= radius + 1e-9).all()
    assert agreed.all()
    assert (radius[:, 1] <= radius[:, 0] + 1e-12).all()
    assert np.median(radius[:, 1]) < 0.6 * np.median(radius[:, 0])


@wp.kernel(enable_backward=False)
def _stops_kernel(
    first: int, sensor: TendonSensor, centre: wp.array[vec4], radius: wp.array[real],
    torque: wp.array[vec4], delta: wp.array[vec4], key: wp.array[wp.uint64],
    reading: wp.array[real], may: wp.array[int],
):
    i = wp.tid() + first
    ball = Ball()
    ball.centre = centre[i]
    ball.radius = radius[i]
    reading[i] = stop_reading(sensor, torque[i], delta[i], key[i])
    may[i] = int(may_stop(sensor, ball, delta[i], key[i]))


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_no_torque_in_a_ball_stops_a_finger_that_it_may_not_stop(noise: float) -> None:
    """One flexion joint alone, or several, pushed either way, moving either way or not at all."""
    rng, n = np.random.default_rng(3), 20_000
    sensors = SensorTable(tension_noise_N=noise, tendon_threshold_N=4.0)
    centre = rng.normal(scale=0.02, size=(n, 4))
    radius = rng.uniform(0.0, 0.02, n)
    way = rng.normal(size=(n, 4)) * (rng.random((n, 4)) < 0.5)
    length = np.linalg.norm(way, axis=1, keepdims=True)
    torque = centre + radius[:, None] * way / np.maximum(length, 1e-9)
    reading, may = (wp.zeros(n, dtype=dtype, device="cpu") for dtype in (real, int))
    launch(_stops_kernel, {"row": n}, dict.fromkeys(
        ("centre", "radius", "torque", "delta", "key", "reading", "may"), "row"), {
        "sensor": tendon_sensor_of(HAND, sensors), "reading": reading, "may": may,
        "radius": wp.array(radius, dtype=real, device="cpu"),
        "key": wp.array(counter_key(9, np.arange(n)), dtype=wp.uint64, device="cpu"),
        **{name: wp.array(values, dtype=vec4, device="cpu") for name, values in (
            ("centre", centre), ("torque", torque),
            ("delta", 0.01 * rng.integers(-1, 2, (n, 4))))}}, device="cpu")
    stops = np.abs(reading.numpy()) > sensors.tendon_threshold_N
    # Each joint by itself, and either way.
    alone = np.abs(torque[:, 1:]).max(1) == np.abs(torque[:, 1:]).T
    for of_joint in alone:
        assert (stops & of_joint & (reading.numpy() < 0.0)).sum() > 100
        assert (stops & of_joint & (reading.numpy() > 0.0)).sum() > 100
    assert (may.numpy()[stops] == 1).all()
    assert 0.2 < may.numpy().mean() < 0.8


def test_a_finger_that_slips_is_told() -> None:
    """Torque gone though the command went on."""
    k = HAND.joint_stiffness_Nm_rad
    command = np.zeros((1, 3, 4))
    command[0, :, 1] = 0.0, 0.01, 0.02
    q = command.copy()
    q[0, 0, 1] -= 0.03 / k
    assert not between(command, q)[2][0]
    q[0, 2, 1] = command[0, 2, 1] - 0.03 / k
    assert between(command, q)[2][0]


@pytest.mark.parametrize("name", ["block", "wine_bottle"])
def test_no_step_left_out_would_have_stopped_a_finger(name: str) -> None:
    """Paths cut short at every step, and a threshold that is never reached: rests of every step."""
    quiet = SensorTable(tension_noise_N=0.0, tension_step_N=0.0, joint_noise_rad=0.0)
    never = SensorTable(tension_noise_N=0.0, tension_step_N=0.0, tendon_threshold_N=1e3)
    body, worlds = body_from_name(name), 4
    key = counter_key(5, np.arange(worlds))
    pose = place_objects(ObjectTable(), key)
    strategy = STRATEGIES["ring6"]
    given = draw_prior(body, pose, ObjectTable(), key)
    hands = waypoint_poses(strategy.waypoints, given, HAND, key)
    commands, count = padded_commands(strategy.closings)
    made = np.ones((*hands.shape[:2], len(count)), int)

    def close(sensors: SensorTable, steps: np.ndarray):
        return close_fingers(scene_of([body], "cpu"), np.zeros(1, int), pose, HAND, sensors, key,
                             made, hands, commands, steps, contact=ALONE)

    felt, truth = close(quiet, count)
    stopped = truth.link >= 0
    assert stopped.mean() > 0.4
    early = np.zeros(felt.step.shape, bool)
    arm = np.array(HAND.moment_arm_m[1:])
    for last in range(1, int(felt.step[stopped].max())):
        rest = close(never, np.minimum(count, last + 1))[1]
        pull = rest.torque_Nm[..., 1:] / arm
        moving = np.sign(commands[:, :, last] - commands[:, :, last - 1])[..., 1:]
        rub = HAND.tendon_friction * moving
        total = np.maximum(2 * HAND.co_contraction_N, 2 * HAND.tension_low_N + np.abs(pull))
        over = (np.abs(pull + rub * total) > quiet.tendon_threshold_N + 1e-3).any(-1)
        early |= over & (last < felt.step) & (last < count[:, None])
    assert early.sum() <= 0.002 * stopped.sum()
