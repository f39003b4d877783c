"""The paper's second experiment: two adjacent faces of a block, and the angle between them.

The paper printed 96 degrees where 90 is true. An episode grasps the block, recovers a body from
the contacts, and crosses the two sides of that body that face the arm most: where they are to be
looked for is as wrong as the body is. Each case increases one source of error.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import radians
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from strategies.procedures.options import PlanarTable
from strategies.procedures.planar_faces import angle_between, planes_of
from strategies.procedures.planar_record import PlanarExploration
from strategies.procedures.touches import EndReason
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import run_block
from sweeps.paper.recovery import AS_PAPER, SEED
from sweeps.spec.cell import Cell
from warpgrasp.parameters import ArmTable, ErrorTable, FitTable, PadTable, SensorTable

PRINTED_DEG = 96.0
TYPICAL_DEG = 6.0
"""A case makes this error typical when its median error is as large."""
SIDES = slice(1, 3)
"""Of the faces crossed: the top is the first."""
_FACES = 3


@dataclass(frozen=True)
class Case:
    """One source of error at one size; all else has its default."""

    source: str
    size: str
    number: float
    arm: ArmTable = field(default_factory=ArmTable)
    sensors: SensorTable = field(default_factory=SensorTable)
    pads: PadTable = field(default_factory=PadTable)
    errors: ErrorTable = field(default_factory=ErrorTable)
    fit: FitTable = field(default_factory=FitTable)
    planar: PlanarTable = field(default_factory=lambda: PlanarTable(faces=_FACES))
    mount_slip_rad: float = 0.0
    """Standard deviation of the hand's rotation in its mount between the two faces."""


def cases() -> list[Case]:
    """The default, and each source of error at its sizes."""
    degrees, found = (1.0, 3.0, 10.0), [Case("default", "", 0.0)]

    def add(source: str, unit: str, sizes: tuple[float, ...],
            changes: Callable[[float], dict[str, Any]]) -> None:
        found.extend(Case(source, f"{size:g}{unit}", size, **changes(size)) for size in sizes)

    add("mount turned, same for both faces", " deg", degrees,
        lambda deg: {"errors": ErrorTable(mount_rad=radians(deg))})
    add("joint sensors' noise", " deg", degrees,
        lambda deg: {"sensors": SensorTable(joint_noise_rad=radians(deg))})
    add("arm's repeatability", " mm", (0.5, 1.0, 2.0),
        lambda mm: {"arm": ArmTable(repeatability_m=mm * 1e-3)})
    add("pads' noise", " counts", (2.0, 4.0),
        lambda counts: {"pads": PadTable(noise_counts=counts, threshold_counts=6.0 * counts)})
    add("guarded step", " mm", (3.0, 6.0),
        lambda mm: {"planar": PlanarTable(faces=_FACES, interval_m=mm * 1e-3)})
    found += [Case("steps each way from the first touch", f"{steps}", -steps,
                   planar=PlanarTable(faces=_FACES, most_steps=steps)) for steps in (5, 2, 1)]
    add("mount slips between the faces", " deg", degrees,
        lambda deg: {"mount_slip_rad": radians(deg)})
    found.append(Case("body recovered as in the first rows", "", 1.0, fit=AS_PAPER,
                      sensors=SensorTable(contact_estimator="fingertip")))
    return found


@dataclass(frozen=True)
class Explored:
    """One case: the angles of the worlds in which both sides were crossed."""

    case: Case
    angle_deg: np.ndarray
    touches: np.ndarray
    """Of both sides, (world,)."""
    worlds: int
    start_deg: np.ndarray
    """How far the sides' normals, as the recovered body has them, are from the block's nearest
    ones: the larger of both, (every world,)."""
    faces: tuple[PlanarExploration, ...]
    body_pose: np.ndarray
    """(every world, 7)."""


def explore_faces(worlds: int, chosen: list[Case] | None = None) -> list[Explored]:
    """Every case, with the same poses of the block and the same random numbers."""
    return [_explore(case, worlds) for case in (cases() if chosen is None else chosen)]


