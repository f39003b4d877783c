"""The size of pads that a hand's first file guesses is one that its links have room for."""

from dataclasses import replace

import numpy as np
import pytest

from warpgrasp.chain.chain_hand import chain_of
from warpgrasp.chain.chain_pads import fitted_pads, pad_misfit
from warpgrasp.hands.hand_file import hand_from_file, hand_named
from warpgrasp.hands.hand_model import Box, Capsule, HandModel
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.parameters import PadTable


def with_last_links(length_m: dict[str, float], radius_m: float) -> HandModel:
    """A LEAP hand without a say on pads, whose last links are capsules of some lengths."""
    leap = hand_named("leap")
    fingers = []
    for finger in leap.fingers:
        last, long = finger.joints[-1], length_m.get(finger.name, 0.03)
        rod = Capsule((0.0, 0.0, 0.015), (0.0, -long, 0.015), radius_m)
        fingers.append(replace(finger, pad_places=(), tip_m=(0.0, -long - radius_m, 0.015),
                               joints=(*finger.joints[:-1], replace(last, shapes=(rod,)))))
    return replace(leap, fingers=tuple(fingers), pad_size=None)


def fits(model: HandModel) -> bool:
    return pad_misfit(chain_of(model), PadTable()) == ""


def test_pads_that_fit_stay_as_a_spec_has_them() -> None:
    model = with_last_links({}, 0.008)
    assert fits(model)
    assert fitted_pads(model) == (model, ())


@pytest.mark.parametrize(("length_m", "radius_m"), [
    (0.03, 0.025), (0.06, 0.03), (0.004, 0.006), (0.0, 0.012), (0.02, 0.003)])
def test_pads_are_made_to_fit_links(length_m: float, radius_m: float, tmp_path) -> None:
    """Links that are too thick or too short for 25.4 mm, balls, and links that are thinner than a
    pad is wide; also as the file has it, which rounds."""
    names = [finger.name for finger in hand_named("leap").fingers]
    model = with_last_links(dict.fromkeys(names, length_m), radius_m)
    assert not fits(model)
    made, notes = fitted_pads(model)
    assert fits(made)
    assert [finger.pads for finger in made.fingers] == [finger.pads for finger in model.fingers]
    assert made.pad_size is not None
    assert f"{made.pad_size.length_m * 1e3:.1f} mm" in notes[-1]
    file = tmp_path / "hand.toml"
    file.write_text(hand_text(made, notes, guessed=True))
    assert "[pads]  # GUESS; of every finger's" in file.read_text()
    assert fits(hand_from_file(file))


def test_fingers_without_room_bear_no_pad() -> None:
    """One of 4: the others keep pads of the usual length."""
    model, thick = with_last_links({}, 0.008), with_last_links({"thumb": 0.0}, 0.04)
    model = replace(model, fingers=tuple(
        other if one.name == "thumb" else one
        for one, other in zip(model.fingers, thick.fingers, strict=True)))
    made, notes = fitted_pads(model)
    assert fits(made)
    assert made.pad_size is None
    assert [bool(finger.pads) for finger in made.fingers] == [
        finger.name != "thumb" for finger in made.fingers]
    assert notes == ("finger thumb bears no pad, as its links have no room for one of 25.4 mm",)


def test_a_finger_whose_last_link_has_no_shape_bears_no_pad() -> None:
    model = with_last_links({}, 0.008)
    bare = model.fingers[0]
    joints = (*bare.joints[:-1], replace(bare.joints[-1], shapes=()))
    made, notes = fitted_pads(replace(model, fingers=(replace(bare, joints=joints),
                                                      *model.fingers[1:])))
    assert fits(made)
    assert made.fingers[0].pads == ()
    assert len(notes) == 1


def test_pads_of_boxes_fit_their_skin() -> None:
    """Capsules side by side stand for a box, and a pad bridges them."""
    model = with_last_links({}, 0.008)
    box = Box((0.0, -0.02, 0.015, 0.0, 0.0, 0.0, 1.0), (0.04, 0.05, 0.012))
    fingers = tuple(replace(finger, joints=(*finger.joints[:-1], replace(
        finger.joints[-1], shapes=(box,)))) for finger in model.fingers)
    made, _ = fitted_pads(replace(model, fingers=fingers))
    assert fits(made)
    assert all(np.size(finger.pads) for finger in made.fingers)
