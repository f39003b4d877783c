"""A device that computes as the CPU does agrees with it; one that does not is reported."""

import numpy as np
import pytest
from other_device import other_device

from sweeps.bench import device_agreement


@pytest.mark.slow
def test_a_device_that_differs_in_name_only_agrees() -> None:
    with other_device() as device:
        said = list(device_agreement.agreements(8, device))
    assert [line for line, right in said if not right] == []
    assert len(said) == len(device_agreement.CLOSINGS) + 2 + len(device_agreement.EPISODES)


def test_closings_that_end_elsewhere_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    def closings(name: str, hand: object, worlds: int, device: str):
        step, q = np.full(200, 7), np.zeros((200, 4))
        if device != "cpu":
            step[:{"block": 2, "wedge": 3}.get(name, 0)] = 8
            q[:3] += 2e-6 if name == "lightbulb" else 0.0
        return step, q

    monkeypatch.setattr(device_agreement, "closings", closings)
    said = device_agreement.agreements(1, "other")
    judged = [right for _, (_, right) in zip(device_agreement.CLOSINGS, said, strict=False)]
    assert judged == [name not in ("wedge", "lightbulb")
                      for name, _ in device_agreement.CLOSINGS]
