"""Hands of chains whose fingers meet: which of a batch do, and their closings made right."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import ChainHand, capsule_ends, closing_way
from warpgrasp.chain.chain_kernel import CAPSULES, ChainPose, vec6
from warpgrasp.chain_closing.chain_closing_kernels import chain_meeting_kernel, chain_near_kernel
from warpgrasp.core.dtypes import real, vec3, vec4
from warpgrasp.core.kernel_launch import launch
from warpgrasp.core.lanes import has_lanes
from warpgrasp.core.struct_array import Records, record_type
from warpgrasp.finger.chain_energy import ChainRest
from warpgrasp.finger.chain_friction import ChainFriction
from warpgrasp.hand_rest.chain_meetings import CapsulePair, ChainMeeting
from warpgrasp.hand_rest.meetings import MEETINGS
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.chain_balance import ChainGrip

CLOSE_M = 3e-3
"""Links that are as near in the open hand are built so, and do not count as touching."""
_BESIDE_M, _BESIDE_CHANGE_M = 6e-3, 8e-3
"""Links of two fingers that come as near, and whose distance changes by less from the open hand to
the closed one, go side by side, and do not count as touching: fingers of real hands do so freely
even where the shapes that stand for them meet [est]."""
_PLACES = 5
"""Of a closing at which that is asked."""
_SHAPES = {
    "body": "some", "body_pose": "world", "hands": "robots finger", "believed": "1 finger",
    "sensors": "feelers finger", "palm": "bar 2", "palm_balls": "bar", "pairs": "pair",
    "key": "world", "probe_number": "world probe", "hand_pose": "world probe",
    "path": "grasp finger step", "come": f"grasp finger {CAPSULES} step",
    "command_count": "grasp", "order": "orders grasp pair", "slack": "orders grasp pair",
    "place": "row", "near": "row", "state": "row slot", "meetings": f"row {MEETINGS}",
    "ends": "row every 2", "balls": "row every", "listed": "row pair", "come_since": "row finger",
    "come_to": "row finger", "due": "row pair",
    "poses": "row finger", "posed": "row finger",
    "frictions": "rubs finger", "grips": "rubs slot",
    "felt": "world probe grasp finger", "truth": "world probe grasp finger",
    "ended": "world? probe? grasp? finger?"}

_RECORDS = ("state", "meetings", "poses", "frictions", "grips")
"""What kernels work in that is made of structs."""


def resolve_meetings(
    hand: ChainHand, status: np.ndarray, order: wp.array, slack: wp.array,
    given: Mapping[str, Any], rubs: bool, device: str,
) -> None:
    """Close together the fingers of those hands whose links come near one another.

    `status` (world, probe, grasp) are those of the closings made, `order` and `slack` are as
    `pair_slack`, `given` are the closing's arguments, and `rubs` says whether there is friction.
    The hand has `MOST_MEETING` fingers at most.
    """
    place = np.argwhere(np.isin(status, (ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT)))
    if len(place) == 0:
        return
    palm, palm_balls, pairs = pairs_on_device(hand, CLOSE_M, device)
    every = {**given, "has_lanes": has_lanes(device), "palm": palm, "palm_balls": palm_balls,
             "pairs": pairs, "order": order, "slack": slack}
    near = _rows(chain_near_kernel, hand, place, every, rubs, device)
    some = near >= 0
    if some.any():
        _rows(chain_meeting_kernel, hand, place[some], every, rubs, device, near[some])


def _rows(kernel: Any, hand: ChainHand, place: np.ndarray, given: Mapping[str, Any], rubs: bool,
          device: str, near: np.ndarray | None = None) -> np.ndarray:
    """Run a kernel over some hands; the steps at which their links come near, (row,)."""
    n = len(place)
    found = wp.array(np.zeros(n, np.int32) if near is None else near.astype(np.int32), dtype=int,
                     device=device)
    own, pairs = hand.fingers, given["pairs"].shape[0]
    rubbing = n if rubs else 1
    rooms: dict[str, tuple[Any, tuple[int, ...]]] = {
        "state": (ChainRest, (n, 2 * own)), "meetings": (ChainMeeting, (n, MEETINGS)),
        "poses": (ChainPose, (n, own)), "frictions": (ChainFriction, (rubbing, own)),
        "grips": (ChainGrip, (rubbing, 2 * own)), "ends": (vec3, (n, own * CAPSULES, 2)),
        "balls": (vec4, (n, own * CAPSULES)), "listed": (int, (n, pairs)),
        "due": (real, (n, pairs)), "come_since": (real, (n, own)), "come_to": (vec6, (n, own)),
        "posed": (vec6, (n, own))}
    taken = [a.label for a in kernel.adj.args if a.label in rooms]
    # What a kernel finds in them it has put there, but for grips.
    rows = {name: Records(rooms[name][0], rooms[name][1], device, clear=name == "grips")
            for name in taken if name in _RECORDS}
    scratch = {name: rows[name].array if name in rows else wp.empty(
        rooms[name][1], dtype=rooms[name][0], device=device) for name in taken}
    values = {**given, **scratch, "near": found,
              "place": wp.array(place.astype(np.int32), dtype=wp.vec3i, device=device)}
    # Here worlds are no axis of the launch: their number is stated by an array that has them all.
    launch(kernel, {"row": n}, _SHAPES,
           {a.label: values[a.label] for a in kernel.adj.args if a.label in values}, device=device,
           heavy=True)
    return found.numpy()


@lru_cache(maxsize=16)
def palm_of(hand: ChainHand, close_m: float = CLOSE_M
            ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The palm's capsules (bar, 2, 3) and radii (bar,) [m], and which pairs of capsules are none:
    bool (finger x `CAPSULES`, the same, then bars). Those that are nearer than `close_m` in the
    open hand are none, and those of fingers that go side by side."""
    ends = np.array([(c.start, c.end) for c in hand.palm]).reshape(-1, 2, 3)
    radius = np.array([c.radius for c in hand.palm])
    if len(ends) == 0:  # a palm without shape: one far away
        ends, radius = np.array([[[0.0, 0.0, -9.0], [0.0, 0.0, -9.1]]]), np.array([0.01])
    way = closing_way(hand, hand.model.closings[0], _PLACES)
    own = [f * CAPSULES + c for f in range(hand.fingers) for c in range(len(hand.capsules[f]))]
    thick = np.concatenate([*([c.radius for c in capsules] for capsules in hand.capsules), radius])
    apart = np.array([
        _apart(np.concatenate([*(capsule_ends(hand, f, way[f, n]) for f in range(hand.fingers)),
                               ends])) for n in range(_PLACES)]) - thick[:, None] - thick[None]
    beside = (apart.min(0) < _BESIDE_M) & (np.ptp(apart, axis=0) < _BESIDE_CHANGE_M)
    beside[:, len(own):] = False  # the palm is beside no link
    whole = hand.fingers * CAPSULES
    barred = np.ones((whole, whole + len(ends)), bool)
    to = [*own, *range(whole, whole + len(ends))]
    barred[np.ix_(own, to)] = ((apart[0] < close_m) | beside)[:len(own)]
    for f in range(hand.fingers):  # links of a finger, and its first one and the palm
        for c, joint in enumerate(hand.capsule_joint[f]):
            barred[f * CAPSULES + c, f * CAPSULES:(f + 1) * CAPSULES] = True
            barred[f * CAPSULES + c, whole:] |= joint == 0
    return ends, radius, barred


