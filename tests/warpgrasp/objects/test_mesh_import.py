"""Meshes: a baked block against the formula, and every kind of bad file refused with its mend."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from places import SHARED

from sweeps.validate.bodies.scan_meshes import scan_meshes
from warpgrasp.geometry.body import BodyError, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.mesh_import import body_from_mesh, mesh_triangles

YCB = SHARED / "objects" / "ycb"


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path / "cache"))


def block_file(folder: Path, scale: float = 1.0, name: str = "block.stl") -> Path:
    mesh = trimesh.creation.box((0.060 * scale, 0.080 * scale, 0.120 * scale))
    mesh.export(folder / name)
    return folder / name


def test_a_baked_block_is_the_block(tmp_path: Path) -> None:
    baked = body_from_mesh(block_file(tmp_path), units="m")
    true = body_from_name("block")
    assert np.allclose(baked.low_m, true.low_m, atol=1e-6)
    assert np.allclose(baked.high_m, true.high_m, atol=1e-6)
    rng = np.random.default_rng(0)
    points = rng.uniform((-0.08, -0.08, -0.04), (0.08, 0.08, 0.16), (1, 4000, 3))
    d, _ = distance_to_bodies(scene_of([baked, true], "cpu"), np.zeros(1, int), points)
    exact, _ = distance_to_bodies(scene_of([baked, true], "cpu"), np.ones(1, int), points)
    cell = baked.parts[0].grid_cell_m
    near = np.abs(exact) < 3.5 * cell  # inside the grid
    assert np.abs(d - exact)[near].max() < 0.5 * cell
    off = np.abs(d - exact)[np.abs(exact) < 2 * cell]
    assert np.quantile(off, 0.9) < baked.grid_error_m < 0.5 * cell  # nearly the largest
    assert (d - exact)[exact > 0.02].max() < 0.5 * cell  # outside the grid: a lower bound
    # Before a face it is the distance itself, however far: but for a cell that is rounded up to.
    ahead = np.array([[[x, 0.01, 0.06] for x in np.linspace(0.04, 0.12, 9)]])
    before, slope = distance_to_bodies(scene_of([baked], "cpu"), np.zeros(1, int), ahead)
    short = ahead[0, :, 0] - true.high_m[0] - before[0]
    assert ((short > -1e-6) & (short < 1e-3)).all()
    assert np.allclose(slope[0], [1.0, 0.0, 0.0], atol=0.08)
    h = 1e-6
    far = points[:, exact[0] > 0.02][:, :200]
    scene = scene_of([baked], "cpu")
    _, slope = distance_to_bodies(scene, np.zeros(1, int), far)
    by_steps = np.stack([(distance_to_bodies(scene, np.zeros(1, int), far + h * e)[0]
                          - distance_to_bodies(scene, np.zeros(1, int), far - h * e)[0]) / (2 * h)
                         for e in np.eye(3)], -1)
    assert np.quantile(np.abs(slope - by_steps), 0.98) < 1e-4
    assert np.linalg.norm(slope, axis=-1).max() < 1.0 + 1e-6
    assert body_from_mesh(block_file(tmp_path), units="m").content == baked.content  # from cache


def test_units_scale_and_content_tells_bodies_apart(tmp_path: Path) -> None:
    metres = body_from_mesh(block_file(tmp_path), units="m")
    millimetres = body_from_mesh(block_file(tmp_path, 1000.0, "mm.stl"), units="mm")
    assert np.allclose(metres.high_m, millimetres.high_m, atol=1e-6)
    other = body_from_mesh(block_file(tmp_path, 0.5, "half.stl"), units="m")
    assert other.content != metres.content


def test_a_mug_of_160_metres(tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=r"120 m long.*read as mm it would fit"):
        body_from_mesh(block_file(tmp_path, 1000.0), units="m")


@pytest.mark.parametrize(("scale", "units"), [
    (1 / 0.0254, "in"), (1 / 0.3, "300 mm"), (1 / 0.3, "0.3m"), (2e4, "5e-2 mm"), (1.0, "100 cm")])
def test_a_unit_of_the_file_may_be_of_any_length(scale: float, units: str, tmp_path: Path) -> None:
    metres, _ = mesh_triangles(block_file(tmp_path), units="m")
    vertices, _ = mesh_triangles(block_file(tmp_path, scale, "scaled.stl"), units=units)
    np.testing.assert_allclose(vertices, metres, rtol=1e-6, atol=1e-9)


def test_a_mesh_of_no_units_is_told_what_would_fit(tmp_path: Path) -> None:
    """As of collections whose models are all one unit long; what is offered is taken."""
    file = block_file(tmp_path, 3e-5)
    with pytest.raises(BodyError, match="would make it 120 mm long") as error:
        mesh_triangles(file, units="cm")
    offered = re.search('units = "([^"]*)"', str(error.value))
    assert offered
    vertices, _ = mesh_triangles(file, units=offered[1])
    assert np.ptp(vertices, axis=0).max() == pytest.approx(0.12, rel=5e-3)


def test_a_mesh_that_its_place_has_rounded_is_refused(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.060, 0.080, 0.120))
    for x_m, name in ((1e3, "near.stl"), (1e5, "far.stl"), (1e5, "far.obj")):
        box.copy().apply_translation([x_m, 0.0, 0.0]).export(tmp_path / name)
    with pytest.raises(BodyError, match=r"lies 1e\+05 of its units from.* 0\.0078 apart"):
        mesh_triangles(tmp_path / "far.stl", units="m")
    for name in ("near.stl", "far.obj"):  # OBJ keeps all digits
        vertices, _ = mesh_triangles(tmp_path / name, units="m")
        assert np.allclose(np.ptp(vertices, axis=0), box.extents, atol=6.2e-5)


def test_an_open_mesh_says_what_is_open_and_how_to_mend_it(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.06, 0.08, 0.12))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "open.ply")
    with pytest.raises(BodyError, match=r"open: 3 edges border one face.*fill_holes"):
        body_from_mesh(tmp_path / "open.ply", units="m")


def test_holes_of_a_scan_close_by_the_mend_that_is_said(tmp_path: Path) -> None:
    """More than a quad: without its option the repair leaves them open."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.04)
    mesh.update_faces(mesh.triangles_center[:, 2] > -0.03)
    mesh.export(tmp_path / "scan.ply")
    with pytest.raises(BodyError) as error:
        body_from_mesh(tmp_path / "scan.ply", units="m")
    assert "fill_holes, with use_fan=True for" in str(error.value)
    mesh = trimesh.load_mesh(tmp_path / "scan.ply")
    trimesh.repair.fill_holes(mesh, use_fan=True)
    mesh.export(tmp_path / "closed.ply")
    body = body_from_mesh(tmp_path / "closed.ply", units="m")
    assert body.high_m[2] == pytest.approx(0.07, abs=0.003)


