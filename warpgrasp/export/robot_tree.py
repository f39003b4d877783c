"""The robot as a tree of joints and links, from the tables the kernels use, for other simulators.

A link's frame is where its joint puts it: `place` at joint angle zero in the parent's frame, then
the turn about `axis`. Arm links follow standard Denavit-Hartenberg frames, fingers the frames of
`warpgrasp.mechanism.utah_mit_hand`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_model import ArmModel
from warpgrasp.hands.hand_model import STILL, Box, Capsule, Follow, Place
from warpgrasp.mechanism.arm import is_floating, serial_model
from warpgrasp.mechanism.puma560 import ALPHA_RAD
from warpgrasp.parameters import ArmTable, HandTable, PadTable

FINGERS = ("index", "middle", "ring", "thumb")
PHALANGES = ("proximal", "middle", "distal")
ARM_RADIUS_M = 0.05
"""Of the arm's capsules, for the eye: the simulator takes the arm's way to be free [est]."""
DENSITY_KG_M3 = 1000.0
"""Of all links [est], by default `HandTable.link_density_kg_m3`; other engines want all weighed."""
FLANGE_LINK = "flange"
"""`warpgrasp arm` takes it as the end of an exported arm."""
BALL_M = 2e-6
"""What is shorter from end to end is written as a ball: no reader takes such a capsule."""


@dataclass(frozen=True)
class Joint:
    """A hinge: axis in the link's frame, range [rad], servo stiffness [N m/rad], 0 for none."""

    name: str
    axis: tuple[float, float, float]
    low: float
    high: float
    stiffness: float
    effort: float = 0.0
    """[N m], 0 where it is not known."""
    follows: Follow | None = None
    speed: float = 0.0
    """[rad/s], 0 where it is not known."""


@dataclass(frozen=True)
class PadSite:
    """A box that holds a tactile pad, in its link's frame [m]."""

    name: str
    centre: tuple[float, float, float]
    size: tuple[float, float, float]


@dataclass(frozen=True)
class Link:
    """One link, after its parent in the list; `place` is position [m] and quaternion xyzw."""

    name: str
    parent: str
    place: tuple[float, ...]
    joint: Joint | None = None
    capsules: tuple[Capsule, ...] = ()
    boxes: tuple[Box, ...] = ()
    pads: tuple[PadSite, ...] = ()
    touches: bool = field(default=True)
    """Whether it meets object and table (the arm does not)."""


def hand_tree(
    hand: HandTable, pads: PadTable, *, parent: str = "", place: Sequence[float] = STILL
) -> list[Link]:
    """Palm and four fingers, 16 joints; `place` of the hand frame in `parent`."""
    thick = hand.palm_thickness_m / 2
    slab = tuple(Capsule((x * hand.palm_gap_m / 2, -hand.finger_spacing_m, -thick),
                         (x * hand.palm_gap_m / 2, hand.finger_spacing_m, -thick), thick)
                 for x in (-1, 0, 1))
    wrist = Capsule((0.0, 0.0, -max(hand.mount_length_m, thick)), (0.0, 0.0, -thick), thick)
    links = [Link("palm", parent, tuple(place), capsules=(*slab, wrist))]
    for number, finger in enumerate(FINGERS):
        x, y, turn = -hand.palm_gap_m / 2, hand.finger_spacing_m * (number - 1), (0.0, 1.0)
        if finger == "thumb":
            x, y, turn = hand.palm_gap_m / 2, 0.0, (1.0, 0.0)
        low, high = hand.abduction_limit_rad
        k = hand.joint_stiffness_Nm_rad
        links.append(Link(f"{finger}_base", "palm", (x, y, 0.0, 0.0, 0.0, *turn),
                          Joint(f"{finger}_abduction", (-1.0, 0.0, 0.0), low, high, k)))
        rise = hand.abduction_offset_m
        for j, phalanx in enumerate(PHALANGES):
            length = hand.link_length_m[j]
            bone = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, length), hand.link_radius_m)
            on = (pads.proximal, pads.middle, pads.distal)[j]
            links.append(Link(
                f"{finger}_{phalanx}", links[-1].name, (0.0, 0.0, rise, 0.0, 0.0, 0.0, 1.0),
                Joint(f"{finger}_flexion{j + 1}", (0.0, 1.0, 0.0), hand.flexion_low_rad[j],
                      hand.flexion_high_rad[j], k),
                (bone,), pads=(_pad_site(f"{finger}_{phalanx}_pad", hand, pads, j),) if on else ()))
            rise = length
    return links


