"""The robot, and the object before it, as URDF text. URDF has no capsule: a cylinder, two balls.

Meshes of an object are files beside it; actuators, stiffness and pads are beyond URDF: stiffness
goes into the joints' dynamics as a comment, pads are fixed frames with the names of their sites.
"""

from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.export.convex_solids import Solid
from warpgrasp.export.robot_tree import BALL_M, DENSITY_KG_M3, STILL, Link
from warpgrasp.hands.hand_frames import fixed_angles
from warpgrasp.hands.hand_model import Capsule
from warpgrasp.hands.urdf_tree import NO_LIMIT_NM

_SPEED = 10.0  # of a joint whose speed is not known [rad/s, est]: URDF requires it


def urdf_text(
    links: Sequence[Link], solids: Sequence[Solid] = (), *, name: str = "warpgrasp",
    object_place: Sequence[float] = STILL, mesh_stem: str = "object",
) -> tuple[str, dict[str, str]]:
    """URDF of links and object, and the mesh files it names (file name: OBJ text)."""
    meshes: dict[str, str] = {}
    lines = [f"<robot name={quoteattr(name)}>", '  <link name="world"/>']
    for link in links:
        lines += [f'  <link name="{link.name}">', *_inertial(link)]
        for capsule in link.capsules:
            for role in ("visual", "collision") if link.touches else ("visual",):
                lines += _capsule(capsule, role)
        for box in link.boxes:
            for role in ("visual", "collision") if link.touches else ("visual",):
                lines += _shape(role, box.place, f'<box size="{_all(box.size)}"/>')
        lines += ["  </link>", *_joint(link)]
        for pad in link.pads:
            lines += _fixed(pad.name, link.name, (*pad.centre, 0.0, 0.0, 0.0, 1.0))
    if solids:
        lines.append('  <link name="object">')
        for k, solid in enumerate(solids):
            if solid.kind == "mesh":
                meshes[f"{mesh_stem}_{k}.obj"] = _obj(solid)
            for role in ("visual", "collision"):
                lines += _solid(solid, f"{mesh_stem}_{k}.obj", role)
        lines += ["  </link>", *_fixed_joint("object", "world", object_place)]
    return "\n".join([*lines, "</robot>", ""]), meshes


def _joint(link: Link) -> list[str]:
    parent = link.parent or "world"
    if link.joint is None:
        return _fixed_joint(link.name, parent, link.place)
    j = link.joint
    lines = [f'  <joint name="{j.name}" type="revolute">',
             f'    <parent link="{parent}"/>', f'    <child link="{link.name}"/>',
             f"    {_origin(link.place)}", f'    <axis xyz="{_all(j.axis)}"/>',
             f'    <limit lower="{_n(j.low)}" upper="{_n(j.high)}" '
             f'effort="{_n(j.effort or NO_LIMIT_NM)}" velocity="{_n(j.speed or _SPEED)}"/>']
    if j.follows is not None:
        f = j.follows
        lines.append(f'    <mimic joint="{f.joint}" multiplier="{_n(f.factor)}" '
                     f'offset="{_n(f.offset_rad)}"/>')
    if j.stiffness:
        lines.append(f"    <!-- position servo: {_n(j.stiffness)} N m/rad -->")
    return [*lines, "  </joint>"]


def _fixed(name: str, parent: str, place: Sequence[float]) -> list[str]:
    return [f'  <link name="{name}"/>', *_fixed_joint(name, parent, place)]


def _fixed_joint(name: str, parent: str, place: Sequence[float]) -> list[str]:
    return [f'  <joint name="{name}_fixed" type="fixed">', f'    <parent link="{parent}"/>',
            f'    <child link="{name}"/>', f"    {_origin(place)}", "  </joint>"]


def _capsule(c: Capsule, role: str) -> list[str]:
    start, end = np.asarray(c.start), np.asarray(c.end)
    length = float(np.linalg.norm(end - start))
    if length < BALL_M:
        return _shape(role, (*((start + end) / 2), 0.0, 0.0, 0.0, 1.0),
                      f'<sphere radius="{_n(c.radius)}"/>')
    along = Rotation.align_vectors([(end - start) / length], [[0.0, 0.0, 1.0]])[0].as_quat()
    return [*_shape(role, (*((start + end) / 2), *along),
                    f'<cylinder radius="{_n(c.radius)}" length="{_n(length)}"/>'),
            *(line for place in (start, end) for line in _shape(
                role, (*place, 0.0, 0.0, 0.0, 1.0), f'<sphere radius="{_n(c.radius)}"/>'))]