@pytest.mark.parametrize("first", range(6))
def test_polygons_with_a_hollow_corner_are_no_lids(tmp_path: Path, first: int) -> None:
    """An L-shaped prism as Blender writes it: cut into a fan, its caps bridged the notch, but where
    the fan begins at the hollow corner or the one across."""
    corners = [(-40, -40), (40, -40), (40, -20), (-20, -20), (-20, 40), (-40, 40)]
    corners = corners[first:] + corners[:first]
    faces = [[1, 6, 5, 4, 3, 2], [7, 8, 9, 10, 11, 12],
             *([i + 1, (i + 1) % 6 + 1, (i + 1) % 6 + 7, i + 7] for i in range(6))]
    (tmp_path / "l.obj").write_text("".join(
        f"v {x} {y} {z}\n" for z in (0, 60) for x, y in corners) + "".join(
        f"f {' '.join(map(str, face))}\n" for face in faces))
    if first not in (0, 3):
        with pytest.raises(BodyError, match="polygons with a hollow corner"):
            body_from_mesh(tmp_path / "l.obj", units="mm")
        return
    body = body_from_mesh(tmp_path / "l.obj", units="mm")
    above, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int),
                                  np.array([[[0.0, 0.0, 0.06]]]))
    assert above[0, 0] == pytest.approx(0.02, abs=5e-4)