@lru_cache(maxsize=16)
def pairs_on_device(hand: ChainHand, close_m: float, device: str
                    ) -> tuple[wp.array, wp.array, wp.array]:
    """The palm's capsules (bar, 2), the balls around their axes (bar,), middles and radii, and the
    pairs of capsules that may touch (`palm_of`), (pair,), as kernels take them."""
    ends, thick, barred = palm_of(hand, close_m)
    whole = hand.fingers * CAPSULES
    free = ~barred
    free[:, :whole] &= np.triu(free[:, :whole])  # each pair once
    row, other = np.argwhere(free).T
    pairs = np.zeros(len(row), record_type(CapsulePair))
    pairs["one"], pairs["capsule"] = np.divmod(row, CAPSULES)
    pairs["two"] = np.where(other < whole, other // CAPSULES, -1)
    pairs["other"] = np.where(other < whole, other % CAPSULES, other - whole)
    radius = np.zeros(whole + len(ends))
    radius[whole:] = thick
    for f, own in enumerate(hand.capsules):
        radius[f * CAPSULES:f * CAPSULES + len(own)] = [c.radius for c in own]
    pairs["both"] = radius[row] + radius[other]
    balls = np.column_stack([ends.mean(1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1) / 2])
    return (wp.array(ends, dtype=vec3, device=device), wp.array(balls, dtype=vec4, device=device),
            wp.array(pairs, dtype=CapsulePair, device=device))


def _apart(segments: np.ndarray) -> np.ndarray:
    """About how far segments (segment, 2, 3) are apart [m], (segment, segment): by samples."""
    share = np.linspace(0.0, 1.0, 21)[:, None]
    points = segments[:, None, 0] + share * (segments[:, None, 1] - segments[:, None, 0])
    found = np.empty((len(points), len(points)))
    for n, one in enumerate(points):
        found[n] = np.linalg.norm(one[None, :, None] - points[:, None], axis=-1).min((1, 2))
    return found
