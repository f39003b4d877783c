"""Meshes: a baked block against the formula, and every kind of bad file refused with its mend."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from warpgrasp.body import BodyError, distance_to_bodies, scene_of
from warpgrasp.catalogue import body_from_name
from warpgrasp.mesh_intake import body_from_mesh

YCB = Path(__file__).parents[3] / "shared" / "objects" / "ycb"


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
    assert baked.grid_error_m < 0.5 * cell
    assert (d - exact)[exact > 0.02].max() < 0.5 * cell  # outside the grid: a lower bound
    assert body_from_mesh(block_file(tmp_path), units="m").content == baked.content  # from cache


def test_units_scale_and_content_tells_bodies_apart(tmp_path: Path) -> None:
    metres = body_from_mesh(block_file(tmp_path), units="m")
    millimetres = body_from_mesh(block_file(tmp_path, 1000.0, "mm.stl"), units="mm")
    assert np.allclose(metres.high_m, millimetres.high_m, atol=1e-6)
    other = body_from_mesh(block_file(tmp_path, 0.5, "half.stl"), units="m")
    assert other.content != metres.content


def test_a_mug_of_160_metres(tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=r"120 m long.*in mm it would fit"):
        body_from_mesh(block_file(tmp_path, 1000.0), units="m")


def test_an_open_mesh_says_what_is_open_and_how_to_mend_it(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.06, 0.08, 0.12))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "open.ply")
    with pytest.raises(BodyError, match=r"open: 3 edges border one face.*fill_holes"):
        body_from_mesh(tmp_path / "open.ply", units="m")


@pytest.mark.parametrize(("name", "content", "message"), [
    ("none.stl", None, "cannot be read"),
    ("empty.stl", b"", "empty"),
    ("text.ply", b"hello, world", "not a mesh|no faces"),
    ("many.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nelement face 1000000000\nend_header\n",
     "declares 1,000,000,000"),
])
def test_bad_files(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BodyError, match=message):
        body_from_mesh(tmp_path / name, units="m")


def test_a_damaged_cache_is_baked_again(tmp_path: Path) -> None:
    file = block_file(tmp_path)
    first = body_from_mesh(file, units="m")
    for cached in (tmp_path / "cache").rglob("*.npz"):
        cached.write_bytes(b"not a zip")
    assert body_from_mesh(file, units="m").content == first.content


@pytest.mark.skipif(not YCB.is_dir(), reason="the scanned meshes lie beside the checkout")
def test_a_scanned_bottle() -> None:
    body = body_from_mesh(YCB / "mustard_bottle.ply", units="m")
    assert 0.15 < body.high_m[2] < 0.25
    assert body.grid_error_m < 0.0005