def _shape(role: str, place: Sequence[float], geometry: str) -> list[str]:
    return [f"    <{role}>", f"      {_origin(place)}",
            f"      <geometry>{geometry}</geometry>", f"    </{role}>"]


def _solid(solid: Solid, file: str, role: str) -> list[str]:
    size = solid.size
    if solid.kind == "box":
        return _shape(role, solid.place, f'<box size="{_all(size)}"/>')
    if solid.kind == "cylinder":
        return _shape(role, solid.place,
                      f'<cylinder radius="{_n(size[0])}" length="{_n(size[1])}"/>')
    if solid.kind == "capsule":
        turn = Rotation.from_quat(solid.place[3:])
        rise = turn.apply([0.0, 0.0, size[1] / 2 - size[0]])
        ends = [tuple(np.asarray(solid.place[:3]) + s * rise) for s in (-1, 1)]
        return _capsule(Capsule(ends[0], ends[1], size[0]), role)
    if solid.kind == "sphere":
        return _shape(role, solid.place, f'<sphere radius="{_n(size[0])}"/>')
    if solid.kind == "ellipsoid":  # a ball's mesh would be scaled; URDF readers differ there
        raise ValueError("URDF knows no ellipsoid; export to MJCF")
    return _shape(role, solid.place, f"<mesh filename={quoteattr(file)}/>")


def _obj(solid: Solid) -> str:
    rows = [f"v {_all(v)}" for v in solid.vertices]
    return "\n".join([*rows, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in solid.faces), ""])


def _inertial(link: Link) -> list[str]:
    """Mass and inertia of solid boxes, and of capsules as cylinders with balls at their ends; a
    moving link without shapes has some mass, as readers require."""
    capsules, boxes = link.capsules, link.boxes
    if not capsules and not boxes:
        return [] if link.joint is None else [
            '    <inertial><mass value="0.001"/><inertia ixx="1e-7" ixy="0" ixz="0" iyy="1e-7" '
            'iyz="0" izz="1e-7"/></inertial>']
    parts = []
    for box in boxes:
        size, turn = np.asarray(box.size), Rotation.from_quat(box.place[3:]).as_matrix()
        weight = DENSITY_KG_M3 * float(size.prod())
        spin = turn @ np.diag(weight / 12 * ((size**2).sum() - size**2)) @ turn.T
        parts.append((weight, np.asarray(box.place[:3]), spin))
    for c in capsules:
        start, end = np.asarray(c.start), np.asarray(c.end)
        length = float(np.linalg.norm(end - start))
        u = (end - start) / (length or 1.0)  # a ball turns alike about any axis
        tube = DENSITY_KG_M3 * np.pi * c.radius**2 * length
        ball = DENSITY_KG_M3 * 4 / 3 * np.pi * c.radius**3
        across = (tube * (length**2 / 12 + c.radius**2 / 4)
                  + ball * (0.4 * c.radius**2 + length**2 / 4 + 3 / 8 * length * c.radius))
        along = tube * c.radius**2 / 2 + ball * 0.4 * c.radius**2
        spin = across * (np.eye(3) - np.outer(u, u)) + along * np.outer(u, u)
        parts.append((tube + ball, (start + end) / 2, spin))
    mass = sum(m for m, _, _ in parts)
    centre = np.sum([m * p for m, p, _ in parts], axis=0) / mass
    total = sum(spin + m * ((p - centre) @ (p - centre) * np.eye(3)
                            - np.outer(p - centre, p - centre)) for m, p, spin in parts)
    i = np.asarray(total)
    return ["    <inertial>", f"      {_origin((*centre, 0.0, 0.0, 0.0, 1.0))}",
            f'      <mass value="{_n(mass)}"/>',
            f'      <inertia ixx="{_n(i[0, 0])}" ixy="{_n(i[0, 1])}" ixz="{_n(i[0, 2])}" '
            f'iyy="{_n(i[1, 1])}" iyz="{_n(i[1, 2])}" izz="{_n(i[2, 2])}"/>', "    </inertial>"]


def _origin(place: Sequence[float]) -> str:
    rpy = fixed_angles(Rotation.from_quat(place[3:]).as_matrix())
    return f'<origin xyz="{_all(place[:3])}" rpy="{_all(rpy)}"/>'


def _all(values: Sequence[float]) -> str:
    return " ".join(_n(v) for v in values)


def _n(value: float) -> str:
    return f"{float(value) + 0.0:.12g}"