def arm_hand_tree(arm: ArmTable, hand: HandTable, pads: PadTable) -> list[Link]:
    """The whole robot in its base frame, joints in the order of `arm_hand_links`."""
    links, place = arm_tree(arm, hand.mount_length_m)
    return [*links, flange_link(links[-1].name, place, hand.mount_length_m),
            *hand_tree(hand, pads, parent=links[-1].name, place=place)]


def flange_link(parent: str, place: Place, mount_length_m: float) -> Link:
    """A link without shapes where the arm ends, `place` being that of the hand's frame."""
    at = np.array(place[:3]) - Rotation.from_quat(place[3:]).apply([0.0, 0.0, mount_length_m])
    return Link(FLANGE_LINK, parent, _floats((*at, *place[3:])), touches=False)


def arm_tree(arm: ArmTable, mount_length_m: float) -> tuple[list[Link], Place]:
    """The arm in its base frame, and the place of the hand's frame in its last link. Raises
    ValueError for a floating wrist, and ArmError for an arm that cannot be used."""
    model = serial_model(arm)
    if model is not None:
        return _serial_tree(model, mount_length_m)
    if is_floating(arm):
        raise ValueError("a floating wrist has no links; should be an arm")
    links = [Link("base", "", STILL, capsules=(
        Capsule((0.0, 0.0, 0.0), (0.0, 0.0, arm.d_m[0]), ARM_RADIUS_M),), touches=False)]
    place: tuple[float, ...] = STILL
    for j in range(6):
        end, turn = _dh_end(arm, j)
        corner = (0.0, 0.0, arm.d_m[j])
        bones = tuple(Capsule(a, b, ARM_RADIUS_M) for a, b in
                      (((0.0, 0.0, 0.0), corner), (corner, end)) if a != b and j > 0)
        links.append(Link(
            f"arm{j + 1}", links[-1].name, place,
            Joint(f"arm_joint{j + 1}", (0.0, 0.0, 1.0), arm.limit_low_rad[j],
                  arm.limit_high_rad[j], 0.0, speed=arm.speed_rad_s[j]), bones, touches=False))
        place = (*end, *turn)
    x, y, z, *turned = (float(v) for v in place)
    a, b, c, d = turned
    return links, (x, y, z + mount_length_m, a, b, c, d)


def _serial_tree(model: ArmModel, mount_length_m: float) -> tuple[list[Link], Place]:
    places = [(*joint.xyz_m, *Rotation.from_euler("xyz", joint.rpy_rad).as_quat())
              for joint in model.joints]
    places.append((*model.flange_xyz_m,
                   *Rotation.from_euler("xyz", model.flange_rpy_rad).as_quat()))
    base = (*model.base_xyz_m, *Rotation.from_euler("xyz", model.base_rpy_rad).as_quat())
    links = [Link("base", "", _floats(base), touches=False)]
    origin = (0.0, 0.0, 0.0)
    for joint, place, then in zip(model.joints, places, places[1:], strict=False):
        end = (then[0], then[1], then[2])
        bones = (Capsule(origin, end, ARM_RADIUS_M),) if end != origin else ()
        links.append(Link(
            f"arm{len(links)}", links[-1].name, _floats(place),
            Joint(f"arm_joint{len(links)}", joint.axis, joint.low_rad, joint.high_rad, 0.0,
                  speed=joint.speed_rad_s), bones, touches=False))
    at = np.array(places[-1][:3]) + Rotation.from_quat(places[-1][3:]).apply(
        [0.0, 0.0, mount_length_m])
    return links, _floats((*at, *places[-1][3:]))


def _floats(place: Sequence[float]) -> Place:
    x, y, z, a, b, c, d = (float(v) for v in place)
    return x, y, z, a, b, c, d


def _dh_end(arm: ArmTable, j: int) -> tuple[tuple[float, float, float], tuple[float, ...]]:
    """Where the next joint's frame is in joint frame j: along z, along x, then turned about x."""
    half = ALPHA_RAD[j] / 2
    return ((arm.a_m[j], 0.0, arm.d_m[j]),
            (float(np.sin(half)), 0.0, 0.0, float(np.cos(half))))


def _pad_site(name: str, hand: HandTable, pads: PadTable, j: int) -> PadSite:
    """The box from a link's axis to a pad's surface, along all of the pad."""
    radius, length = hand.link_radius_m + pads.thickness_m, hand.link_length_m[j]
    low, high = (length - pads.length_m) / 2, (length + pads.length_m) / 2
    if j == 2:
        low = length - (pads.length_m - pads.wrap_rad * radius)
        high = length + radius * float(np.sin(pads.wrap_rad))
    return PadSite(name, (radius / 2, 0.0, (low + high) / 2), (radius, pads.width_m, high - low))
