"""A hand as data: fingers as serial chains of revolute joints, shapes, postures, closing paths.

A joint's frame is where its link's frame is: `place` at angle zero in the frame of the link before
it (of the palm for the first joint), then the turn about `axis`. Quaternions are xyzw.
"""

from collections.abc import Iterable
from dataclasses import dataclass

Place = tuple[float, float, float, float, float, float, float]
"""Position [m] and quaternion xyzw."""
Vector = tuple[float, float, float]
STILL: Place = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
UNITS_OF_FILES = "a URDF has metres and radians, a TOML file mm and degrees"
"""Said where a number is out of all proportion, which is mostly one in another unit."""


def vector_of(values: Iterable[float]) -> Vector:
    """Three numbers as a record of a hand holds them."""
    x, y, z = (float(v) for v in values)
    return x, y, z


class HandError(ValueError):
    """A hand that cannot be used: the file, the element, and what would be right."""


@dataclass(frozen=True)
class Capsule:
    """A capsule in its link's frame [m]; a ball where `start` is `end`."""

    start: Vector
    end: Vector
    radius: float
    fit_error_m: float = 0.0
    """The largest distance of the mesh that it stands for from its surface; 0: not fitted."""


@dataclass(frozen=True)
class Box:
    """A box in its link's frame: its middle's place, and its sides [m]."""

    place: Place
    size: Vector
    fit_error_m: float = 0.0
    """As a capsule's."""


Shape = Capsule | Box


@dataclass(frozen=True)
class Follow:
    """A joint that another one moves: its angle is `factor` times the other's plus `offset_rad`."""

    joint: str
    factor: float
    offset_rad: float


@dataclass(frozen=True)
class HandJoint:
    """A revolute joint and the link that it moves."""

    name: str
    place: Place
    axis: Vector
    """Unit vector in the joint's frame."""
    low_rad: float
    high_rad: float
    effort_Nm: float
    """0 where it is not known."""
    stiffness_Nm_rad: float
    """Of its servo."""
    follows: Follow | None
    shapes: tuple[Shape, ...]
    """Of its link, in the joint's frame."""


@dataclass(frozen=True)
class PadPlace:
    """Where a tactile pad lies on a link, in the link's frame [m]: bent about an axis from `start`
    to `end`, `radius` off it, on the side `out`; on a finger's last link also over the end."""

    joint: str
    start: Vector
    end: Vector
    radius: float
    """Of what lies under the pad."""
    out: Vector
    """Unit vector across the axis."""


@dataclass(frozen=True)
class PadSize:
    """Of all of a hand's pads [m]."""

    width_m: float
    length_m: float
    wrap_rad: float
    """How far a pad at the end of a finger bends over it."""
    thickness_m: float


@dataclass(frozen=True)
class Finger:
    """A serial chain of joints that ends in a tip."""

    name: str
    joints: tuple[HandJoint, ...]
    tip_m: Vector
    """In the frame of the last joint."""
    pads: tuple[str, ...]
    """The joints whose links bear a tactile pad."""
    pad_places: tuple[PadPlace, ...] = ()
    """Where those lie that do not lie on their links' capsules."""


@dataclass(frozen=True)
class Posture:
    """Angles of joints by name [rad]; a joint that is not named stands as near to zero as its
    limits let it."""

    name: str
    angles_rad: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class HandClosing:
    """From one posture to another by the joints that move; the others keep the first posture."""

    name: str
    start: str
    end: str
    moves: tuple[str, ...]


@dataclass(frozen=True)
class Extended:
    """How a hand touches with one finger."""

    finger: str
    posture: str
    """In which that finger is extended and the others are out of the way."""
    lean_rad: float | None = None
    """From the side that its pad lies on to the direction that it touches in, so that nothing else
    of the hand leads; None: computed."""


@dataclass(frozen=True)
class Opposed:
    """Two fingers whose tips close towards each other, and how."""

    fingers: tuple[str, str]
    start: str
    """The posture in which both are open and the others out of the way."""
    end: str
    """The posture in which each has closed, the other one kept open."""


@dataclass(frozen=True)
class HandModel:
    """A whole hand; the palm's frame is its root."""

    name: str
    source: str
    licence: str
    grasp_frame: Place
    """In the palm's frame: z is the approach, x points from the fingers to the thumb, the origin
    is the middle of the palm."""
    palm: tuple[Shape, ...]
    fingers: tuple[Finger, ...]
    thumb: str
    """A finger's name; empty for a hand without a thumb."""
    senses: str
    """One of SENSES."""
    postures: tuple[Posture, ...]
    closings: tuple[HandClosing, ...]
    pad_size: PadSize | None = None
    """None: as `[pads]` of a spec has it."""
    extended: Extended | None = None
    """None: computed, as `opposed` is."""
    opposed: Opposed | None = None

    @property
    def joints(self) -> tuple[HandJoint, ...]:
        """All joints, finger by finger."""
        return tuple(joint for finger in self.fingers for joint in finger.joints)

    @property
    def driven(self) -> tuple[HandJoint, ...]:
        """The joints that follow no other: what a configuration gives the angles of, in order."""
        return tuple(joint for joint in self.joints if joint.follows is None)

    def posture(self, name: str) -> Posture:
        """The posture of a name. Raises KeyError where there is none."""
        return {posture.name: posture for posture in self.postures}[name]


SENSES = ("tendons", "joint_torques", "tip_switches", "nothing")
"""What a hand's fingers feel beside their joint angles."""
CURLS_DEG, BASE_FIRST = (25, 40, 55), "base_then_curl"
"""Every hand closes along its first path in other ways too: `curl25` and so on turn the outer
joints by so many degrees first, `base_then_curl` closes the base first."""
CLOSING_WORDS = (*(f"curl{v}" for v in CURLS_DEG), BASE_FIRST)
"""The names of these ways, which no path of a hand's own may have."""
