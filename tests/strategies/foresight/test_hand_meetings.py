"""Where a hand that closes on nothing meets itself: beside the simulated closing."""

from importlib.resources import files

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


def stopped_in_the_air(hand: HandTable, path: str) -> tuple[np.ndarray, np.ndarray]:
    """Which fingers meet the hand itself above a block far aside, and the steps they end at."""
    away = Truth(np.array([[0.45, 0.35, 0.0, 0.0, 0.0, 0.0, 1.0]]))
    robot = Robot([body_from_name("block")], np.zeros(1, int), away, np.array([5], np.uint64),
                  ArmTable(), hand, SensorTable(), errors=ErrorTable.none())
    pose = np.array([[[0.45, 0.0, 0.35, *DOWN]]])
    felt = explore_by_containment(robot, pose, np.ones((1, 1), bool), (path,)).closing
    return felt.status[0, 0, 0] == ProbeStatus.SELF_CONTACT, felt.step[0, 0, 0]


@pytest.mark.parametrize("path", list(CLOSING_PATHS))
def test_fingers_meet_where_those_of_the_simulated_hand_do(path: str) -> None:
    """The true closing feels a touch some steps after it: its tendons have to pass their threshold
    first."""
    stopped, step = stopped_in_the_air(HAND, path)
    swept = samples_of_hand(HAND, (path,)).swept[0]
    places = swept.joints_rad.shape[1]
    met = swept.met < places
    np.testing.assert_array_equal(met, stopped)
    late = step[met] - STRIDE * swept.met[met]
    assert (late > -2 * STRIDE).all()
    assert (late < 30).all(), late
    np.testing.assert_array_equal(swept.meets[[MIDDLE, THUMB]], [THUMB, MIDDLE])
    np.testing.assert_array_equal(swept.meets[[0, 2]], NONE)


@pytest.mark.parametrize("kind", ["allegro", "leap", "barrett"])
def test_fingers_of_other_hands_meet_where_simulated_ones_do(kind: str) -> None:
    """One of the two that meet may slip along the other, and stop later."""
    hand = HandTable(kind=kind)
    stopped, step = stopped_in_the_air(hand, "together")
    swept = samples_of_hand(hand, ("together",)).swept[0]
    met = swept.met < swept.joints_rad.shape[1]
    np.testing.assert_array_equal(met, stopped)
    for finger in np.flatnonzero(met):
        pair = [finger, swept.meets[finger]]
        assert -2 * STRIDE < step[pair].min() - STRIDE * swept.met[finger] < 30


def test_the_utah_mit_hand_as_chains_is_sampled_as_by_its_own_functions() -> None:
    chain = HandTable(kind=str(files("warpgrasp.hands") / "data" / "utah_mit.toml"))
    own, other = (samples_of_hand(hand, ("curl40",)) for hand in (HAND, chain))
    np.testing.assert_allclose(other.swept[0].balls_m, own.swept[0].balls_m, atol=1e-9)
    np.testing.assert_array_equal(other.swept[0].met, own.swept[0].met)
    np.testing.assert_array_equal(other.swept[0].meets, own.swept[0].meets)


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
