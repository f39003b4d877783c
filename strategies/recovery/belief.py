"""What a strategy is handed: what has been felt and fitted so far. Plain arrays, no truth."""

from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fit.superquadric.geometry import Superquadric
from fit.superquadric.record import SuperquadricFit
from fit.superquadric.uncertainty import SuperquadricUncertainty, superquadric_uncertainty
from strategies.contacts.touched_links import TouchedLinks
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.contour_shape import Profile
from strategies.procedures.planar_faces import Face
from strategies.recovery.evidence import Evidence
from warpgrasp.parameters import ArmTable, ErrorTable, FitTable, HandTable, SensorTable

_PACK = 64


@dataclass(frozen=True)
class Belief:
    """A batch of beliefs, axis 0 the world. Lengths in m, angles in rad, base frame."""

    step: int
    """Number of earlier steps of the strategy."""
    active: np.ndarray
    """Worlds that may go on, bool (world,); probes of the others are not made."""
    prior: BoundingCylinder
    """Rough place and size of the object, with errors."""
    seed: np.ndarray
    """For a strategy's own random numbers (`warpgrasp.core.random`), uint64 (world,)."""
    arm: ArmTable
    hand: HandTable
    sensors: SensorTable
    """The hand's threshold and noise as the robot knows them."""
    closings: tuple[str, ...]
    """Paths that the fingers close along in grasps that name none."""
    evidence: Evidence
    """All that was felt, contacts placed as for the last fit; its slots grow step by step."""
    fits: SuperquadricFit
    """The superquadrics last fitted; see `fitted`."""
    fitted: np.ndarray
    """Whether the fit is to be believed, bool (world,)."""
    body: Superquadric
    """The fit where it is plausible, else the prior cylinder."""
    faces: tuple[Face, ...]
    """Faces crossed so far; `Face.fit.status` says in which worlds."""
    profile: Profile | None
    """Recovered contours; NaN where none was followed."""
    shape: np.ndarray
    """Which model stands for the body, `strategies.recovery.choose_model.Shape`, (world,)."""
    touches: np.ndarray
    """Guarded closings and pad touches made, (world,)."""
    time_s: np.ndarray
    """Robot time spent, (world,)."""
    path_m: np.ndarray
    """Path of the hand, (world,)."""
    links: TouchedLinks
    """How the robot stood at each contact of the evidence, and what its joints felt."""
    errors: ErrorTable
    """How far the robot may be from its tables: deviations, not what was drawn."""

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.seed)

    @property
    def told(self) -> BoundingCylinder:
        """The name of `prior` in version 0.1."""
        return self.prior

    @cached_property
    def uncertainty(self) -> SuperquadricUncertainty:
        """Covariance of the body's parameters, computed on first use."""
        return believed_uncertainty(self.body, self.evidence)


def read_only(record: Any) -> Any:
    """The same record with views of its arrays, and of those within, that cannot be written to."""
    if isinstance(record, np.ndarray):
        view = record.view()
        view.flags.writeable = False
        return view
    if isinstance(record, tuple):
        parts = map(read_only, record)
        return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)
    if is_dataclass(record) and not isinstance(record, type):
        return replace(record, **{f.name: read_only(getattr(record, f.name))
                                  for f in fields(record) if f.init})
    return record


def believed_uncertainty(body: Superquadric, evidence: Evidence) -> SuperquadricUncertainty:
    """Uncertainty of each world's body from its own contacts alone.

    Contacts are packed to a number of slots that depends on the world's own count: sums over more
    empty slots, for a neighbour's sake, would round otherwise.
    """
    worlds = len(evidence.mask)
    slots = -(-np.maximum(evidence.mask.sum(1), 1) // _PACK) * _PACK
    found: dict[str, np.ndarray] = {}
    for width in np.unique(slots):
        rows = np.flatnonzero(slots == width)
        order = np.argsort(~evidence.mask[rows], axis=1, kind="stable")[:, :width]
        pad = max(0, width - order.shape[1])

        def packed(values: np.ndarray, rows=rows, order=order, pad=pad) -> np.ndarray:
            index = order.reshape(*order.shape, *([1] * (values.ndim - 2)))
            taken = np.take_along_axis(values[rows], index, 1)
            return np.pad(taken, [(0, 0), (0, pad)] + [(0, 0)] * (values.ndim - 2))

        part = superquadric_uncertainty(
            Superquadric(*(field[rows] for field in body)), packed(evidence.points_m),
            packed(evidence.mask), covariance=packed(evidence.covariance_m2), table_z=0.0)
        for f in fields(SuperquadricUncertainty):
            values = getattr(part, f.name)
            whole = found.setdefault(f.name, np.zeros((worlds, *values.shape[1:]), values.dtype))
            whole[rows] = values
    return SuperquadricUncertainty(**found)


COMMON_SIGMA_M = 0.0006
"""Standard deviation of an error along the normal that all contacts of an episode share [est]: in
simulated grasps of blocks and cylinders contacts as placed lie 0.3 to 0.5 mm (one standard
deviation over episodes) about a mean that is itself outside the body."""


def recovered_uncertainty(
    fits: SuperquadricFit, evidence: Evidence, table: FitTable
) -> SuperquadricUncertainty:
    """Uncertainty of the fits of `recovery.recover_bodies` to the evidence it gave back."""
    return superquadric_uncertainty(
        fits, evidence.points_m, evidence.mask,
        covariance=evidence.covariance_m2 if table.weights else None,
        table_z=0.0 if table.table_plane else None, common_sigma_m=COMMON_SIGMA_M)