@pytest.mark.parametrize(("deep_m", "refused"), [(1e-5, False), (1e-3, True)])
def test_a_sliver_folded_on_a_large_face_is_not_felt(
        tmp_path: Path, deep_m: float, refused: bool) -> None:
    """At an edge of a block, a triangle that lies back on one of its sides as deep."""
    box = trimesh.creation.box((0.06, 0.08, 0.12))
    one, (a, b, d) = next((n, face) for n, face in enumerate(box.faces.tolist())
                          if box.face_normals[n][0] > 0.9)
    other, c = next((n, corner) for n, face in enumerate(box.faces.tolist()) if n != one
                    and {a, b} < set(face) for corner in face if corner not in (a, b))
    corners, m = box.vertices, len(box.vertices)
    between = (corners[a] + corners[b]) / 2
    way = corners[d] - between
    within = between + deep_m * way / np.linalg.norm(way)
    faces = [*np.delete(box.faces, other, axis=0), (b, a, m), (m, a, c), (b, m, c)]
    trimesh.Trimesh([*corners, within], faces, process=False).export(tmp_path / "fold.ply")
    if refused:
        with pytest.raises(BodyError, match="fold"):
            mesh_triangles(tmp_path / "fold.ply", units="m")
    else:
        assert len(mesh_triangles(tmp_path / "fold.ply", units="m")[1]) == 14


def test_a_corner_on_an_edge_is_no_hole(tmp_path: Path) -> None:
    """A face without area closes it, as CAD programs write."""
    box = trimesh.creation.box((60, 80, 60))
    (a, b, c), n = box.faces[0], len(box.vertices)
    middle = (box.vertices[a] + box.vertices[b]) / 2
    mesh = trimesh.Trimesh(np.vstack([box.vertices, middle]), np.vstack(
        [box.faces[1:], [a, n, c], [n, b, c], [a, b, n]]), process=False)
    mesh.export(tmp_path / "t.obj")
    body = body_from_mesh(tmp_path / "t.obj", units="mm")
    found, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int),
                                  np.array([[[0.0, 0.0, 0.08], [0.045, 0.0, 0.03]]]))
    assert found[0] == pytest.approx([0.02, 0.015], abs=3e-4)


def test_faces_that_are_there_twice_are_no_holes(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.06, 0.08, 0.12))
    mesh.faces = np.concatenate([mesh.faces, mesh.faces[:1]])
    mesh.export(tmp_path / "twice.ply")
    with pytest.raises(BodyError, match=r"ply: 3 edges are shared by more than two faces: remove"):
        body_from_mesh(tmp_path / "twice.ply", units="m")


def box(size_mm: float, turned: tuple[int, ...] | None = (), **at_mm: float) -> trimesh.Trimesh:
    """A box, half as wide and tall as long, with some of its 12 faces the wrong way round; None:
    all."""
    mesh = trimesh.creation.box(np.array([1.0, 0.5, 0.5]) * size_mm / 1000)
    rows = list(range(12) if turned is None else turned)
    mesh.faces[rows] = mesh.faces[rows, ::-1]
    mesh.apply_translation([at_mm.get(axis, 0.0) / 1000 for axis in "xyz"])
    return mesh


@pytest.mark.parametrize(("shells", "volume_cm3"), [
    ([box(60, (0, 4, 7, 8, 9, 10, 11))], 54),
    ([box(60), box(30)], 54),  # a body in a body
    ([box(60, None), box(30), box(50, None, x=90)], 47.25 + 31.25),  # a hollow one inside out
    ([box(60), box(60, x=30)], 81),
    *(pytest.param(*given, marks=pytest.mark.slow) for given in [
        ([box(60, (3,))], 54),
        ([box(60), box(60, None, x=90)], 108),
        ([box(60), box(30, (1, 2), x=70)], 60.75),
        ([box(60), box(30, None)], 47.25),  # a cavity
        ([box(60, None), box(30)], 47.25),
        ([box(60), box(30, None), box(50, None, x=90)], 47.25 + 31.25)]),
])
def test_faces_are_turned_outward(
    tmp_path: Path, shells: list[trimesh.Trimesh], volume_cm3: float
) -> None:
    trimesh.util.concatenate(shells).export(tmp_path / "shells.stl")
    body = body_from_mesh(tmp_path / "shells.stl", units="m")
    assert sample_body(body).volume_m3 * 1e6 == pytest.approx(volume_cm3, rel=0.01)


@pytest.mark.parametrize(("shells", "message"), [
    ([box(60), box(30, (1,))], "stl: a shell lies in another, and"),
    ([box(60, (1,)), box(30)], "stl: a shell lies in another, and"),
    ([box(60), box(60, None, x=30)], "stl: two of its shells cross, and one is inside out"),
])
def test_faces_that_could_bound_two_bodies_are_refused(
    tmp_path: Path, shells: list[trimesh.Trimesh], message: str
) -> None:
    trimesh.util.concatenate(shells).export(tmp_path / "shells.stl")
    with pytest.raises(BodyError, match=message):
        body_from_mesh(tmp_path / "shells.stl", units="m")


