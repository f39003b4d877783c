"""The picture of a hand shows the frame that its file says, or guesses."""

import numpy as np
import pytest
from drawn_text import texts

from sweeps.report.hand_picture import axis_solids, hand_picture
from warpgrasp.hands.hand_file import SHIPPED, hand_named


@pytest.mark.parametrize("name", [name for name in SHIPPED if name != "utah_mit"])
def test_a_picture_names_the_approach(name: str) -> None:
    drawn = hand_picture(hand_named(name))
    written = [text for text, _ in texts(drawn)]
    assert {"x", "approach (z)", "tip"} <= set(written)


def test_axes_are_those_of_the_frame_of_the_grasp() -> None:
    (x, _), (z, _) = axis_solids(0.1)
    for faces, axis in ((x, 0), (z, 2)):
        points = faces.reshape(-1, 3)
        assert points[:, axis].max() == pytest.approx(0.1, abs=0.003)
        assert np.abs(np.delete(points, axis, axis=1)).max() < 0.0025


def test_fingers_behind_the_palm_are_seen_from_the_other_side() -> None:
    drawn = hand_picture(hand_named("leap"))
    views = [axes for axes in drawn.axes if hasattr(axes, "azim")]
    assert [axes.get_title() for axes in views] == [
        "leap: open", "leap: closed", "leap: open, from behind", "leap: closed, from behind"]
    turns = [(views[n + 2].azim - views[n].azim) % 360.0 for n in (0, 1)]  # pyright: ignore
    assert turns == [180.0, 180.0]
