"""Where the links of a hand are, against MuJoCo and yourdfpy reading the URDF themselves."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from chains import as_matrices, mujoco_frames, random_angles, random_urdf, yourdfpy_frames
from places import SHARED

from warpgrasp.hands.frames_batch import link_frames_batch
from warpgrasp.hands.hand_file import SHIPPED, hand_from_file, hand_named
from warpgrasp.hands.hand_frames import finger_tips, link_frames
from warpgrasp.hands.hand_model import HandModel
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.hands.urdf_hand import hand_from_urdf
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import HandTable

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # yourdfpy's own
NEAR = 1e-9
URDFS = {"allegro": "allegro_hand/allegro_hand_right.urdf",
         "leap": "leap_hand/leap_hand_right.urdf", "barrett": "barrett_hand/bhand_model.urdf"}


def all_frames(model: HandModel, q: np.ndarray) -> np.ndarray:
    return np.concatenate(link_frames(model, q), axis=1)


def check_kernel(model: HandModel, q: np.ndarray, frames: np.ndarray) -> None:
    batch = as_matrices(link_frames_batch(model, q))
    own = [batch[:, f, :len(finger.joints)] for f, finger in enumerate(model.fingers)]
    assert np.abs(np.concatenate(own, axis=1) - frames).max() < NEAR


@pytest.mark.parametrize("name", URDFS)
def test_shipped_hands_are_their_urdfs(name: str) -> None:
    file = SHARED / "hands" / URDFS[name]
    if not file.exists():
        pytest.skip("no folder of hands beside the repository")
    pytest.importorskip("mujoco")
    model = hand_named(name)
    q = random_angles(model, 1000)
    frames = all_frames(model, q)
    assert np.abs(frames - mujoco_frames(file, model, q)).max() < NEAR
    assert np.abs(frames[:20] - yourdfpy_frames(file, model, q[:20])).max() < NEAR
    check_kernel(model, q, frames)


def test_the_utah_mit_is_the_tables_hand() -> None:
    model = hand_named("utah_mit")
    q = random_angles(model, 200)
    still = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(q), 1))
    points, palmar = hand_links(HandTable(), still, q.reshape(-1, 4, 4))
    for f, frames in enumerate(link_frames(model, q)):
        assert np.abs(frames[:, 1:, :3, 3] - points[:, f, 1:4]).max() < NEAR
        assert np.abs(frames[:, 1:, :3, 0] - palmar[:, f]).max() < NEAR
        tip = frames[:, -1, :3] @ [*model.fingers[f].tip_m, 1.0]
        assert np.abs(tip - points[:, f, 4]).max() < NEAR


@pytest.mark.parametrize("seed", range(5))
def test_random_chains_of_any_axes(seed: int, tmp_path: Path) -> None:
    """Fixed joints folded, followers followed, chains of one to six joints."""
    pytest.importorskip("mujoco")
    file = tmp_path / "random.urdf"
    file.write_text(random_urdf(seed))
    model, _ = hand_from_urdf(file)
    q = random_angles(model, 200, seed)
    frames = all_frames(model, q)
    assert np.abs(frames - mujoco_frames(file, model, q)).max() < NEAR
    assert np.abs(frames[:20] - yourdfpy_frames(file, model, q[:20])).max() < NEAR
    check_kernel(model, q, frames)
    again = tmp_path / "hand.toml"
    again.write_text(hand_text(model, guessed=True))
    assert np.abs(all_frames(hand_from_file(again), q) - frames).max() < NEAR


def test_a_palm_further_out_and_held_joints(tmp_path: Path) -> None:
    """Frames are seen from the palm; a joint that is held stands at the angle asked for."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "random.urdf"
    file.write_text(random_urdf(2))
    whole, _ = hand_from_urdf(file)
    name = next(f.joints[0].name for f in whole.fingers if len(f.joints) > 1 and not any(
        j.follows for j in f.joints))
    held, _ = hand_from_urdf(file, palm="palm", held_rad={name: 0.3})
    q = np.array([[0.3 if j.name == name else 0.1 for j in whole.driven]])
    frames = dict(zip([j.name for j in whole.joints], all_frames(whole, q)[0], strict=True))
    mine = dict(zip([j.name for j in held.joints],
                    all_frames(held, np.full((1, len(held.driven)), 0.1))[0], strict=True))
    assert name not in mine
    first, *others = mine
    for other in others:
        between = np.linalg.inv(mine[first]) @ mine[other]
        assert np.abs(between - np.linalg.inv(frames[first]) @ frames[other]).max() < NEAR


@pytest.mark.parametrize("of_angles", [finger_tips, link_frames, link_frames_batch])
@pytest.mark.parametrize("name", SHIPPED)
def test_other_shapes_are_refused(name: str, of_angles: Callable) -> None:
    """Of more angles, as of all joints of a hand with followers, the first ones were taken."""
    model = hand_named(name)
    driven = len(model.driven)
    of_angles(model, np.zeros((2, driven)))
    for wrong in (np.zeros((2, driven + 1)), np.zeros((2, driven - 1)), np.zeros(driven)):
        with pytest.raises(ValueError, match=r"q_rad: of shape .*; should be \(pose, driven "):
            of_angles(model, wrong)
