"""An arm as data: revolute joints in a row, from the base to the flange."""

from dataclasses import dataclass

ARM_JOINTS = 7
"""Joints of an arm at most."""
Vector = tuple[float, float, float]


class ArmError(ValueError):
    """An arm that cannot be used: the file, the element, and what would be right."""


@dataclass(frozen=True)
class ArmJoint:
    """A revolute joint. At angle zero its frame stands at `xyz_m`, turned by `rpy_rad`, in the
    frame of the joint before it (the base for the first); it turns about `axis`."""

    name: str
    xyz_m: Vector
    rpy_rad: Vector
    """About the fixed x, then y, then z axis, as in a URDF."""
    axis: Vector
    """Unit vector in the joint's frame."""
    low_rad: float
    high_rad: float
    speed_rad_s: float


@dataclass(frozen=True)
class ArmModel:
    """An arm whose flange's z axis points out of the arm, to the hand."""

    name: str
    joints: tuple[ArmJoint, ...]
    base_xyz_m: Vector
    """Where the arm's base stands on or above the table."""
    base_rpy_rad: Vector
    flange_xyz_m: Vector
    """In the last joint's frame."""
    flange_rpy_rad: Vector
    home_rad: tuple[float, ...]
    """Joints where an episode starts."""
    source: str = ""