def _explore(case: Case, worlds: int) -> Explored:
    cell = Cell(STRATEGIES["planar"], {"name": "block"}, "block", seed=SEED, arm=case.arm,
                sensors=case.sensors, pads=case.pads, errors=case.errors, fit=case.fit,
                planar=case.planar)
    block = run_block(cell, np.arange(worlds), "cpu")
    faces = tuple(p.felt for p in block.exploration.procedures
                  if isinstance(p.felt, PlanarExploration))[SIDES]
    planes = [planes_of(face) for face in faces]
    turns = np.random.default_rng(96).normal(size=(worlds, 3)) * case.mount_slip_rad
    slip = Rotation.from_rotvec(turns)
    angle = angle_between(planes[0], replace(planes[1], normal=slip.apply(planes[1].normal)))[0]
    felt = [f.touches.sets(worlds)[1].sum(1) for f in faces]
    done = np.all([f.reason == EndReason.COMPLETE for f in faces], axis=0) & (
        np.min(felt, axis=0) >= 3)
    pose = block.truth.body_pose
    return Explored(case, np.degrees(angle[done]), np.sum(felt, axis=0)[done], worlds,
                    np.max([_off_the_block(f, pose) for f in faces], axis=0), faces, pose)


def _off_the_block(face: PlanarExploration, pose: np.ndarray) -> np.ndarray:
    """Angle between the normal given and the nearest of the block's six [deg], (world,)."""
    own = Rotation.from_quat(pose[:, 3:]).inv().apply(face.axes[:, 2])
    return np.degrees(np.arccos(np.clip(np.abs(own).max(1), 0.0, 1.0)))


FACES_HEADER = ("source", "size", "blocks", "both_sides", "start_off_deg_median",
                "touches_median", "angle_deg_median", "angle_deg_p5", "angle_deg_p95",
                "error_deg_median", "share_off_6_or_more")


def face_rows(found: list[Explored]) -> list[tuple[str, ...]]:
    """The table, a row for each case; `both_sides` counts the blocks of which both were crossed."""
    rows = []
    for e in found:
        begun = (e.case.source, e.case.size, str(e.worlds), str(len(e.angle_deg)),
                 f"{np.median(e.start_deg):.1f}")
        if len(e.angle_deg) == 0:
            rows.append((*begun, *["NA"] * 6))
            continue
        off = errors_of(e)
        low, high = np.quantile(e.angle_deg, [0.05, 0.95])
        rows.append((*begun, f"{np.median(e.touches):.0f}", f"{np.median(e.angle_deg):.2f}",
                     f"{low:.2f}", f"{high:.2f}", f"{np.median(off):.2f}",
                     f"{(off >= TYPICAL_DEG).mean():.3f}"))
    return rows


def errors_of(e: Explored) -> np.ndarray:
    """Errors of the angle [deg], of the worlds in which both sides were crossed."""
    return np.abs(e.angle_deg - 90.0)


def typical_sizes(found: list[Explored]) -> list[tuple[str, str, str]]:
    """For each source, the size at which the median error is 6 degrees, interpolated, and from how
    many blocks it follows; blocks whose sides were not both crossed tell nothing."""
    answers = []
    for source in dict.fromkeys(e.case.source for e in found if e.case.source != "default"):
        mine = [e for e in found if e.case.source == source and len(e.angle_deg)]
        if not mine:
            answers.append((source, "both sides were never crossed", "0"))
            continue
        errors = np.array([np.median(errors_of(e)) for e in mine])
        worst = int(errors.argmax())
        reached = errors >= TYPICAL_DEG
        k = int(np.argmax(reached))
        size = mine[k].case.size
        if not reached.any():
            k = worst
            answer = f"not reached: {errors.max():.1f} deg" + (
                f" at {mine[k].case.size}" if mine[k].case.size else "")
        elif mine[k].case.number < 0 or not size:
            answer = f"{size}, {np.median(mine[k].touches):.0f} touches on both sides together"
        elif k == 0:
            answer = f"{size} or less"
        else:
            sizes = [e.case.number for e in mine]
            share = np.log(TYPICAL_DEG / errors[k - 1]) / np.log(errors[k] / errors[k - 1])
            answer = (f"about {sizes[k - 1] * (sizes[k] / sizes[k - 1]) ** share:.1f} "
                      f"{size.partition(' ')[2]}")
        answers.append((source, answer, f"{len(mine[k].angle_deg)} of {mine[k].worlds}"))
    return answers
