"""Where a hand that closes on nothing meets itself: beside the simulated closing."""

import numpy as np
import pytest

from strategies.foresight.hand_meetings import NONE
from strategies.foresight.hand_samples import STRIDE, samples_of_hand
from strategies.foresight.occupancy import CELLS, begin_occupancy
from strategies.poses.closing_paths import CLOSING_PATHS
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.containment import explore_by_containment
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import (
    ArmTable,
    ErrorTable,
    HandTable,
    SensorTable,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth

HAND = HandTable()
DOWN = [1.0, 0.0, 0.0, 0.0]
MIDDLE, THUMB = 1, 3


@pytest.mark.parametrize("path", list(CLOSING_PATHS))
def test_fingers_meet_where_those_of_the_simulated_hand_do(path: str) -> None:
    """In the air above a block far aside. The true closing feels a touch some steps after it: its
    tendons have to pass their threshold first."""
    away = Truth(np.array([[0.45, 0.35, 0.0, 0.0, 0.0, 0.0, 1.0]]))
    robot = Robot([body_from_name("block")], np.zeros(1, int), away, np.array([5], np.uint64),
                  ArmTable(), HAND, SensorTable(), errors=ErrorTable.none())
    pose = np.array([[[0.45, 0.0, 0.35, *DOWN]]])
    felt = explore_by_containment(robot, pose, np.ones((1, 1), bool), (path,)).closing
    swept = samples_of_hand(HAND, (path,)).swept[0]
    places = swept.joints_rad.shape[1]
    met = swept.met < places
    stopped = felt.status[0, 0, 0] == ProbeStatus.SELF_CONTACT
    np.testing.assert_array_equal(met, stopped)
    late = felt.step[0, 0, 0][met] - STRIDE * swept.met[met]
    assert (late > -2 * STRIDE).all()
    assert (late < 30).all(), late
    np.testing.assert_array_equal(swept.meets[[MIDDLE, THUMB]], [THUMB, MIDDLE])
    np.testing.assert_array_equal(swept.meets[[0, 2]], NONE)


def test_what_lies_beyond_a_meeting_is_worth_nothing_unless_the_other_finger_was_stopped() -> None:
    one = np.ones(1)
    samples = samples_of_hand(HAND, ("curl40",))
    swept = samples.swept[0]
    pose = np.array([[[0.45, 0.0, 0.20, *DOWN]]])
    beyond = swept.balls_m[MIDDLE, swept.met[MIDDLE] + 8:swept.met[MIDDLE] + 12, -1]
    before = swept.balls_m[THUMB, swept.met[THUMB] - 6, -1]
    flip = np.array([1.0, -1.0, -1.0])

    def gain(*places: np.ndarray) -> np.ndarray:
        grid = begin_occupancy(BoundingCylinder(0.45 * one, 0.0 * one, 0.05 * one, 0.20 * one),
                               HAND.link_radius_m)
        hit = np.zeros((1, *CELLS), np.float32)
        for place in np.concatenate(places):
            at = (pose[0, 0, :3] + place * flip - grid.corner_m[0]) / grid.cell_m[0]
            hit[0][tuple(at.astype(int))] = 1.0
        grid.hit[:] = hit.reshape(1, -1)
        return grid.foresee(samples.open_m, swept, pose, np.ones((1, 1), bool),
                            np.ones_like(grid.hit), 0.0).gain[0, 0]

    assert gain(beyond)[MIDDLE] == 0.0
    stopped = gain(beyond, before[None])
    assert stopped[THUMB] == pytest.approx(1.0)
    assert stopped[MIDDLE] == pytest.approx(1.0)
