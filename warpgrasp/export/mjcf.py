"""The robot, and the object before it, as MJCF text for MuJoCo.

Joints carry position actuators of the hand's joint stiffness, so a finger commanded slowly rests
where `finger.equilibrium` says. In the text gravity is off, and links meet the object and the table
but not each other; `warpgrasp validate` switches both on. Armature and damping decide only how fast
a finger gets there.
"""

import math
from collections.abc import Iterable, Sequence
from xml.sax.saxutils import quoteattr

from warpgrasp.export.convex_solids import Solid
from warpgrasp.export.robot_tree import BALL_M, DENSITY_KG_M3, STILL, Joint, Link
from warpgrasp.hands.hand_model import Capsule

FINGER_ARMATURE = 1e-4
"""Rotor inertia of a finger joint [kg m2, est]."""
ARM_STIFFNESS, ARM_ARMATURE = 1e5, 1.0
"""Of an arm joint's servo: the simulator's arm does not yield [est]."""
_LINK = 'contype="1" conaffinity="2"'
_STANDS = 'contype="2" conaffinity="1"'
_IDLE = 'contype="0" conaffinity="0"'


def mjcf_text(
    links: Sequence[Link], solids: Sequence[Solid] = (), *, name: str = "warpgrasp",
    object_place: Sequence[float] = STILL, table: bool = True, limits: bool = True,
) -> str:
    """MJCF of a robot's links and an object's solids standing at `object_place`.

    `limits` False leaves joint limits out, as `ContactTable.joint_stops` does in the simulator.
    """
    children: dict[str, list[Link]] = {}
    for link in links:
        children.setdefault(link.parent, []).append(link)
    joints = [link.joint for link in links if link.joint is not None]
    driven = [joint for joint in joints if joint.follows is None]
    lines = [
        f"<mujoco model={quoteattr(name)}>",
        '  <compiler angle="radian" autolimits="true"/>',
        '  <option gravity="0 0 0" timestep="0.001" integrator="implicitfast" cone="elliptic"/>',
        '  <default>',
        f'    <geom density="{_n(DENSITY_KG_M3)}" condim="3" friction="0.5 0 0"/>',
        '  </default>',
        *_assets(solids),
        '  <worldbody>',
    ]
    if table:
        lines.append(f'    <geom name="table" type="plane" size="1 1 0.1" {_STANDS}/>')
    if solids:
        lines += [f'    <body name="object" {_place(object_place)}>',
                  *(f"      {_solid(solid, k)}" for k, solid in enumerate(solids)), "    </body>"]
    for link in children.get("", []):
        lines += _body(link, children, 4, limits)
    lines += ["  </worldbody>", "  <actuator>"]
    for joint in driven:
        held = f' forcerange="{_n(-joint.effort)} {_n(joint.effort)}"' if joint.effort else ""
        lines.append(f'    <position name="{joint.name}" joint="{joint.name}" '
                     f'kp="{_n(joint.stiffness or ARM_STIFFNESS)}" '
                     f'ctrlrange="{_n(joint.low)} {_n(joint.high)}"{held}/>')
    lines += ["  </actuator>", *_equalities(joints), "  <sensor>"]
    for pad in (pad for link in links for pad in link.pads):
        lines.append(f'    <touch name="{pad.name}" site="{pad.name}"/>')
    return "\n".join([*lines, "  </sensor>", "</mujoco>", ""])


def _body(link: Link, children: dict[str, list[Link]], indent: int, limits: bool) -> list[str]:
    pad = " " * indent
    lines = [f'{pad}<body name="{link.name}" {_place(link.place)}>']
    if link.joint is not None:
        j = link.joint
        armature = FINGER_ARMATURE if j.stiffness else ARM_ARMATURE
        damping = 2.0 * ((j.stiffness or ARM_STIFFNESS) * armature) ** 0.5
        held = f'range="{_n(j.low)} {_n(j.high)}"' if limits else 'limited="false"'
        lines.append(f'{pad}  <joint name="{j.name}" axis="{_all(j.axis)}" {held} '
                     f'armature="{_n(armature)}" damping="{damping:.6g}"/>')
    if link.joint is not None and not link.capsules and not link.boxes:
        lines.append(f'{pad}  <geom type="sphere" size="0.004" {_IDLE}/>')  # a moving body has mass
    for k, capsule in enumerate(link.capsules):
        lines.append(f'{pad}  {_capsule(capsule, f"{link.name}_{k}", link.touches)}')
    for k, box in enumerate(link.boxes, len(link.capsules)):
        size = _all(v / 2 for v in box.size)
        lines.append(f'{pad}  <geom name="{link.name}_{k}" type="box" size="{size}" '
                     f'{_place(box.place)} {_LINK if link.touches else _IDLE}/>')
    for site in link.pads:
        half = [v / 2 for v in site.size]
        lines.append(f'{pad}  <site name="{site.name}" type="box" pos="{_all(site.centre)}" '
                     f'size="{_all(half)}" rgba="0.2 0.6 0.3 0.4"/>')
    for child in children.get(link.name, []):
        lines += _body(child, children, indent + 2, limits)
    return [*lines, f"{pad}</body>"]


def _equalities(joints: Iterable[Joint]) -> list[str]:
    """Joints that follow others: MuJoCo's polynomial of the other's angle."""
    lines = [f'    <joint joint1="{j.name}" joint2="{j.follows.joint}" '
             f'polycoef="{_n(j.follows.offset_rad)} {_n(j.follows.factor)} 0 0 0"/>'
             for j in joints if j.follows is not None]
    return ["  <equality>", *lines, "  </equality>"] if lines else []


def _capsule(c: Capsule, name: str, touches: bool) -> str:
    shape = f'type="capsule" fromto="{_all((*c.start, *c.end))}"'
    if math.dist(c.start, c.end) < BALL_M:
        shape = f'type="sphere" pos="{_all(c.start)}"'
    return f'<geom name="{name}" {shape} size="{_n(c.radius)}" {_LINK if touches else _IDLE}/>'


def _assets(solids: Sequence[Solid]) -> list[str]:
    meshes = [(k, s) for k, s in enumerate(solids) if s.kind == "mesh"]
    if not meshes:
        return []
    lines = ["  <asset>"]
    for k, solid in meshes:
        faces = " ".join(str(int(v)) for v in solid.faces.ravel())
        lines.append(f'    <mesh name="object_{k}" vertex="{_all(solid.vertices.ravel())}" '
                     f'face="{faces}"/>')
    return [*lines, "  </asset>"]


def _solid(solid: Solid, k: int) -> str:
    if solid.kind == "mesh":
        shape = f'type="mesh" mesh="object_{k}"'
    else:
        shape = f'type="{solid.kind}" size="{_all(_half_sizes(solid))}"'
    return f'<geom name="object_{k}" {shape} {_place(solid.place)} {_STANDS}/>'


def _half_sizes(solid: Solid) -> list[float]:
    size = solid.size
    if solid.kind == "box":
        return [v / 2 for v in size]
    if solid.kind == "cylinder":
        return [size[0], size[1] / 2]
    if solid.kind == "capsule":
        return [size[0], size[1] / 2 - size[0]]
    return list(size)


def _place(place: Sequence[float]) -> str:
    x, y, z, qx, qy, qz, qw = place
    return f'pos="{_all((x, y, z))}" quat="{_all((qw, qx, qy, qz))}"'


def _all(values: Iterable[float]) -> str:
    return " ".join(_n(v) for v in values)


def _n(value: float) -> str:
    return f"{float(value):.12g}"
