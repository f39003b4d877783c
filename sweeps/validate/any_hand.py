"""Guarded closing of hands of chains against MuJoCo, on ten bodies: Allegro, LEAP and Barrett, or
hands of files.

Random hand poses, all fingers, several thresholds of the joints' torques, no sensor noise. Stops,
tips and torques are compared closing by closing.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import product
from math import nan
from multiprocessing import get_context

import numpy as np

from strategies.poses.chain_paths import chain_commands
from sweeps.output import init_warp
from sweeps.validate.comparison import Comparison
from sweeps.validate.guarded_closing import TEN, Bounds, bodies_compared, random_poses
from sweeps.validate.mujoco_chain import MujocoChain
from warpgrasp.chain.chain_hand import ChainHand, chain_of, chain_of_table, link_frames_of
from warpgrasp.chain_closing.chain_closing import close_chains
from warpgrasp.geometry.body import Body, scene_of
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.hands.hand_model import HandError
from warpgrasp.parameters import ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

HANDS = ("allegro", "leap", "barrett")
PATHS = ("curl40", "base_then_curl")
THRESHOLDS_NM = (0.03, 0.06, 0.12)
ALONE = replace(ContactTable(), friction=0.0, self_contact=False)
"""Each finger for itself."""
RUBBING = replace(ALONE, friction=0.5)
BOUNDS = {ALONE: Bounds(0.05, 5e-4, 0.05), RUBBING: Bounds(0.10, 1e-3, 0.05)}
TABLE = HandTable()


@dataclass
class _Tally:
    """Differences of all closings of some hands."""

    pairs: int = 0
    stops: tuple[int, int] = (0, 0)
    apart: int = 0
    tip_m: list[float] = field(default_factory=list)
    torque: list[float] = field(default_factory=list)


def compare_hands(poses: int = 24, workers: int = 2, hands: Sequence[str] = HANDS
                  ) -> list[Comparison]:
    """Rows for each hand, without friction and with: over all ten bodies, then body by body;
    `poses` random hand poses for each body and closing path. Raises HandError for a hand that is
    none, or not of chains."""
    for name in hands:
        _chain(name)
    runs = [(hand, body, poses, contact) for contact in BOUNDS for hand in hands for body in TEN]
    with ProcessPoolExecutor(workers, get_context("spawn"), initializer=init_warp) as pool:
        tallies = list(pool.map(tally_of, *zip(*runs, strict=True)))
    rows: list[Comparison] = []
    for contact, hand in product(BOUNDS, hands):
        own = [(body, t) for (h, body, _, acts), t in zip(runs, tallies, strict=True)
               if h == hand and acts == contact]
        total = _Tally()
        for _, tally in own:
            _add(total, tally)
        rubs = f", friction {contact.friction:g}" if contact.friction else ""
        name = _chain(hand).model.name
        rows += rows_of_tally(f"{name}, ten bodies{rubs}", total, BOUNDS[contact])
        for body, tally in own:
            rows += rows_of_tally(f"{name}, {body}{rubs}", tally, Bounds())
    return rows


def _chain(name: str) -> ChainHand:
    """The hand, guarded by the torques of its joints."""
    hand = chain_of_table(HandTable(kind=name))
    if hand is None:
        raise HandError(f"hand {name!r}: has closings of its own, which the check `closing` "
                        "compares")
    return chain_of(replace(hand.model, senses="joint_torques"))


def tally_of(name: str, body_name: str, poses: int, contact: ContactTable = ALONE) -> _Tally:
    """The differences of a hand before one of `bodies_compared`."""
    body, solids = bodies_compared()[body_name]
    hand = _chain(name)
    quiet = _quiet(THRESHOLDS_NM[0])
    theirs = MujocoChain(solids, hand, TABLE, quiet, contact)
    tally = _Tally()
    for path in PATHS:
        commands = chain_commands(hand, path)
        places = random_poses(theirs, body, commands[:, 0], poses)
        stops = []
        for pose in places:
            theirs.place(pose)
            stops.append(theirs.close(commands, THRESHOLDS_NM))
        for k, threshold in enumerate(THRESHOLDS_NM):
            felt, truth = _ours(body, hand, places, commands, threshold, contact)
            tips = _tips(hand, places, truth.q_rad[:, 0, 0])
            for i, f in np.ndindex(len(places), hand.fingers):
                stopped = felt.status[i, 0, 0, f] == ProbeStatus.CONTACT
                _tell(tally, stopped, int(felt.step[i, 0, 0, f]), tips[i, f],
                      truth.torque_Nm[i, 0, 0, f], stops[i][f][k])
    return tally


def _quiet(threshold: float) -> SensorTable:
    return SensorTable(torque_threshold_Nm=threshold, torque_noise_Nm=0.0, torque_step_Nm=0.0,
                       joint_noise_rad=0.0)


def _ours(body: Body, hand: ChainHand, places: np.ndarray, commands: np.ndarray, threshold: float,
          contact: ContactTable):
    n = len(places)
    return close_chains(
        scene_of([body], "cpu"), np.zeros(1, int), np.tile([0, 0, 0, 0, 0, 0, 1.0], (n, 1)), hand,
        TABLE, _quiet(threshold), np.arange(n, dtype=np.uint64),
        np.full((n, 1, 1), int(ProbeStatus.CONTACT)), places[:, None], commands[None],
        np.array([commands.shape[1]]), contact=contact)


def _tips(hand: ChainHand, places: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
    """Places of the tips in the world (pose, finger, 3) of hands at `places`."""
    found = []
    for pose, q in zip(places, q_rad, strict=True):
        x, y, z, a, b, c, d = pose
        at = matrix_of((x, y, z, a, b, c, d))
        found.append([(at @ link_frames_of(hand, f, q[f])[-1] @ [*finger.tip_m, 1.0])[:3]
                      for f, finger in enumerate(hand.model.fingers)])
    return np.array(found)


def _tell(tally: _Tally, stopped: bool, step: int, tip_m: np.ndarray, torque_Nm: np.ndarray,
          theirs) -> None:
    """Count one finger at one threshold."""
    tally.stops = (tally.stops[0] + stopped, tally.stops[1] + (theirs is not None))
    if not stopped and theirs is None:
        return
    tally.pairs += 1
    if not stopped or theirs is None or abs(step - theirs.step) > 1:
        tally.apart += 1
        return
    if step != theirs.step:  # a step apart, the commands differ: positions would too
        return
    largest = float(np.abs(theirs.torque_Nm).max())
    tally.tip_m.append(float(np.linalg.norm(tip_m - theirs.tip_m)))
    tally.torque.append(float(np.abs(
        torque_Nm[:len(theirs.torque_Nm)] - theirs.torque_Nm).max()) / largest)


def _add(total: _Tally, part: _Tally) -> None:
    total.pairs += part.pairs
    total.apart += part.apart
    total.stops = (total.stops[0] + part.stops[0], total.stops[1] + part.stops[1])
    total.tip_m += part.tip_m
    total.torque += part.torque


def rows_of_tally(what: str, tally: _Tally, bounds: Bounds) -> list[Comparison]:
    """The comparisons of some closings."""
    def p95(values: Sequence[float]) -> float:
        return float(np.quantile(values, 0.95)) if values else nan

    def largest(values: Sequence[float], factor: float = 1.0, unit: str = "") -> str:
        return f"largest {factor * max(values):.3g}{unit}" if values else "no stops"

    return [
        Comparison("hands", f"{what}: stops more than a step apart, of {tally.pairs}", "share",
                   *tally.stops, tally.apart / max(tally.pairs, 1), bounds.apart),
        Comparison("hands", f"{what}: tip at the stop, p95", "mm", nan, nan,
                   1e3 * p95(tally.tip_m), 1e3 * bounds.tip_m, largest(tally.tip_m, 1e3, " mm")),
        Comparison("hands", f"{what}: torque of the largest, p95", "share", nan, nan,
                   p95(tally.torque), bounds.torque,
                   largest(tally.torque))]
