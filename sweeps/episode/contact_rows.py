"""Contacts of a block of episodes as flat columns, a row for each guarded move that had a sensor.

x, y, z are the contact as the robot estimates it; for a contact that the body used, the place that
this body gave it: the one that stands, a free form or parts where these stand for a model. `link`
is the link that the robot concludes from the stop alone, `true_link` the one that touched: the
body may place a contact on another link of the finger. `accepted` is 1 for a
contact that counts as one of that body's and 0 for another one; `verdict` says why
(`contact_verdict`). `var_` and `cov_` are the point's covariance. No strategy
or fit reads the true columns. For touches of pads `grasp` is the direction on a face or the section
of a contour. What a move does not have is NaN.

A world's rows do not depend on the worlds beside it: probes that it did not make have no rows.
"""

import csv
import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from strategies.exploration_record import Exploration, Procedure
from strategies.procedures.contour_record import ContourExploration
from strategies.procedures.planar_record import PlanarExploration
from strategies.procedures.touches import TABLE_MARGIN_M, true_touches
from strategies.recovery.contact_verdict import (
    ACCEPTED,
    FAR,
    TABLE,
)
from strategies.recovery.evidence import Evidence, slots_of_touches
from strategies.recovery.misfit import FARTHEST_M
from warpgrasp.closing.closing import ClosingTruth
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps, Truth

INTEGERS = ("probe", "grasp", "finger", "link", "true_link")
NUMBERS = ("accepted", "tension_difference_N", "taxel_peak")
VECTORS = {
    "point": ("x_m", "y_m", "z_m"),
    "covariance": ("var_x_m2", "var_y_m2", "var_z_m2", "cov_xy_m2", "cov_xz_m2", "cov_yz_m2"),
    "true_point": ("true_x_m", "true_y_m", "true_z_m"),
    "true_normal": ("true_nx", "true_ny", "true_nz"),
    "joints": ("q0_rad", "q1_rad", "q2_rad", "q3_rad"),
    "hand": ("hand_x_m", "hand_y_m", "hand_z_m", "hand_qx", "hand_qy", "hand_qz", "hand_qw"),
}
"""Arrays of a row, and the columns that hold their numbers."""
MORE_JOINTS = ("q4_rad", "q5_rad")
"""Columns of hands with more joints to a finger."""
COLUMNS = ("procedure", *INTEGERS, "status", "accepted", "verdict",
           *VECTORS["point"], *VECTORS["covariance"], *VECTORS["true_point"],
           *VECTORS["true_normal"], *VECTORS["joints"],
           "tension_difference_N", "taxel_peak", *VECTORS["hand"])
TEXTS = ("procedure", "status", "verdict")
STATUS_NAMES = np.array([status.name.lower() for status in ProbeStatus], object)
Parts = dict[str, np.ndarray]


def contact_columns(found: Exploration, truth: Truth) -> dict[str, np.ndarray]:
    """`world`, then `COLUMNS`, (row,) each: world by world, in the order the moves were made."""
    parts = [_columns(part) for part in _procedures(found, truth)]
    if not parts:
        return {name: np.zeros(0, object if name in TEXTS else
                               int if name in ("world", *INTEGERS) else float)
                for name in ("world", *COLUMNS)}
    more = [name for name in MORE_JOINTS if name in parts[0]]
    columns = {name: np.concatenate([part[name] for part in parts])
               for name in ("world", *COLUMNS, *more)}
    order = np.argsort(columns["world"], kind="stable")
    columns = {name: values[order] for name, values in columns.items()}
    return columns | _judged(columns, found)


def contact_tables(found: Exploration, truth: Truth) -> np.ndarray:
    """The columns of each world, an object array (world,) of dictionaries as rows keep them.

    Numbers have 32 bits: 0.03 um at arm's length.
    """
    columns = contact_columns(found, truth)
    ends = np.cumsum(np.bincount(columns.pop("world"), minlength=len(found.status)))
    small = {name: values if values.dtype == object else
             values.astype(np.int32 if values.dtype.kind == "i" else np.float32)
             for name, values in columns.items()}
    tables = np.empty(len(ends), object)
    for world, (start, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        tables[world] = {name: values[start:end] for name, values in small.items()}
    return tables


def contacts_csv(found: Exploration, truth: Truth, world: int = 0) -> str:
    """The rows of one world as `contact_columns` has them; text of a CSV file."""
    columns = contact_columns(found, truth)
    names = [name for name in columns if name != "world"]
    mine = columns["world"] == world
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(_cells(name, columns[name][mine]) for name in names), strict=True))
    return text.getvalue()


def _cells(name: str, values: np.ndarray) -> list[Any]:
    if values.dtype != float:
        return values.tolist()
    digits = 0 if name in ("accepted", "taxel_peak") else 6
    if name in VECTORS["covariance"]:
        digits = 12
    return ["" if not np.isfinite(v) else f"{v:.{digits}f}" for v in values.tolist()]


def _procedures(found: Exploration, truth: Truth) -> Iterator[Parts]:
    slot, probes = 0, np.zeros(len(found.status), int)
    for procedure in found.procedures:
        if isinstance(procedure.felt, Grasps):
            yield _grasps(procedure, procedure.felt, truth.closings[procedure.closing],
                          found.placed, found.verdicts, slot, probes)
        else:
            yield _touches(procedure, procedure.felt, truth, found.placed, slot, probes)
        slot += procedure.slots


