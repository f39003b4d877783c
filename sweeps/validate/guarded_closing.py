"""Guarded closing against MuJoCo: random hand poses, four fingers, several thresholds.

Stops, tips, torques, contact points and normals are compared without sensor noise, closing by
closing; every closing that differs is put down to a cause.
"""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from math import nan
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from sweeps.output import init_warp
from sweeps.validate.comparison import Comparison
from sweeps.validate.mujoco_hand import (
    MujocoFingers,
    MujocoHand,
    MujocoStop,
    tension_differences,
)
from sweeps.validate.reference_finger import (
    OVERLAP_M,
    FingerEnergy,
    link_overlap,
    overlap_beyond_skin,
)
from warpgrasp.closing.closing import Closing, ClosingTruth, close_fingers
from warpgrasp.export.convex_solids import Solid, object_solids
from warpgrasp.geometry.body import Body, Part, scene_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.objects.body_baking import touched_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

THRESHOLDS_N = (3.0, 6.0, 12.0)
PATHS = ("curl40", "base_then_curl")


@dataclass(frozen=True)
class Bounds:
    """Must hold: share of stops more than a step apart; 95th percentiles of tip and torque (of the
    largest)."""

    apart: float = nan
    tip_m: float = nan
    torque: float = nan
    overlap: float = nan


BOUNDS = (Bounds(0.05, 5e-4, 0.05, 0.0), Bounds(0.10, 1e-3, nan, 0.0))
"""Without and with friction."""
_TIP_M, _TORQUE = 5e-4, 0.05
"""Closings that differ by more are put down to a cause."""
UNPRESSED_M = 2e-5  # what the joints bear presses links that overlap to within this
HAND = HandTable()
_HALF_AXES_M = (0.030, 0.050)  # of the ellipsoid, across and along its axis


@dataclass
class _Tally:
    """Differences of all closings that stopped in both, and what became of the others."""

    pairs: int = 0
    stops_ours: int = 0
    stops_theirs: int = 0
    apart: int = 0
    tip_m: list[float] = field(default_factory=list)
    torque: list[float] = field(default_factory=list)
    torque_Nm: list[tuple[float, float]] = field(default_factory=list)
    point_m: list[float] = field(default_factory=list)
    normal_rad: list[float] = field(default_factory=list)
    force_N: list[tuple[float, float]] = field(default_factory=list)
    links: Counter[int] = field(default_factory=Counter)
    other_link: int = 0
    causes: Counter[str] = field(default_factory=Counter)
    overlap_m: list[float] = field(default_factory=list)
    unpressed_m: list[float] = field(default_factory=list)  # of those above OVERLAP_M


