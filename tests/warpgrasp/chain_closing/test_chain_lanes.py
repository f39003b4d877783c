"""Steps that are looked at side by side tell what those looked at one after the other tell."""

from dataclasses import replace

import numpy as np
import pytest
from chain_closings import ALONE, QUIET, close, poses_above

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind
from warpgrasp.chain_closing import chain_closing, chain_meeting
from warpgrasp.probe_status import ProbeStatus

TOGETHER = replace(ALONE, friction=0.5, self_contact=True)


@pytest.mark.parametrize("name", ["allegro", "leap", "barrett"])
@pytest.mark.parametrize("weighs", [True, False])
def test_fingers_stop_and_rest_at_the_same_places(
    name: str, weighs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = chain_of(hand_of_kind(name))
    commands, poses = chain_commands(hand, "curl40"), poses_above(32)
    contact = replace(TOGETHER, weight=weighs)
    felt, truth = close(hand, "wedge", poses, commands, QUIET, contact)
    for module in (chain_closing, chain_meeting):
        monkeypatch.setattr(module, "has_lanes", lambda device: False)
    one_by_one, true = close(hand, "wedge", poses, commands, QUIET, contact)
    assert (felt.status == ProbeStatus.CONTACT).sum() > 10
    assert truth.self_contact.any() or name == "barrett"
    np.testing.assert_array_equal(felt.status, one_by_one.status)
    np.testing.assert_array_equal(felt.step, one_by_one.step)
    np.testing.assert_allclose(truth.q_rad, true.q_rad, atol=1e-7)
    np.testing.assert_allclose(truth.rest_rad, true.rest_rad, atol=1e-7)
