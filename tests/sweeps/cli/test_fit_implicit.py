"""`warpgrasp fit implicit`: free forms from CSV to CSV and to meshes."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from touch_files import read, write

from fit.implicit.record import FreeForms, TriangleMesh
from fit.point_sets import PointSets
from sweeps.cli import main as cli
from sweeps.cli.tools import fit_points as fit_command
from sweeps.cli.tools.fit_advice import free_form_advice
from sweeps.figures.fits import draw_fits

IMPLICIT = ["set", "n", "volume_m3", "volume_low_m3", "volume_high_m3", "std_mm", "gap_mm",
            "rms_mm", "status"]
HALF_M = np.array([0.03, 0.04, 0.06])


def ellipsoid(seed: int, count: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Touches all over an ellipsoid, 80 mm above the base, and outward normals there."""
    way = np.random.default_rng(seed).normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    normal = way / HALF_M
    return way * HALF_M + [0.4, 0.0, 0.08], normal / np.linalg.norm(normal, axis=1, keepdims=True)


def test_free_forms_with_their_surfaces_and_what_is_guessed_of_them(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = ellipsoid(1)[0]
    above = ellipsoid(2, 200)[0]
    sets = {"a/b": whole, "a b": np.concatenate([whole, whole[:30]]), "few": whole[:3],
            "half": above[above[:, 2] > 0.08][:48]}
    out, meshes, figure = tmp_path / "fits.csv", tmp_path / "found" / "meshes", tmp_path / "f.svg"
    arguments = ["fit", "implicit", str(write(tmp_path / "p.csv", sets)), "-o", str(out)]
    assert cli.run([*arguments, "--meshes", str(meshes), "--figure", str(figure)]) == 0
    printed = capsys.readouterr()
    assert printed.out.split() == [str(out), str(figure), str(meshes)]
    header, rows = read(out)
    assert header == IMPLICIT
    true = 4.0 / 3.0 * np.pi * HALF_M.prod()
    assert float(rows[0]["volume_m3"]) == pytest.approx(true, rel=0.05)
    assert float(rows[0]["volume_low_m3"]) < true < float(rows[0]["volume_high_m3"])
    assert {**rows[1], "set": "a/b"} == rows[0]  # copies of touches tell nothing more
    assert rows[2]["status"] == "too_few_points"
    assert [rows[2][key] for key in IMPLICIT[2:7]] == ["NA"] * 5
    # The middle of the open side is as far from any touch as the body is wide.
    assert float(rows[3]["gap_mm"]) == pytest.approx(1e3 * HALF_M[0], rel=0.25)
    assert re.search(r"leave a side open.*: half \(up to \d+ mm from any touch\);", printed.err)

    assert sorted(path.name for path in meshes.iterdir()) == [
        "1-a_b.ply", "2-a_b.ply", "4-half.ply"]
    mesh = trimesh.load_mesh(meshes / "1-a_b.ply")
    assert mesh.is_watertight
    assert float(mesh.volume) == pytest.approx(true, rel=0.05)
    assert mesh.bounds.mean(axis=0) == pytest.approx([0.4, 0.0, 0.08], abs=3e-3)
    assert b"rms" in figure.read_bytes()


def test_normals_of_free_forms_point_outwards(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points, normal = ellipsoid(3, 32)
    lines = [f"{name}," + ",".join(map(str, row)) for name, sign in (("out", 1.0), ("in", -1.0))
             for row in np.hstack([points, sign * normal]).tolist()]
    file = tmp_path / "points.csv"
    file.write_text("\n".join(["set,x_m,y_m,z_m,nx,ny,nz", *lines]) + "\n")
    assert cli.run(["fit", "implicit", str(file), "-o", str(tmp_path / "fits.csv")]) == 0
    said = capsys.readouterr().err
    assert "most normals of in point to the middle of its touches; they should point out" in said
    assert "normals of out" not in said


def test_a_free_form_without_a_surface_is_drawn_and_named() -> None:
    points = ellipsoid(4)[0]
    sets = PointSets(("alone",), points, np.array([len(points)]))
    empty = np.array([None], object)
    empty[0] = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    nan = np.full(1, np.nan)
    found = FreeForms(empty, nan, np.full((1, 2), np.nan), nan, nan, nan, np.zeros(1),
                      np.array([len(points)]), np.zeros(1, int))
    assert draw_fits(sets, found, "png").startswith(b"\x89PNG")
    said, = free_form_advice(sets.names, found)
    assert said.startswith("no surface is left of alone")


def test_meshes_are_of_free_forms(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points, out = write(tmp_path / "points.csv", {"a": ellipsoid(1)[0]}), tmp_path / "fits.csv"
    assert cli.run(["fit", "plane", str(points), "-o", str(out), "--meshes", str(tmp_path)]) == 2
    assert "--meshes: is for implicit, not for plane" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_free_forms_shared_out_over_processes_are_the_same_bytes(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = write(tmp_path / "p.csv", {f"set {k}": ellipsoid(k)[0] for k in range(5)})
    alone, shared = tmp_path / "alone", tmp_path / "shared"
    for folder, share in ((alone, 1024), (shared, 2)):
        monkeypatch.setattr(fit_command, "SETS_A_PROCESS", share)
        monkeypatch.setattr(fit_command, "core_count", lambda: 2)
        assert cli.run(["fit", "implicit", str(points), "-o", str(tmp_path / f"{folder.name}.csv"),
                        "--meshes", str(folder)]) == 0
    assert (tmp_path / "alone.csv").read_bytes() == (tmp_path / "shared.csv").read_bytes()
    assert len(list(alone.iterdir())) == 5
    for file in alone.iterdir():
        assert file.read_bytes() == (shared / file.name).read_bytes()