def compare_closing(poses: int = 24, workers: int = 2) -> list[Comparison]:
    """All comparisons; `poses` random hand poses for each body and closing path."""
    some, every = max(poses // 4, 2), tuple(bodies_compared())
    whole = [(name, PATHS, poses, contact) for contact in (FREE, RUBBING)
             for name in (every if contact == FREE else TEN)]
    parts = [(name, PATHS[1:], some, contact) for contact in PIECES.values() for name in _VARIED]
    runs = [*whole, *parts]
    with ProcessPoolExecutor(workers, get_context("spawn"), initializer=init_warp) as pool:
        tallies = list(pool.map(_tally, *zip(*runs, strict=True)))
    rows: list[Comparison] = []
    for contact, what in ((FREE, "no friction"), (RUBBING, f"friction {RUBBING.friction:g}")):
        ten, each = _Tally(), []
        for (name, _, _, acting), tally in zip(whole, tallies, strict=False):
            if acting == contact:
                each += _rows(f"{name}, {what}", tally)
                if name in TEN:
                    _add(ten, tally)
        hands = len(TEN) * len(PATHS) * poses
        rows += _rows(f"ten bodies, {hands} hands, {what}", ten, BOUNDS[contact.friction > 0.0])
        rows += each
    left = iter(tallies[len(whole):])
    for what in PIECES:
        both = _Tally()
        for _ in _VARIED:
            _add(both, next(left))
        rows += _rows(f"box and cylinder, {what}", both)
    return rows + _moved_rows(max(poses, 24))


FREE = replace(ContactTable(), friction=0.0)
RUBBING = replace(ContactTable(), friction=0.5)
_VARIED = ("box", "cylinder")
PIECES = {
    "joint stops alone": replace(FREE, weight=False, self_contact=False),
    "weight alone": replace(FREE, joint_stops=False, self_contact=False),
    "fingers that meet alone": replace(FREE, joint_stops=False, weight=False),
    "friction 0.5 alone": replace(ContactTable.none(), friction=0.5),
    "none of these": ContactTable.none(),
}
"""The physics beside servos, skin and object, a piece at a time."""
MOVED_M = 2e-3


def _moved_rows(poses: int) -> list[Comparison]:
    """How many stops and tips each piece of the physics moves, against a finger without any."""
    rows = []
    bodies = bodies_compared()
    for path in PATHS:
        commands = closing_commands(CLOSING_PATHS[path])
        for what, contact in {**PIECES, "all but friction": FREE, "all together": RUBBING}.items():
            if what == "none of these":
                continue
            stops = tips = count = 0
            for name in _VARIED:
                body, solids = bodies[name]
                places = random_poses(MujocoHand(solids, HAND, FREE), body, commands[:, 0],
                                      poses)
                ends = [_ours(body, places, commands, 6.0, c)
                        for c in (ContactTable.none(), contact)]
                step = [felt.step[:, 0, 0] for felt, _ in ends]
                tip = [hand_links(HAND, places, truth.q_rad[:, 0, 0])[0][:, :, 4]
                       for _, truth in ends]
                stops += int((np.abs(step[1] - step[0]) > 1).sum())
                tips += int((np.linalg.norm(tip[1] - tip[0], axis=-1) > MOVED_M).sum())
                count += step[0].size
            for quantity, moved in (("stops moved by more than a step", stops),
                                    (f"tips moved by more than {1e3 * MOVED_M:g} mm", tips)):
                rows.append(Comparison("closing", f"{what}, {path}: {quantity}, of {count}",
                                       "share", nan, nan, moved / max(count, 1)))
    return rows


def _tally(name: str, paths: Sequence[str], poses: int, contact: ContactTable) -> "_Tally":
    body, solids = bodies_compared()[name]
    tally = _Tally()
    for path in paths:
        _compare(tally, body, solids, path, poses, contact)
    return tally


def compare_body(name: str, poses: int, contact: ContactTable = FREE) -> list[Comparison]:
    """The comparisons of one of `bodies_compared` alone."""
    return _rows(name, _tally(name, PATHS, poses, contact), BOUNDS[contact.friction > 0.0])


PROFILES = ("large_cylinder", "lightbulb", "funnel", "wine_bottle")
"""Bodies of revolution from the catalogue; slices of cones are polyhedra to MuJoCo."""
EXACT = ("box", "cylinder", "capsule", "ellipsoid", "wedge")
"""Bodies whose distance is exact; a wedge is a convex mesh to MuJoCo."""
TEN = (*EXACT, *PROFILES, "hull (baked grid)")
"""Bodies for which bounds are promised."""


def bodies_compared() -> dict[str, tuple[Body, list[Solid]]]:
    """Bodies by name, each with the solids that MuJoCo is given."""
    across, along = _HALF_AXES_M
    angle = np.linspace(0.0, np.pi, 400)
    profile = np.stack([along * (1.0 - np.cos(angle)), across * np.sin(angle)], 1)
    ellipsoid = Body("ellipsoid", (Part(Shape.REVOLUTION, profile_m=profile),),
                     (-across, -across, 0.0), (across, across, 2 * along))
    superquadric = body_from_table({"name": "superquadric", "superquadric": {
        "size_mm": [25, 35, 50], "exponents": [1.0, 1.0]}}, Path())
    capsule = body_from_table({"name": "capsule", "compound": [
        {"shape": "capsule", "radius_mm": 25, "height_mm": 110}]}, Path())
    bodies = {"box": body_from_name("block"), "cylinder": body_from_name("small_cylinder"),
              "capsule": capsule, "wedge": body_from_name("wedge")}
    bodies |= {name: body_from_name(name) for name in PROFILES}
    found = {name: (body, object_solids(body)) for name, body in bodies.items()}
    found["ellipsoid"] = (ellipsoid, [Solid("ellipsoid", (across, across, along),
                                            (0.0, 0.0, along, 0.0, 0.0, 0.0, 1.0))])
    found["superquadric (baked grid)"] = (touched_body(superquadric),
                                          object_solids(superquadric))
    found["hull (baked grid)"] = random_hull()
    return found


def random_hull() -> tuple[Body, list[Solid]]:
    """A convex polyhedron of random corners: a mesh to both, baked to a grid by us."""
    from tempfile import TemporaryDirectory

    import trimesh

    from warpgrasp.objects.mesh_import import body_from_mesh, mesh_triangles

    rng = np.random.default_rng(7)
    corner = rng.normal(size=(24, 3))
    corner /= np.linalg.norm(corner, axis=1, keepdims=True)
    corner *= [0.03, 0.035, 0.055]
    hull = trimesh.Trimesh(corner).convex_hull
    with TemporaryDirectory() as folder:
        file = Path(folder) / "hull.ply"
        file.write_bytes(bytes(hull.export(file_type="ply")))
        body = body_from_mesh(file, units="m")
        return body, object_solids(body, mesh_triangles(file, units="m"))


def random_poses(hand: MujocoFingers, body: Body, open_rad: np.ndarray, count: int) -> np.ndarray:
    """Hand poses (count, 7) about a body from which the open hand touches nothing."""
    rng = np.random.default_rng(1)
    low, high = np.asarray(body.low_m), np.asarray(body.high_m)
    poses: list[np.ndarray] = []
    while len(poses) < count:
        tilt, azimuth, roll = rng.uniform([0.0, -np.pi, -np.pi],
                                          [np.radians(80), np.pi, np.pi])
        turn = Rotation.from_euler("ZYZ", [azimuth, np.pi - tilt, roll])
        aim = low + (high - low) * rng.uniform([0.25, 0.25, 0.1], [0.75, 0.75, 1.0])
        place = aim - turn.apply([0.0, 0.0, 1.0]) * rng.uniform(0.03, 0.12)
        pose = np.concatenate([place, turn.as_quat()])
        hand.place(pose)
        if not hand.touches(open_rad):
            poses.append(pose)
    return np.array(poses)


def _compare(tally: _Tally, body: Body, solids: Sequence[Solid], path: str, poses: int,
             contact: ContactTable) -> None:
    hand = MujocoHand(solids, HAND, contact)
    commands = closing_commands(CLOSING_PATHS[path])
    places = random_poses(hand, body, commands[:, 0], poses)
    theirs = []
    for pose in places:
        hand.place(pose)
        theirs.append(hand.close(commands, THRESHOLDS_N))
    for k, threshold in enumerate(THRESHOLDS_N):
        felt, truth = _ours(body, places, commands, threshold, contact)
        tips = hand_links(HAND, places, truth.q_rad[:, 0, 0])[0][:, :, 4]
        deep = link_overlap(HAND, places, truth.rest_rad[:, 0, 0])
        tally.overlap_m += deep.tolist()
        for i in np.flatnonzero(deep > OVERLAP_M):
            fingers = [FingerEnergy(body, HAND, places[i], f, contact) for f in range(4)]
            rest, held = truth.rest_rad[i, 0, 0], commands[np.arange(4), felt.step[i, 0, 0]]
            tally.unpressed_m.append(abs(overlap_beyond_skin(fingers, rest, held)))
        for i, f in np.ndindex(len(places), 4):
            ours = _Ours(felt, truth, tips, (i, 0, 0, f), (i, f))
            _tell(tally, body, places[i], commands, threshold, ours, theirs[i][f][k], contact)


class _Ours:
    """Our end of one finger's closing, in the words of a MujocoStop."""

    def __init__(self, felt: Closing, truth: ClosingTruth, tips: np.ndarray,
                 at: tuple[int, ...], tip: tuple[int, int]) -> None:
        self.stopped = felt.status[at] == ProbeStatus.CONTACT
        self.step, self.link = int(felt.step[at]), int(truth.link[at])
        self.q_rad, self.torque_Nm = truth.q_rad[at], truth.torque_Nm[at]
        self.tip_m, self.finger = tips[tip], tip[1]
        self.point_m, self.normal = truth.point_m[at], truth.normal[at]


def _ours(body: Body, places: np.ndarray, commands: np.ndarray, threshold: float,
          contact: ContactTable) -> tuple[Closing, ClosingTruth]:
    n = len(places)
    quiet = SensorTable(tendon_threshold_N=threshold, tension_noise_N=0.0, tension_step_N=0.0,
                        joint_noise_rad=0.0)
    return close_fingers(
        scene_of([body], "cpu"), np.zeros(1, int), np.tile([0, 0, 0, 0, 0, 0, 1.0], (n, 1)), HAND,
        quiet, np.arange(n, dtype=np.uint64), np.full((n, 1, 1), int(ProbeStatus.CONTACT)),
        places[:, None], commands[None], np.array([commands.shape[1]]),
        contact=contact)


def _tell(tally: _Tally, body: Body, pose: np.ndarray, commands: np.ndarray, threshold: float,
          ours: _Ours, theirs: MujocoStop | None, contact: ContactTable) -> None:
    """Count one finger at one threshold."""
    tally.stops_ours += ours.stopped
    tally.stops_theirs += theirs is not None
    if not ours.stopped and theirs is None:
        return
    tally.pairs += 1
    if not ours.stopped or theirs is None or abs(ours.step - theirs.step) > 1:
        tally.apart += 1
        tally.causes[_cause(body, pose, commands, threshold, ours, theirs, contact)] += 1
        return
    if ours.step != theirs.step:  # a step apart, the commands differ: positions would too
        return
    tip = float(np.linalg.norm(ours.tip_m - theirs.tip_m))
    largest = float(np.abs(theirs.torque_Nm).max())
    torque = float(np.abs(ours.torque_Nm - theirs.torque_Nm).max()) / largest
    tally.tip_m.append(tip)
    tally.torque.append(torque)
    tally.torque_Nm.append((float(np.abs(ours.torque_Nm).max()), largest))
    if ours.link == theirs.link:
        tally.links[ours.link] += 1
        tally.point_m.append(float(np.linalg.norm(ours.point_m - theirs.point_m)))
        tally.normal_rad.append(float(np.arccos(np.clip(ours.normal @ theirs.normal, -1, 1))))
        if theirs.touch_N > 0.0 and ours.link == 2:
            energy = FingerEnergy(body, HAND, pose, ours.finger)
            depth = np.maximum(energy.links(ours.q_rad).depth_m[2], 0.0)
            tally.force_N.append((HAND.skin_stiffness_N_m * float(depth.max()), theirs.touch_N))
    else:
        tally.other_link += 1
    if tip > _TIP_M or torque > _TORQUE:
        tally.causes[_cause(body, pose, commands, threshold, ours, theirs, contact)] += 1


def _cause(body: Body, pose: np.ndarray, commands: np.ndarray, threshold: float, ours: _Ours,
           theirs: MujocoStop | None, contact: ContactTable) -> str:
    """Why two closings differ."""
    if body.parts[0].shape == Shape.GRID:
        return "distance is baked on a grid"
    if theirs is None:
        return "MuJoCo never reaches the threshold" if _margin(
            ours, commands, threshold) > 0.01 else "threshold grazed"
    if not theirs.settled:
        return "MuJoCo did not come to rest"
    energy = FingerEnergy(body, HAND, pose, ours.finger, contact)
    push = np.abs(energy.unheld(theirs.q_rad, commands[ours.finger, theirs.step])).max()
    if push < 1e-3:  # theirs is a rest of our energy too
        if contact.friction:
            return "two rests at one command: friction holds both"
        return "two rests at one command: the finger jumps an edge"
    return "another contact force in MuJoCo (several contacts on a link)"


def _margin(ours: _Ours, commands: np.ndarray, threshold: float) -> float:
    step = ours.step
    delta = commands[ours.finger, step] - commands[ours.finger, max(step - 1, 0)]
    reading = np.abs(tension_differences(HAND, ours.torque_Nm[None], delta[None])).max()
    return float(reading / threshold - 1.0)


def _add(total: _Tally, part: _Tally) -> None:
    """Add a body's tally to the one over all bodies."""
    for name in ("pairs", "stops_ours", "stops_theirs", "apart", "other_link"):
        setattr(total, name, getattr(total, name) + getattr(part, name))
    for name in ("tip_m", "torque", "torque_Nm", "point_m", "normal_rad", "force_N", "overlap_m",
                 "unpressed_m"):
        getattr(total, name).extend(getattr(part, name))
    total.causes.update(part.causes)
    total.links.update(part.links)


def _rows(what: str, t: _Tally, bounds: Bounds | None = None) -> list[Comparison]:
    bounds = bounds or Bounds()

    def p95(values: Sequence[float]) -> float:
        return float(np.quantile(values, 0.95)) if len(values) else nan

    def row(quantity: str, unit: str, ours: float, theirs: float, difference: float,
            bound: float = nan, note: str = "") -> Comparison:
        return Comparison("closing", f"{what}: {quantity}", unit, ours, theirs, difference,
                          bound, note)

    causes = "; ".join(f"{count} x {cause}" for cause, count in sorted(t.causes.items()))
    torque = np.mean(t.torque_Nm, 0) if t.torque_Nm else [nan, nan]
    force = np.asarray(t.force_N).reshape(-1, 2)
    mean = force.mean(0) if len(force) else [nan, nan]
    share = (f"links proximal {t.links[0]}, middle {t.links[1]}, distal {t.links[2]}; "
             f"{t.other_link} on different links")
    return [
        row(f"stops more than a step apart, of {t.pairs}", "share", t.stops_ours, t.stops_theirs,
            t.apart / max(t.pairs, 1), bounds.apart, causes or "all agree"),
        row("tip at the stop, p95", "mm", nan, nan, 1e3 * p95(t.tip_m), 1e3 * bounds.tip_m,
            f"largest {1e3 * max(t.tip_m, default=nan):.3g} mm"),
        row("torque of the largest, p95 (means left)", "N m", torque[0], torque[1],
            p95(t.torque), bounds.torque, f"relative; largest {max(t.torque, default=nan):.3g}"),
        row("contact point, p95", "mm", nan, nan, 1e3 * p95(t.point_m), nan, share),
        row("contact normal, p95", "deg", nan, nan, float(np.degrees(p95(t.normal_rad)))),
        row("force on a distal link, touch sensor (means left)", "N", mean[0], mean[1],
            p95(list(np.abs(force[:, 0] - force[:, 1]) / force[:, 1])), bounds.torque,
            "relative, p95"),
        row(f"hands at rest whose links overlap by more than {1e3 * OVERLAP_M:g} mm, of "
            f"{len(t.overlap_m)}", "share", nan, nan, float(np.mean(
                np.array(t.overlap_m) > OVERLAP_M)) if t.overlap_m else nan, bounds.overlap,
            f"largest {1e3 * max(t.overlap_m, default=nan):.3g} mm"),
        row(f"and by {1e3 * UNPRESSED_M:g} mm more or less than two skins give under their force",
            "share", nan, nan, float(np.sum(np.array(t.unpressed_m) > UNPRESSED_M)) / max(
                len(t.overlap_m), 1), bounds.overlap,
            f"largest {1e3 * max(t.unpressed_m, default=0.0):.3g} mm"),
    ]
