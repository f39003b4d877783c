"""What a strategy is handed: what has been felt and fitted so far. Plain arrays, no truth."""

from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fit.arrays import read_only_view, rows_of
from fit.superquadric.geometry import Superquadric
from fit.superquadric.record import SuperquadricFit
from fit.superquadric.uncertainty import SuperquadricUncertainty
from strategies.contacts.body_uncertainty import (
    BodyUncertainty,
    calibrated_uncertainty,
    parameter_uncertainty,
)
from strategies.contacts.felt import Felt
from strategies.contacts.finger_touch import TouchedLinks
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.contour_shape import Profile
from strategies.procedures.planar_faces import Face
from strategies.recovery.choose_model import Shape, revolution_of
from strategies.recovery.evidence import Evidence
from warpgrasp.parameters import ArmTable, ErrorTable, FitTable, HandTable, SensorTable

_SHARED = ("step", "arm", "hand", "sensors", "closings", "errors", "fit")
"""Fields that all worlds share."""


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
    """The fit where it is plausible, else the prior."""
    faces: tuple[Face, ...]
    """Faces crossed so far; `Face.fit.status` says in which worlds."""
    profile: Profile | None
    """Recovered contours; NaN where none was followed."""
    shape: np.ndarray
    """Which model stands for the body, `strategies.recovery.choose_model.Shape`, (world,)."""
    touches: np.ndarray
    """Guarded motions of a finger that were made, felt or not, (world,); see `motion_cost`."""
    time_s: np.ndarray
    """Robot time spent, (world,)."""
    path_m: np.ndarray
    """Path of the hand, (world,)."""
    links: TouchedLinks
    """How the robot stood at each contact of the evidence, and what its joints felt."""
    errors: ErrorTable
    """How far the robot may be from its tables: deviations, not what was drawn."""
    fit: FitTable = field(default_factory=FitTable)
    """What the body at the end is fitted to, and what may stand for it."""
    unplaced: Evidence | None = None
    """What was felt by the last fit, contacts where they were felt: not placed on any body."""
    touches_left: np.ndarray | None = None
    """How many more touches the budget allows, (world,); None where it does not limit them."""

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.seed)

    @cached_property
    def parameter_uncertainty(self) -> SuperquadricUncertainty:
        """Of the superquadric's parameters, to first order. Computed on first use."""
        return read_only(parameter_uncertainty(
            self.body, self.felt, self.links, self.errors, self.arm,
            table_plane=self.fit.table_plane))

    @cached_property
    def uncertainty(self) -> BodyUncertainty:
        """Of the model that stands for the body: calibrated intervals of its volume, covariance of
        the superquadric's parameters. Computed on first use."""
        return read_only(calibrated_uncertainty(
            self.body, self.parameter_uncertainty,
            None if self.profile is None else revolution_of(self.profile),
            self.shape == Shape.REVOLUTION, self.felt, self.links, self.errors, self.arm,
            self.prior))

    def with_active(self, active: np.ndarray) -> "Belief":
        """The same belief, other worlds going on; its uncertainty, if computed, stays."""
        other = replace(self, active=active)
        for name in ("parameter_uncertainty", "uncertainty"):
            if name in self.__dict__:
                other.__dict__[name] = getattr(self, name)
        return other

    def of(self, rows: np.ndarray) -> "Belief":
        """The belief of some of the worlds, in the order of their numbers `rows`."""
        return replace(self, **{f.name: rows_of(getattr(self, f.name), rows)
                                for f in fields(self) if f.name not in _SHARED})

    @property
    def felt(self) -> Felt:
        """The contacts of the evidence as uncertainty takes them."""
        return self.evidence.felt


def read_only(record: Any) -> Any:
    """The same record with views of its arrays, and of those within, that cannot be written to."""
    if isinstance(record, np.ndarray):
        return read_only_view(record)
    if isinstance(record, tuple):
        parts = map(read_only, record)
        return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)
    if is_dataclass(record) and not isinstance(record, type):
        # Not `replace`: what was reckoned of a spec's values may lie beyond their bounds.
        copied = object.__new__(type(record))
        for f in fields(record):
            object.__setattr__(copied, f.name, read_only(getattr(record, f.name)))
        return copied
    return record
