"""The way of the arm that explorers tell, against the stations their hands were sent to."""

from collections.abc import Callable

import numpy as np
import pytest

from strategies.procedures.contour_follower import explore_contour
from strategies.procedures.contour_record import Axis
from strategies.procedures.planar_explorer import explore_plane
from warpgrasp.mechanism.puma560 import HOME_RAD, puma_forward_batch
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth


def follow_bottle(robot: Robot) -> np.ndarray:
    x, y, height, radius = np.array([[0.45], [0.0], [0.32], [0.04]])
    return explore_contour(robot, Axis.upright(x, y, height, radius)).path_m


def follow_cylinder(robot: Robot) -> np.ndarray:
    x, y, height, radius = np.array([[0.45], [0.0], [0.12], [0.04]])
    return explore_contour(robot, Axis.upright(x, y, height, radius)).path_m


def cross_face(robot: Robot) -> np.ndarray:
    return explore_plane(robot, np.array([[0.42, 0.0, 0.06]]), np.array([[-1.0, 0.0, 0.0]])).path_m


@pytest.mark.parametrize(("name", "explore"), [("block", cross_face),
                                               ("wine_bottle", follow_bottle)])
def test_the_path_is_between_all_stations(name: str, explore: Callable) -> None:
    hand = HandTable()
    robot = Robot([body_from_name(name)], np.zeros(1, int),
                  Truth(np.array([[0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])), np.array([5], np.uint64),
                  ArmTable(), hand, SensorTable())
    flange = puma_forward_batch(robot.arm, np.array([HOME_RAD]))[0]
    x, y, z, w = flange[3:]
    out = np.array([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x**2 + y**2)])
    stations = [flange[:3] + hand.mount_length_m * out]
    move = robot.guarded_line

    def watched(rows, pose, *arguments, **options):
        touch = move(rows, pose, *arguments, **options)
        if len(rows) and (touch.status[0] != ProbeStatus.UNREACHABLE or touch.steps[0]):
            stations.extend([pose[0, :3], touch.hand_pose[0, :3]])
        return touch

    robot.guarded_line = watched
    prior = explore(robot)[0]
    # Believed stations are where the encoders say, a tenth of a millimetre off the lines' own ends.
    assert prior == pytest.approx(
        np.linalg.norm(np.diff(stations, axis=0), axis=1).sum(), abs=1e-4 * len(stations))


@pytest.mark.parametrize(("name", "explore"), [("block", cross_face),
                                               ("large_cylinder", follow_cylinder),
                                               ("funnel", cross_face)])
def test_it_ends_at_a_retreat(name: str, explore: Callable) -> None:
    """The hand stayed at its last touch, and went straight through the object to what followed."""
    robot = Robot([body_from_name(name)], np.zeros(1, int),
                  Truth(np.array([[0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])), np.array([5], np.uint64),
                  ArmTable(), HandTable(), SensorTable())
    move, lines = robot.guarded_line, []

    def watched(rows, pose, *arguments, **options):
        touch = move(rows, pose, *arguments, **options)
        lines.append((pose[0], touch))
        return touch

    robot.guarded_line = watched
    explore(robot)
    pose, touch = lines[-1]
    assert touch.status[0] == ProbeStatus.NO_CONTACT
    x, y, z, w = pose[3:]
    out = np.array([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x**2 + y**2)])
    assert (touch.hand_pose[0, :3] - pose[:3]) @ out < -0.095
