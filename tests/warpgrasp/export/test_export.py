"""Exports: what MuJoCo and a URDF reader make of them stands where our kinematics say."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from fit.superquadric.geometry import superquadric, superquadric_volume
from sweeps.cli import main as cli
from warpgrasp.export.convex_solids import convex_runs, object_solids
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.export.robot_tree import FINGERS, STILL, Link, arm_hand_tree, hand_tree
from warpgrasp.export.urdf import urdf_text
from warpgrasp.geometry.body import Body, BodyError, Part, distance_to_bodies, scene_of
from warpgrasp.geometry.scene import Join, Shape
from warpgrasp.hands.hand_model import Box, Capsule
from warpgrasp.mechanism.arm_motion import arm_hand_links
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ArmTable, HandTable, PadTable

ARM, HAND, PADS = ArmTable(), HandTable(), PadTable()
NEAR_M = 1e-6
PLACE = (0.1, -0.2, 0.3, 0.5, -0.5, 0.5, 0.5)


def random_joints(links: list[Link], count: int) -> np.ndarray:
    joints = [link.joint for link in links if link.joint is not None]
    rng = np.random.default_rng(1)
    return rng.uniform([j.low for j in joints], [j.high for j in joints], (count, len(joints)))


def tree_poses(links: list[Link], q: np.ndarray) -> dict[str, tuple[np.ndarray, Rotation]]:
    """Link poses for joints `q`, written out anew from the tree."""
    poses: dict[str, tuple[np.ndarray, Rotation]] = {"": (np.zeros(3), Rotation.identity())}
    angles = iter(q)
    for link in links:
        place, turn = poses[link.parent]
        place = place + turn.apply(link.place[:3])
        turn = turn * Rotation.from_quat(link.place[3:])
        if link.joint is not None:
            turn = turn * Rotation.from_rotvec(next(angles) * np.asarray(link.joint.axis))
        poses[link.name] = (place, turn)
    return poses


def check_fingers(poses, points: np.ndarray, palmar: np.ndarray) -> None:
    """Every phalanx starts, ends and faces as our forward kinematics of one pose say."""
    for f, finger in enumerate(FINGERS):
        for k, phalanx in enumerate(("proximal", "middle", "distal")):
            place, turn = poses[f"{finger}_{phalanx}"]
            assert np.abs(place - points[f, k + 1]).max() < NEAR_M
            end = place + turn.apply([0.0, 0.0, HAND.link_length_m[k]])
            assert np.abs(end - points[f, k + 2]).max() < NEAR_M
            assert np.abs(turn.apply([1.0, 0.0, 0.0]) - palmar[f, k]).max() < NEAR_M


def test_the_tree_is_the_kernels_robot() -> None:
    links = arm_hand_tree(ARM, HAND, PADS)
    q = random_joints(links, 20)
    assert q.shape[1] == 22
    points, palmar = arm_hand_links(ARM, HAND, q)
    for k in range(len(q)):
        check_fingers(tree_poses(links, q[k]), points[k], palmar[k])


@pytest.mark.parametrize("arm", [pytest.param(False, marks=pytest.mark.slow), True])
def test_mujoco_puts_links_where_we_do(arm: bool) -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: make validate")
    links = arm_hand_tree(ARM, HAND, PADS) if arm else hand_tree(HAND, PADS, place=PLACE)
    model = mujoco.MjModel.from_xml_string(mjcf_text(links))
    data = mujoco.MjData(model)
    q = random_joints(links, 60)
    if arm:
        points, palmar = arm_hand_links(ARM, HAND, q)
    else:
        points, palmar = hand_links(HAND, np.tile(PLACE, (len(q), 1)), q.reshape(-1, 4, 4))
    for k in range(len(q)):
        data.qpos[:] = q[k]
        mujoco.mj_kinematics(model, data)
        poses = {link.name: (data.body(link.name).xpos.copy(),
                             Rotation.from_matrix(data.body(link.name).xmat.reshape(3, 3)))
                 for link in links}
        check_fingers(poses, points[k], palmar[k])


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # the reader's own, of its mesh library
@pytest.mark.parametrize("arm", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_urdf_reader_puts_links_where_we_do(arm: bool, tmp_path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed: make validate")
    links = arm_hand_tree(ARM, HAND, PADS) if arm else hand_tree(HAND, PADS, place=PLACE)
    text, meshes = urdf_text(links, object_solids(body_from_name("wedge")))
    for name, content in meshes.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "robot.urdf").write_text(text)
    robot = yourdfpy.URDF.load(str(tmp_path / "robot.urdf"), load_meshes=True,
                               build_collision_scene_graph=True, load_collision_meshes=True)
    assert robot.validate()
    joints = [link.joint.name for link in links if link.joint is not None]
    q = random_joints(links, 40)
    if arm:
        points, palmar = arm_hand_links(ARM, HAND, q)
    else:
        points, palmar = hand_links(HAND, np.tile(PLACE, (len(q), 1)), q.reshape(-1, 4, 4))
    for k in range(len(q)):
        robot.update_cfg(dict(zip(joints, q[k], strict=True)))
        poses = {}
        for link in links:
            matrix = np.array(robot.get_transform(link.name, "world"))  # no view: SciPy 1.15
            poses[link.name] = matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3])
        check_fingers(poses, points[k], palmar[k])


def test_actuators_limits_and_pads_are_the_tables() -> None:
    root = ET.fromstring(mjcf_text(arm_hand_tree(ARM, HAND, PADS)))
    servos = {a.get("name"): a for a in root.iter("position")}
    assert len(servos) == 22
    assert float(servos["thumb_flexion2"].get("kp")) == HAND.joint_stiffness_Nm_rad
    joints = {j.get("name"): j for j in root.iter("joint")}
    assert [float(v) for v in joints["ring_flexion1"].get("range").split()] == pytest.approx(
        [HAND.flexion_low_rad[0], HAND.flexion_high_rad[0]])
    assert len(list(root.iter("site"))) == 4


@pytest.mark.parametrize("name", ["block", "large_cylinder", "wedge", "wine_bottle", "funnel"])
def test_solids_fill_the_body(name: str) -> None:
    """Points of every solid lie in the body, and its surface in the solids, by our distance."""
    body = body_from_name(name)
    scene = scene_of([body], "cpu")
    for solid in object_solids(body):
        if solid.kind != "mesh":
            continue
        distance, _ = distance_to_bodies(scene, np.zeros(1, int), solid.vertices[None])
        assert distance.max() < 1e-4
        edges = np.cross(solid.vertices[solid.faces[:, 1]] - solid.vertices[solid.faces[:, 0]],
                         solid.vertices[solid.faces[:, 2]] - solid.vertices[solid.faces[:, 0]])
        outward = solid.vertices[solid.faces].mean(1) - solid.vertices.mean(0)
        assert ((edges * outward).sum(1) > -1e-15).all()


@pytest.mark.parametrize(("shape", "size", "tall_mm", "volume_mm3"), [
    ("block", {"size_mm": [60, 40, 20]}, 20, 60 * 40 * 20),
    ("cylinder", {"radius_mm": 20, "height_mm": 50}, 50, np.pi * 400 * 50),
    ("capsule", {"radius_mm": 10, "height_mm": 60}, 60, np.pi * 100 * (40 + 40 / 3)),
    ("sphere", {"radius_mm": 15}, 30, 4 / 3 * np.pi * 15**3)])
def test_mujoco_takes_simple_solids_as_large_as_they_are(
        shape: str, size: dict, tall_mm: float, volume_mm3: float) -> None:
    mujoco = pytest.importorskip("mujoco")
    body = body_from_table({"name": "it", "compound": [{"shape": shape, **size}]}, Path())
    model = mujoco.MjModel.from_xml_string(mjcf_text((), object_solids(body)))
    assert model.body("object").mass.item() == pytest.approx(1e-6 * volume_mm3)
    assert model.body("object").ipos == pytest.approx([0.0, 0.0, tall_mm / 2e3], abs=1e-4)


def test_rings_lie_half_inside_and_half_outside_the_circle() -> None:
    part = Part(Shape.REVOLUTION, profile_m=np.array([[0.0, 0.03], [0.1, 0.03]]))
    solid, = object_solids(Body("tube", (part,), (-0.03, -0.03, 0.0), (0.03, 0.03, 0.1)))
    ring = solid.vertices[solid.vertices[:, 2] == 0.0][:, :2]
    ring = ring[np.argsort(np.arctan2(ring[:, 1], ring[:, 0]))]
    corner, side = (np.linalg.norm(at, axis=1) for at in (ring, (ring + np.roll(ring, 1, 0)) / 2))
    assert corner.mean() - 0.03 == pytest.approx(0.03 - side.mean(), rel=1e-3)
    assert np.ptp(side) < 1e-8


@pytest.mark.parametrize("wrap_deg", [30.0, 80.0])
def test_the_box_of_a_pad_over_a_fingertip_ends_where_the_pad_does(wrap_deg: float) -> None:
    pads = replace(PADS, wrap_rad=np.radians(wrap_deg))
    site, = next(link.pads for link in hand_tree(HAND, pads) if link.name == "index_distal")
    radius, length = HAND.link_radius_m + pads.thickness_m, HAND.link_length_m[2]
    along = np.linspace(0.0, pads.length_m, 1000)  # its face: straight, then about the tip
    bent = np.maximum(along - (pads.length_m - radius * pads.wrap_rad), 0.0) / radius
    straight = length - (pads.length_m - radius * pads.wrap_rad)
    z = np.minimum(straight + along, length) + radius * np.sin(bent)
    ends = site.centre[2] + np.array([-0.5, 0.5]) * site.size[2]
    assert ends == pytest.approx([z.min(), z.max()], abs=1e-9)


def test_inertia_is_that_of_solid_capsules_and_boxes() -> None:
    """By the polyhedra of their surfaces, alone and together, which do not overlap."""
    rod = Capsule((0.01, 0.0, 0.02), (0.01, 0.03, 0.05), 0.012)
    ball = Capsule((-0.05, 0.0, 0.0), (-0.05, 0.0, 0.0), 0.01)
    box = Box((0.0, -0.06, 0.01, *Rotation.from_rotvec([0.3, 0.5, -0.2]).as_quat()),
              (0.02, 0.03, 0.05))
    meshes = []
    for c in (rod, ball):
        along = np.subtract(c.end, c.start)
        mesh = trimesh.creation.capsule(float(np.linalg.norm(along)), c.radius, count=(96, 96))
        turn = trimesh.geometry.align_vectors([0, 0, 1], along) if along.any() else np.eye(4)
        meshes.append(mesh.apply_transform(turn).apply_translation(np.add(c.start, c.end) / 2))
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = Rotation.from_quat(box.place[3:]).as_matrix(), box.place[:3]
    meshes.append(trimesh.creation.box(box.size, frame))
    for capsules, boxes, mesh in (((rod,), (), meshes[0]), ((), (box,), meshes[2]),
                                  ((rod, ball), (box,), trimesh.util.concatenate(meshes))):
        mesh.density = 1000.0
        text, _ = urdf_text([Link("a", "", STILL, capsules=capsules, boxes=boxes)])
        inertial = ET.fromstring(text).find("link[@name='a']/inertial")
        assert inertial is not None
        numbers = {key: value for part in inertial for key, value in part.attrib.items()}
        assert float(numbers["value"]) == pytest.approx(mesh.mass, rel=3e-3)
        assert [float(v) for v in numbers["xyz"].split()] == pytest.approx(
            mesh.center_mass, abs=1e-4)
        x, y, z = np.eye(3, dtype=int)
        for name, one, other in (("ixx", x, x), ("iyy", y, y), ("izz", z, z), ("ixy", x, y),
                                 ("ixz", x, z), ("iyz", y, z)):
            assert float(numbers[name]) == pytest.approx(
                one @ mesh.moment_inertia @ other, rel=6e-3, abs=1e-3 * mesh.moment_inertia.max())


def test_convex_runs_meet_and_are_convex() -> None:
    profile = body_from_name("coke_bottle").parts[0].profile_m
    runs = convex_runs(profile)
    assert len(runs) > 1
    assert np.array_equal(np.concatenate([runs[0], *(r[1:] for r in runs[1:])]), profile)
    for run in runs:
        slope = np.diff(run[:, 1]) / np.diff(run[:, 0])
        assert (np.diff(slope) <= 1e-8).all()


def test_what_cannot_be_said_is_refused(tmp_path) -> None:
    cup = Body("cup", (Part(Shape.BLOCK, size_m=(0.1, 0.1, 0.1)),
                       Part(Shape.SPHERE, Join.DIFFERENCE, size_m=(0.03, 0, 0))),
               (-0.05, -0.05, 0.0), (0.05, 0.05, 0.1))
    with pytest.raises(BodyError, match="difference"):
        object_solids(cup)
    hook = body_from_table({"name": "hook", "superquadric": {
        "size_mm": [20, 20, 60], "exponents": [0.5, 1.0], "bend_per_m": 5.0}}, tmp_path)
    with pytest.raises(BodyError, match="bent"):
        object_solids(hook)


def test_a_urdf_names_meshes_by_any_name_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "a&b.urdf"
    assert cli.run(["export", str(file), "--object", "wine_bottle"]) == 0
    named = {mesh.get("filename", "") for mesh in ET.parse(file).iter("mesh")}
    assert "a&b_object_0.obj" in named
    assert all((tmp_path / name).is_file() for name in named)


def test_hulls_larger_than_their_mesh_are_told(tmp_path: Path,
                                               capsys: pytest.CaptureFixture[str]) -> None:
    posts = [trimesh.creation.box([0.02, 0.02, 0.1], trimesh.transformations.translation_matrix(at))
             for at in ([0.05, 0.0, 0.0], [-0.05, 0.0, 0.0])]
    trimesh.util.concatenate(posts).export(tmp_path / "posts.stl")
    posts[0].export(tmp_path / "post.stl")
    for name, said in (("posts", "its convex hull is 200% larger"), ("post", "")):
        assert cli.run(["export", str(tmp_path / f"{name}.xml"), "--object",
                        str(tmp_path / f"{name}.stl"), "--units", "m"]) == 0
        told = capsys.readouterr().err
        assert said in told
        assert ("hull" in told) == bool(said)


def test_only_moving_links_without_shapes_have_a_mass_of_their_own() -> None:
    frame, turning = Link("tip", "", STILL, None), next(
        link for link in hand_tree(HAND, PADS) if link.joint is not None)
    for link, weighs in ((frame, False), (replace(turning, capsules=(), boxes=()), True)):
        root = ET.fromstring(urdf_text([link])[0])
        assert (root.find(f"link[@name='{link.name}']/inertial") is not None) == weighs


@pytest.mark.parametrize("without", ["mount_length_m", "finger_spacing_m"])
def test_capsules_without_length_are_balls(without: str, tmp_path) -> None:
    """A hand on the flange, fingers in one plane, a capsule as high as wide."""
    mujoco = pytest.importorskip("mujoco")
    pill = body_from_table({"name": "pill", "compound": [
        {"shape": "capsule", "radius_mm": 20, "height_mm": 40}]}, tmp_path)
    tree, solids = hand_tree(replace(HAND, **{without: 0.0}), PADS), object_solids(pill)
    model = mujoco.MjModel.from_xml_string(mjcf_text(tree, solids))
    balls = model.geom_size[model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE, 0]
    thick = HAND.palm_thickness_m / 2  # of the palm's bars and the wrist, beside fingertips' marks
    bars = 1 if without == "mount_length_m" else 3
    np.testing.assert_allclose(np.sort(balls[balls > 0.01]), np.sort([0.02, *[thick] * bars]))
    inertia = [float(i.attrib[k]) for i in ET.fromstring(urdf_text(tree, solids)[0]).iter("inertia")
               for k in ("ixx", "iyy", "izz")]
    assert np.isfinite(inertia).all()
    assert np.min(inertia) > 0.0


@pytest.mark.parametrize(("exponents", "taper", "hollow"), [
    ((1.0, 1.0), (1.0, 1.0), True), ((1.5, 1.5), (-0.8, -0.8), True),
    ((1.0, 1.0), (1.0, -1.0), True), ((1.0, 1.0), (0.5, 0.5), False),
    ((0.1, 0.1), (0.3, 0.0), False), ((0.2, 0.3), (-0.9, -0.9), False)])
def test_no_hollow_of_a_taper_is_filled(exponents, taper, hollow: bool, tmp_path) -> None:
    body = body_from_table({"name": "pear", "superquadric": {
        "size_mm": [30, 30, 60], "exponents": list(exponents), "taper": list(taper)}}, tmp_path)
    if hollow:
        with pytest.raises(BodyError, match="taper is not convex"):
            object_solids(body)
        return
    solid, = object_solids(body)
    shape = superquadric((0.03, 0.03, 0.06), exponents, taper=taper)
    true = float(np.squeeze(superquadric_volume(shape)))
    assert ConvexHull(solid.vertices).volume == pytest.approx(true, rel=6e-3)