def _grasps(procedure: Procedure, grasps: Grasps, truth: ClosingTruth, evidence: Evidence,
            verdicts: np.ndarray, slot: int, probes: np.ndarray) -> Parts:
    """Rows of a batch of grasps, whose contacts begin at `slot` of the evidence; the number of
    each world's probes so far, (world,), is counted on."""
    closing = grasps.closing
    tried = grasps.moves.status[:, :, 0] != ProbeStatus.NOT_TRIED
    shape = closing.status.shape
    closed = closing.status != ProbeStatus.NOT_TRIED  # fingers that stay open have no row
    at = np.nonzero(tried[:, :, None, None] & closed)
    world, probe, grasp, finger = at
    own = slot + np.ravel_multi_index((probe, grasp, finger), shape[1:])
    used = evidence.mask[world, own][:, None]
    number = probes[:, None] + np.cumsum(tried, axis=1) - 1
    probes += tried.sum(axis=1)
    return {
        "world": world, "procedure": np.full(len(world), procedure.name, object),
        "probe": number[world, probe], "grasp": grasp, "finger": finger,
        "link": grasps.estimate.link[at], "true_link": truth.link[at],
        "status": STATUS_NAMES[closing.status[at]],
        "verdict": verdicts[world, own],
        "point": np.where(used, evidence.points_m[world, own], grasps.estimate.point_m[at]),
        "covariance": _distinct(np.where(used[..., None], evidence.covariance_m2[world, own],
                                         grasps.estimate.covariance_m2[at])),
        "true_point": truth.point_m[at], "true_normal": truth.normal[at],
        "joints": closing.q_rad[at], "tension_difference_N": closing.tension_difference_N[at],
        "hand": grasps.moves.believed_pose[world, probe],
    }


def _touches(procedure: Procedure, felt: PlanarExploration | ContourExploration, truth: Truth,
             evidence: Evidence, slot: int, probes: np.ndarray) -> Parts:
    """Rows of touches of pads, of which some are kept from `slot` of the evidence on. Others stay
    where they were felt, whatever body stands."""
    table = felt.touches
    point, normal = true_touches(table, truth)
    kept, (worlds, slots) = slots_of_touches(table, len(probes), procedure.slots)
    placed = table.point_m.copy()
    placed[kept] = evidence.points_m[worlds, slot + slots]
    order = np.argsort(table.world, kind="stable")
    world = table.world[order]
    made = np.bincount(world, minlength=len(probes))
    number = probes[world] + np.arange(len(world)) - (np.cumsum(made) - made)[world]
    probes += made
    return {
        "world": world, "procedure": np.full(len(world), procedure.name, object),
        "probe": number, "grasp": table.part[order], "finger": table.finger[order],
        "link": table.link[order], "true_link": table.link[order],
        "status": STATUS_NAMES[table.status[order]], "point": placed[order],
        "verdict": np.full(len(order), "", object),
        "covariance": np.full((len(order), 6), np.nan),
        "true_point": point[order], "true_normal": normal[order], "joints": table.q_rad[order],
        "taxel_peak": table.taxel_peak[order], "hand": table.hand_pose[order],
    }


def _distinct(covariance: np.ndarray) -> np.ndarray:
    """The six different numbers of symmetric matrices (row, 3, 3)."""
    return covariance[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]


def _judged(columns: dict[str, np.ndarray], found: Exploration) -> dict[str, np.ndarray]:
    """`verdict` of each row, where it has none by its nearness, and `accepted`: 1 or 0 for each
    contact, NaN for rows without one."""
    point = np.stack([columns[name] for name in VECTORS["point"]], axis=1)
    felt = np.asarray(np.isfinite(point).all(axis=-1))
    world = columns["world"]
    number = np.arange(len(world)) - np.searchsorted(world, world)
    padded = np.zeros((len(found.status), 1 + number.max(initial=0), 3))
    mask = np.zeros(padded.shape[:2], bool)
    padded[world, number], mask[world, number] = np.where(felt[:, None], point, 0.0), felt
    near = found.gaps(padded, mask)[world, number] <= FARTHEST_M
    verdict = columns["verdict"].copy()
    verdict[(verdict == "") & felt] = np.where(near, ACCEPTED, FAR)[(verdict == "") & felt]
    verdict[felt & (columns["z_m"] <= TABLE_MARGIN_M)] = TABLE
    verdict[~felt] = ""
    return {"verdict": verdict,
            "accepted": np.where(felt, (verdict == ACCEPTED).astype(float), np.nan)}


def _columns(parts: Parts) -> dict[str, np.ndarray]:
    """One array a column: whole numbers, text, and float64 that are NaN where infinite."""
    flat = {"world": parts["world"].astype(int)}
    flat |= {name: parts[name].astype(int) for name in INTEGERS}
    flat |= {name: parts[name] for name in TEXTS}
    unknown = np.full(len(flat["world"]), np.nan)
    numbers = {name: parts.get(name, unknown) for name in NUMBERS}
    for vector, names in VECTORS.items():
        values = parts[vector]
        if vector == "joints":
            names = (*names, *MORE_JOINTS)[:max(values.shape[1], len(names))]
            missing = [(0, 0), (0, len(names) - values.shape[1])]
            values = np.pad(values, missing, constant_values=np.nan)
        numbers |= dict(zip(names, values.T, strict=True))
    return flat | {name: np.where(np.isfinite(values), values, np.nan).astype(float)
                   for name, values in numbers.items()}
