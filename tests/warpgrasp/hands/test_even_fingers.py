"""Equal fingers that stand evenly about an axis approach along it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from urdf_parts import BALL, joint, link, robot

from warpgrasp.hands.hand_frames import finger_tips, matrix_of, posture_angles
from warpgrasp.hands.hand_model import HandModel
from warpgrasp.hands.urdf_hand import hand_from_urdf

LINK = ('<collision><origin xyz="0 0 0.02"/><geometry><box size="0.01 0.01 0.04"/></geometry>'
        "</collision>")


def text(places: np.ndarray) -> str:
    """Numbers of a URDF, rounded as makers round them."""
    return " ".join(f"{value:.5f}" for value in places)


def even_hand(folder: Path, *, count: int, tilt: float, one_drive: bool, turn: Rotation,
              aside_m: float = 0.0) -> HandModel:
    """Fingers of two joints, the second one led by the first, which one may lead for all. The
    bases are turned about z, then with all the hand; the first is moved `aside_m`."""
    parts = [link("palm", BALL)]
    for n in range(count):
        azimuth = 2.0 * np.pi * n / count
        at = [(0.04 + aside_m * (n == 0)) * np.cos(azimuth), 0.04 * np.sin(azimuth), 0.03]
        lean = turn * Rotation.from_euler("ZY", [azimuth + np.pi, tilt])
        leader = "j0" if one_drive else f"j{n}"
        follows = ('<mimic joint="j0"/>' if one_drive and n else "",
                   f'<mimic joint="{leader}" multiplier="0.8"/>')
        parts += [
            link(f"base{n}", ""), link(f"near{n}", LINK), link(f"far{n}", LINK),
            f'<joint name="mount{n}" type="fixed"><parent link="palm"/><child link="base{n}"/>'
            f'<origin xyz="{text(turn.apply(at))}" rpy="{text(lean.as_euler("xyz"))}"/></joint>',
            joint(f"j{n}", f"base{n}", f"near{n}", at="0 0 0", more=follows[0]),
            joint(f"k{n}", f"near{n}", f"far{n}", at="0 0 0.04", more=follows[1])]
    file = folder / "hand.urdf"
    file.write_text(robot(parts))
    return hand_from_urdf(file)[0]


@pytest.mark.parametrize("one_drive", [False, True])
@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.4])
@pytest.mark.parametrize("count", [3, 4])
def test_equal_fingers_about_an_axis_approach_along_it(
        tmp_path: Path, count: int, tilt: float, one_drive: bool) -> None:
    """Two of them led, bent as in the open hand, and the approach leant by 10 degrees."""
    turn = Rotation.from_euler("xyz", [0.5, 1.1, -2.0])
    model = even_hand(tmp_path, count=count, tilt=tilt, one_drive=one_drive, turn=turn)
    frame = matrix_of(model.grasp_frame)
    np.testing.assert_allclose(frame[:3, 2], turn.apply([0.0, 0.0, 1.0]), atol=1e-3)
    np.testing.assert_allclose(frame[:3, 3], turn.apply([0.0, 0.0, 0.03]), atol=1e-4)
    # The open hand is even, too: its tips are as high, and as far from the axis.
    tips = finger_tips(model, posture_angles(model, model.posture("open"))[None])[0]
    own = (tips - frame[:3, 3]) @ frame[:3, :3]
    np.testing.assert_allclose(own[:, 2], own[0, 2], atol=1e-4)
    np.testing.assert_allclose(np.hypot(*own[:, :2].T), np.hypot(*own[0, :2]), atol=1e-4)


def test_fingers_that_stand_unevenly_are_no_such_hand(tmp_path: Path) -> None:
    turn = Rotation.identity()
    model = even_hand(tmp_path, count=3, tilt=0.0, one_drive=False, turn=turn, aside_m=0.02)
    assert np.abs(model.grasp_frame[:2]).max() > 5e-3