@pytest.mark.parametrize("head", [
    "OFF\n12 8 0\n", "OFF 12 8 0  # a prism\n", "OFF\n# 20240131\n12 8 0\n"])
def test_an_off_file_may_have_polygons(tmp_path: Path, head: str) -> None:
    """At five corners and more the reader itself fails."""
    angle = np.arange(12) * np.pi / 3
    corners = np.stack([np.cos(angle), np.sin(angle), np.arange(12) // 6], 1) * [30, 30, 80]
    sides = [(k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k) for k in range(6)]
    file = tmp_path / "prism.off"
    file.write_text(head + "".join(f"{x} {y} {z}\n" for x, y, z in corners) + "".join(
        f"{len(face)} {' '.join(map(str, face))} 255 0 0\n"
        for face in (range(5, -1, -1), range(6, 12), *sides)))
    mesh = trimesh.Trimesh(*mesh_triangles(file, units="mm"))
    assert len(mesh.faces) == 20
    assert mesh.volume == pytest.approx(0.08 * 0.03**2 * 1.5 * 3**0.5)
    file.write_text(file.read_text().replace("6 5 4 3 2 1 0", "6 5 4 3 x 1 0"))
    with pytest.raises(BodyError, match=r"prism.off: not a mesh that can be read \("):
        mesh_triangles(file, units="mm")


@pytest.mark.parametrize("kind", ["obj", "off"])
def test_a_mark_of_byte_order_is_no_part_of_a_mesh(tmp_path: Path, kind: str) -> None:
    file = tmp_path / f"block.{kind}"
    text = str(trimesh.creation.box([40, 50, 60]).export(file_type=kind))
    start = {"obj": "v ", "off": "OFF"}[kind]  # on what counts, not on a comment
    file.write_text(text[text.index(start):], encoding="utf-8-sig")
    mesh = trimesh.Trimesh(*mesh_triangles(file, units="mm"))
    assert mesh.volume == pytest.approx(0.04 * 0.05 * 0.06)


def test_a_klein_bottle_is_refused(tmp_path: Path) -> None:
    u, v = (a.ravel() for a in np.meshgrid(np.arange(12), np.arange(8), indexing="ij"))
    angle, around = u * np.pi / 6, (v + 0.5) * np.pi / 4
    out = 0.1 + 0.03 * (np.cos(angle / 2) * np.sin(around) - np.sin(angle / 2) * np.sin(2 * around))
    up = 0.03 * (np.sin(angle / 2) * np.sin(around) + np.cos(angle / 2) * np.sin(2 * around))

    def at(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return u % 12 * 8 + np.where(u == 12, -1 - v, v) % 8  # once around is mirrored

    corners = at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)
    faces = np.concatenate([np.stack([corners[k] for k in ks], 1) for ks in ((0, 1, 2), (0, 2, 3))])
    trimesh.Trimesh(np.stack([out * np.cos(angle), out * np.sin(angle), up], 1), faces,
                    process=False).export(tmp_path / "klein.off")
    with pytest.raises(BodyError, match=r"off: its surface has one side"):
        body_from_mesh(tmp_path / "klein.off", units="m")


@pytest.mark.parametrize("wall_mm", [
    pytest.param(0.3, marks=pytest.mark.slow), 1.0, pytest.param(1.5, marks=pytest.mark.slow)])
def test_walls_that_the_grid_would_lose_are_refused(tmp_path: Path, wall_mm: float) -> None:
    mesh = trimesh.creation.annulus(0.02 - wall_mm / 1000, 0.02, 0.1)
    mesh.export(tmp_path / "tube.stl")
    with pytest.raises(BodyError, match=r"tube.stl: .* 1.4 mm apart, which hold .* of its") as said:
        body_from_mesh(tmp_path / "tube.stl", units="m")
    true = float(str(said.value).split("of its ")[1].split(" cm3")[0])
    # Points sampled about so thin a wall tell its volume to 1.3 %, a standard deviation.
    assert true == pytest.approx(mesh.volume * 1e6, rel=0.05)


@pytest.mark.parametrize("mesh", [
    pytest.param(trimesh.creation.annulus(0.037, 0.04, 0.1), marks=pytest.mark.slow),
    pytest.param(trimesh.creation.icosphere(3, 0.003), marks=pytest.mark.slow),
    trimesh.creation.box((0.006, 0.006, 0.006)), trimesh.creation.box((0.1, 0.1, 0.003))])
def test_what_two_nodes_tell_apart_is_kept(tmp_path: Path, mesh: trimesh.Trimesh) -> None:
    mesh.export(tmp_path / "kept.stl")
    volume = sample_body(body_from_mesh(tmp_path / "kept.stl", units="m")).volume_m3
    assert volume == pytest.approx(mesh.volume, rel=0.1)


def test_the_kind_of_a_file_counts_even_if_it_was_baked(tmp_path: Path) -> None:
    file = block_file(tmp_path)
    body_from_mesh(file, units="m")
    with pytest.raises(BodyError, match="obj: "):
        body_from_mesh(file.rename(tmp_path / "block.obj"), units="m")


def test_units_of_another_type_are_refused(tmp_path: Path) -> None:
    for units in (["m"], "", "mm ", "km", "0 mm", "-1 mm", "nan mm", "inf m", "1e999 mm", "e mm",
                  "1 2 mm", 0.001):
        with pytest.raises(BodyError, match="one of m, cm, mm, in, or how long one unit"):
            body_from_table({"mesh": "block.stl", "units": units}, tmp_path)


def test_capitals_and_tabs_are_read(tmp_path: Path) -> None:
    box = trimesh.creation.box([0.04, 0.05, 0.06])
    (tmp_path / "a.stl").write_text(trimesh.exchange.stl.export_stl_ascii(box).upper())
    text = trimesh.exchange.obj.export_obj(box).replace("v ", "v\t").replace("f ", "f\t")
    (tmp_path / "a.obj").write_text(text)
    for name in ("a.stl", "a.obj"):
        vertices, faces = mesh_triangles(tmp_path / name, units="m")
        assert np.ptp(vertices, axis=0) == pytest.approx([0.04, 0.05, 0.06])
        assert len(faces) == 12


@pytest.mark.parametrize(("name", "content", "message"), [
    ("none.stl", None, "cannot be read"),
    ("empty.stl", b"", "empty"),
    ("text.ply", b"hello, world", "not a mesh|no faces"),
    ("polygons.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
     b"property float y\nproperty float z\nelement face 2\nproperty list uchar int "
     b"vertex_indices\nend_header\n" + bytes(48) + b"\3" + bytes(12) + b"\4" + bytes(16),
     "make triangles of polygons first"),
    ("many.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nelement face 1000000000\nend_header\n",
     "declares 1,000,000,000"),
    ("short.stl", trimesh.creation.box([40, 50, 60]).export(file_type="stl")[:-30],
     "declares 12 faces, for which a binary STL has 684 bytes; it has 654: is it cut short"),
])
def test_bad_files(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BodyError, match=message):
        body_from_mesh(tmp_path / name, units="m")


def test_a_damaged_cache_is_baked_again(tmp_path: Path) -> None:
    file = tmp_path / "rod.stl"
    trimesh.creation.box((0.006, 0.006, 0.12)).export(file)  # few nodes
    first = body_from_mesh(file, units="m")
    cached, = (tmp_path / "cache").rglob("*.grid")
    whole = cached.read_bytes()
    for damaged in (b"", b"not a zip", whole[:-1], whole[:700] + b"\xff" + whole[701:]):
        cached.write_bytes(damaged)
        assert body_from_mesh(file, units="m").content == first.content
        assert cached.read_bytes() == whole


@pytest.mark.slow
def test_meshes_like_scans_are_baked_to_what_they_are(tmp_path: Path) -> None:
    """The volume of the meshes is theirs, by the divergence theorem."""
    for name, mesh in scan_meshes().items():
        mesh.export(tmp_path / f"{name}.ply")
        body = body_from_mesh(tmp_path / f"{name}.ply", units="m")
        assert np.allclose(np.subtract(body.high_m, body.low_m), mesh.extents, atol=1e-6)
        assert sample_body(body).volume_m3 == pytest.approx(mesh.volume, rel=0.015), name
        assert body.grid_error_m < 0.0006


@pytest.mark.skipif(not YCB.is_dir(), reason="the scanned meshes lie beside the checkout")
def test_a_scanned_bottle() -> None:
    body = body_from_mesh(YCB / "mustard_bottle.ply", units="m")
    assert 0.15 < body.high_m[2] < 0.25
    assert body.grid_error_m < 0.0005
