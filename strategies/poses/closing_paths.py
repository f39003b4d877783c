"""Closing paths: the joint commands along which a finger closes, and how fast they step.

A path is a polyline through joint space (abduction, then three flexions). Tip-leading paths curl
the middle and distal joints first and close the base last, so that the fingertip, which the paper
takes as the contact, is what touches.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, radians

import numpy as np

from warpgrasp.parameters import HandTable

FINGER_COUNT = 4  # three fingers side by side, then the thumb
SPREAD_SIGN = (-1.0, 0.0, 1.0, 0.0)  # the outer fingers abduct away from the middle one


@dataclass(frozen=True)
class ClosingPath:
    """A named polyline of joint commands [rad], each knot (abduction, flexion 1, 2, 3)."""

    name: str
    doc: str
    knots_rad: tuple[tuple[float, float, float, float], ...]
    step_rad: float = radians(0.5)


def _degrees(*knots: tuple[float, float, float, float]) -> tuple[
        tuple[float, float, float, float], ...]:
    return tuple(tuple(radians(v) for v in knot) for knot in knots)  # pyright: ignore


def _tip_leading(curl: float, spread: float) -> tuple[tuple[float, float, float, float], ...]:
    return _degrees((spread, -10, 0, 0), (spread, -10, curl, curl), (spread, 90, curl, curl))


CLOSING_PATHS: dict[str, ClosingPath] = {path.name: path for path in (
    ClosingPath("together", "all flexions together from straight (middle links touch first)",
                _degrees((0, -10, 0, 0), (0, 90, 95, 95))),
    ClosingPath("curl25", "tip-leading: curl 25 deg, then the base closes", _tip_leading(25, 0)),
    ClosingPath("curl40", "tip-leading: curl 40 deg, then the base closes", _tip_leading(40, 0)),
    ClosingPath("curl55", "tip-leading: curl 55 deg, then the base closes", _tip_leading(55, 0)),
    ClosingPath("curl25_spread", "curl 25 deg with the outer fingers spread 15 deg",
                _tip_leading(25, 15)),
    ClosingPath("curl55_spread", "curl 55 deg with the outer fingers spread 15 deg",
                _tip_leading(55, 15)),
    ClosingPath("base_then_curl", "the base closes almost straight, then the tip curls",
                # Off their stops by 5 deg: at a stop a touch turns no joint, and tendons feel none.
                _degrees((0, -10, 0, 0), (0, -10, 5, 5), (0, 60, 5, 5), (0, 90, 95, 95))),
    *(ClosingPath(f"from{base}", f"the base opens to {base} deg only, then closes as "
                  "base_then_curl", _degrees((0, base, 5, 5), (0, 60, 5, 5), (0, 90, 95, 95)))
      for base in (10, 25)),
)}


def commands_within(commands_rad: np.ndarray, hand: HandTable) -> np.ndarray:
    """Commands (finger, step, 4) of the Utah-MIT hand, no joint beyond its limits; without steps in
    which none moves then."""
    within = np.clip(commands_rad, [hand.abduction_limit_rad[0], *hand.flexion_low_rad],
                     [hand.abduction_limit_rad[1], *hand.flexion_high_rad])
    moves = (np.diff(within, axis=1) != 0.0).any((0, 2))
    return within[:, np.concatenate([[True], moves])]


def closing_commands(path: ClosingPath) -> np.ndarray:
    """Every command of a path, joint angles [rad], shape (finger, step, 4).

    No joint moves more than `step_rad` between two commands; row 0 is the open hand.
    """
    knots = np.asarray(path.knots_rad, float)
    rows = [knots[:1]]
    for start, end in pairwise(knots):
        count = max(1, ceil(np.abs(end - start).max() / path.step_rad - 1e-9))
        rows.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    commands = np.concatenate(rows)
    fingers = np.repeat(commands[None], FINGER_COUNT, axis=0)
    fingers[:, :, 0] *= np.asarray(SPREAD_SIGN)[:, None]
    return fingers
