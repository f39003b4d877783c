"""Commands and postures of the Utah-MIT hand within the limits that its table has."""

import numpy as np
import pytest

from strategies.procedures.containment import padded_commands
from strategies.procedures.possible import NotPossible, opposed_of
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import HandTable, PadTable

STILL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def test_commands_stay_within_the_limits_and_go_on_as_long_as_a_joint_moves() -> None:
    hand = HandTable(flexion_low_deg=(0, 0, 0), flexion_high_deg=(90, 35, 35),
                     abduction_limit_deg=(-10, 10))
    names = ("curl25_spread", "base_then_curl")
    commands, count = padded_commands(names, hand)
    free, steps = padded_commands(names)
    assert commands[..., 0].min() == pytest.approx(np.radians(-10))
    assert commands[..., 1].min() == 0.0
    assert commands[..., 1].max() == pytest.approx(np.radians(90))
    assert commands[..., 2:].max() == pytest.approx(np.radians(35))
    for path, own, other in zip(commands, count, steps, strict=True):
        assert own < other
        assert (np.abs(np.diff(path[:, :own], axis=1)).max((0, 2)) > 0.0).all()
    assert np.array_equal(padded_commands(names, HandTable())[0], free)


@pytest.mark.parametrize("spacing_mm", [20.0, 28.0, 43.5])
def test_index_finger_and_thumb_face_each_other_whatever_their_spacing(spacing_mm: float) -> None:
    hand = HandTable(finger_spacing_mm=spacing_mm)
    pair = opposed_of(hand, PadTable())
    index, thumb = (hand_links(hand, STILL[None], pair.open_rad[None, :, 0])[0][0, finger, -1]
                    for finger in pair.fingers)
    # Exactly so where they are straight: open they bend back by 10 degrees.
    assert index[1] == pytest.approx(thumb[1], abs=1e-3)
    assert (index + thumb)[0] == pytest.approx(0.0, abs=1e-3)


def test_a_pair_that_cannot_face_each_other_is_not_possible() -> None:
    for hand in (HandTable(finger_spacing_mm=60), HandTable(abduction_limit_deg=(-10, 10)),
                 HandTable(finger_spacing_mm=90, link_length_mm=(20, 20, 20))):
        with pytest.raises(NotPossible, match="its index finger faces the thumb at an abduction"):
            opposed_of(hand, PadTable())
