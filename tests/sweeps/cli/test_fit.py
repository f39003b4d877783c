"""`warpgrasp fit` from CSV to CSV, by the command line."""

import re
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from touch_files import read, write

from fit.superquadric.geometry import superquadric, superquadric_surface
from sweeps.cli import main as cli
from sweeps.cli.tools import fit_points as fit_command

SUPERQUADRIC = ["set", "n", "a1_m", "a2_m", "a3_m", "eps1", "eps2", "px_m", "py_m", "pz_m", "qx",
                "qy", "qz", "qw", "kx", "ky", "bend_per_m", "bend_angle_rad", "rms_mm",
                "iterations", "status"]
PLANE = ["set", "n", "nx", "ny", "nz", "offset_m", "rms_mm", "extent_u_m", "extent_v_m", "status"]
REVOLUTION = ["set", "n", "px_m", "py_m", "pz_m", "ax", "ay", "az", "height_m", "volume_m3",
              "rms_mm", "status"]


def touches(seed: int) -> np.ndarray:
    """Sixty touches on an upright cylinder 60 mm wide and 100 mm high on the table [m]."""
    body = superquadric([0.03, 0.03, 0.05], [0.1, 1.0], [0.45, 0.0, 0.05])
    points = superquadric_surface(body, 2000)[0][0]
    rng = np.random.default_rng(seed)
    return points[rng.choice(len(points), 60)] + 2e-4 * rng.normal(size=(60, 3))


@pytest.fixture
def points(tmp_path: Path) -> Path:
    """Two good sets, and between them a flat one, one with infinity and one of three touches."""
    good, inf = touches(1), touches(2)
    inf[5, 1] = np.inf
    return write(tmp_path / "points.csv", {
        "a": good, "flat": good * [1, 1, 0], "inf": inf, "few": good[:3], "b": touches(3)})


def test_superquadrics_and_what_became_of_bad_sets(
        tmp_path: Path, points: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, figure = tmp_path / "fits.csv", tmp_path / "fits.png"
    arguments = ["fit", "superquadric", str(points), "--table-z", "0", "-o", str(out)]
    assert cli.run([*arguments, "--figure", str(figure)]) == 0
    printed = capsys.readouterr()
    assert printed.out.split() == [str(out), str(figure)]
    assert "5 sets: 2 converged, 1 degenerate_plane, 1 bad_points, 1 too_few" in printed.err
    header, rows = read(out)
    assert header == SUPERQUADRIC
    assert [row["set"] for row in rows] == ["a", "flat", "inf", "few", "b"]
    for row in (rows[0], rows[4]):
        assert float(row["a3_m"]) == pytest.approx(0.05, abs=2e-3)
        assert (float(row["eps1"]), float(row["eps2"])) == pytest.approx((0.1, 1.0), abs=0.15)
        assert row["n"] == "60"
    assert figure.read_bytes().startswith(b"\x89PNG")
    drawn = figure.read_bytes()
    assert cli.run([*arguments, "--figure", str(figure)]) == 0
    assert figure.read_bytes() == drawn

    alone = tmp_path / "alone.csv"
    only = write(tmp_path / "only.csv", {"b": touches(3)})
    assert cli.run([*arguments[:2], str(only), *arguments[3:5], "-o", str(alone)]) == 0
    assert alone.read_text().splitlines()[1] == out.read_text().splitlines()[5]


def test_planes_and_revolutions(tmp_path: Path, points: Path) -> None:
    out = tmp_path / "planes.csv"
    assert cli.run(["fit", "plane", str(points), "-o", str(out),
                    "--figure", str(tmp_path / "planes.svg")]) == 0
    header, rows = read(out)
    assert header == PLANE
    assert abs(float(rows[1]["nz"])) == pytest.approx(1)
    assert float(rows[1]["offset_m"]) == pytest.approx(0, abs=1e-9)
    assert [rows[2]["status"], rows[3]["status"]] == ["bad_points", "converged"]

    out = tmp_path / "round.csv"
    assert cli.run(["fit", "revolution", str(points), "--table-z", "0", "-o", str(out),
                    "--figure", str(tmp_path / "round.pdf")]) == 0
    header, rows = read(out)
    assert header == REVOLUTION
    assert float(rows[0]["volume_m3"]) == pytest.approx(np.pi * 0.03**2 * 0.1, rel=0.05)
    header, nodes = read(tmp_path / "round.profile.csv")
    assert header == ["set", "z_m", "radius_m", "radius_std_m"]
    assert [node["set"] for node in nodes[::8]] == ["a", "flat", "inf", "few", "b"]
    assert float(nodes[4]["radius_m"]) == pytest.approx(0.03, abs=2e-3)


def test_a_touch_that_no_fit_can_use_is_no_hindrance_to_the_figure(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    far = touches(1)
    far[3] = 1e300
    csv_path = write(tmp_path / "far.csv", {"a": far})
    arguments = ["fit", "plane", str(csv_path), "-o", str(tmp_path / "out.csv")]
    assert cli.run([*arguments, "--units", "m", "--figure", str(tmp_path / "out.svg")]) == 0
    assert read(tmp_path / "out.csv")[1][0]["status"] == "bad_points"
    assert cli.run(arguments) == 2
    assert "the points of set a are inf m across" in capsys.readouterr().err


@pytest.mark.parametrize(("factor", "told"), [
    (1.0, False), (-1.0, True), (1e300, False), (-1e300, True)])
def test_normals_that_point_into_the_body_are_told(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], factor: float, told: bool) -> None:
    rng = np.random.default_rng(4)
    unit = rng.normal(size=(60, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    flat = np.c_[0.05 * rng.normal(size=(60, 2)), 3e-4 * rng.normal(size=60)]
    rows = [("ball", 0.04 * unit, unit), ("face", flat, np.tile([0.0, 0.0, 1.0], (60, 1)))]
    path = tmp_path / "points.csv"
    path.write_text("set,x_m,y_m,z_m,nx,ny,nz\n" + "".join(
        ",".join(map(str, [name, *p, *(factor * n)])) + "\n"
        for name, points, normals in rows for p, n in zip(points, normals, strict=True)))
    assert cli.run(["fit", "superquadric", str(path), "-o", str(tmp_path / "fits.csv")]) == 0
    said = capsys.readouterr().err
    assert ("most normals of ball point to the middle" in said) == told
    assert "of face" not in said
    assert "Warning" not in said
    _, found = read(tmp_path / "fits.csv")
    assert told or float(found[0]["rms_mm"]) < 0.2


@pytest.mark.parametrize(("text", "arguments", "says"), [
    ("x_m,y_m\n1,2\n", [], "points.csv:1: z_m: column is missing"),
    ("x_m,y_m,z_m\n1,two,3\n4,5,1_0\n", [], "points.csv:3: z_m: '1_0' is not a number"),
    ("x_m,y_m,z_m\n1,2\n", [], "points.csv:2: 2 cells, should be 3"),
    (b"\xff\xfe\x00", [], "is not CSV text in UTF-8"),
    (None, [], "points.csv: cannot be read"),
    ("x_m,y_m,z_m\n1,2,3\n", ["--table-z", "nan"], "--table-z: is nan; should be a finite"),
    ("x_m,y_m,z_m\n1,2,3\n", ["--figure", "fits.txt"], "--figure: fits.txt: should end in .png"),
    ("x_m,y_m,z_m\n1,2,3\n", ["-o", "POINTS"], "a file is named twice"),
    ("x_m,y_m,z_m\n1,2,3\n", ["-o", "none/fits.csv"], "there is no folder none"),
    ("x_m,y_m,z_m\n1,2,3\n", ["-o", "."], "is a folder"),
])
def test_what_cannot_be_used_ends_with_2_and_says_where(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | bytes | None,
        arguments: list[str], says: str) -> None:
    path = tmp_path / "points.csv"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    given = [str(path) if a == "POINTS" else a for a in arguments]
    default = [] if "-o" in given else ["-o", str(tmp_path / "fits.csv")]
    assert cli.run(["fit", "superquadric", str(path), *default, *given]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert says in printed.err
    assert not (tmp_path / "fits.csv").exists()


def test_contours_that_cannot_be_written_are_told_before_anything_is(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points, out = write(tmp_path / "points.csv", {"a": touches(1)}), tmp_path / "fits.csv"
    (tmp_path / "fits.profile.csv").mkdir()
    assert cli.run(["fit", "revolution", str(points), "-o", str(out)]) == 2
    assert "fits.profile.csv: cannot be written: it is a folder" in capsys.readouterr().err
    assert not out.exists()


def test_options_of_another_shape_are_refused(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["fit", "plane", "points.csv", "--taper", "--table-z", "0",
                    "-o", str(tmp_path / "fits.csv")]) == 2
    printed = capsys.readouterr().err
    assert "--taper: is for superquadric, not for plane" in printed
    assert "--table-z: is for solid shapes, not for plane" in printed
    assert cli.run(["fit", "sphere", "points.csv", "-o", "fits.csv"]) == 2


@pytest.mark.parametrize(("table", "says"), [
    ("0.2", "below it"), ("0.04", "below it"), ("-3", "far above it")])
def test_a_table_that_no_touches_stand_on_is_refused(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, says: str) -> None:
    points = write(tmp_path / "points.csv", {"a": touches(1), "b": touches(2)})
    out = tmp_path / "fits.csv"
    assert cli.run(["fit", "superquadric", str(points), f"--table-z={table}", "-o", str(out)]) == 2
    assert says in capsys.readouterr().err
    assert not out.exists()


def test_how_sure_normals_are_can_be_said(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The surer, the more they count; and only a number of degrees will do."""
    rng = np.random.default_rng(6)
    box = rng.uniform(-1.0, 1.0, (60, 3))
    row, axis = np.arange(60), np.arange(60) % 3
    box[row, axis] = np.where(rng.random(60) < 0.5, -1.0, 1.0)
    way = np.zeros((60, 3))
    way[row, axis] = box[row, axis]
    felt = 0.04 * box + [0, 0, 0.04] + 1e-3 * rng.normal(size=(60, 3))
    lines = np.c_[felt, way + 0.15 * rng.normal(size=(60, 3))]
    path, out = tmp_path / "points.csv", tmp_path / "fits.csv"
    path.write_text("x_m,y_m,z_m,nx,ny,nz\n" + "".join(
        ",".join(map(str, line)) + "\n" for line in lines))
    size = []
    for degrees in ("0", "9"):
        assert cli.run(["fit", "superquadric", str(path), "--table-z", "0", "--normal-deg", degrees,
                        "-o", str(out)]) == 0
        size.append(np.prod([float(read(out)[1][0][f"a{k}_m"]) for k in (1, 2, 3)]))
    assert size[0] < 0.99 * size[1]
    assert size[1] == pytest.approx(0.04**3, rel=0.03)
    capsys.readouterr()
    for shape, degrees, says in (("plane", "3", "is for superquadric, not for plane"),
                                 ("superquadric", "-1", "is -1; should be a number of degrees"),
                                 ("superquadric", "nan", "is nan; should be")):
        assert cli.run(["fit", shape, str(path), f"--normal-deg={degrees}", "-o", str(out)]) == 2
        assert f"--normal-deg: {says}" in capsys.readouterr().err


def test_one_set_below_the_table_is_told_and_the_others_fitted(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = write(tmp_path / "points.csv", {"a": touches(1), "low": touches(2) - [0, 0, 0.2]})
    out = tmp_path / "fits.csv"
    assert cli.run(["fit", "superquadric", str(points), "--table-z", "0", "-o", str(out)]) == 0
    assert "touches of low lie below it" in capsys.readouterr().err
    assert [row["set"] for row in read(out)[1]] == ["a", "low"]


def test_touches_without_a_coordinate_are_left_out_and_told(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    holes, lost = touches(1), touches(2)
    holes[[5, 9], 1] = np.nan
    lost[:] = np.nan
    out, alone = tmp_path / "fits.csv", tmp_path / "alone.csv"
    points = write(tmp_path / "points.csv", {"a": holes, "lost": lost})
    assert cli.run(["fit", "superquadric", str(points), "--table-z", "0", "-o", str(out)]) == 0
    said = capsys.readouterr().err
    assert "touches with a missing coordinate are left out: 2 of set a, 60 of set lost\n" in said
    header, rows = read(out)
    assert [(row["n"], row["status"]) for row in rows] == [("58", "converged"),
                                                           ("0", "too_few_points")]
    whole = write(tmp_path / "whole.csv", {"a": np.delete(touches(1), [5, 9], axis=0)})
    assert cli.run(["fit", "superquadric", str(whole), "--table-z", "0", "-o", str(alone)]) == 0
    assert read(alone) == (header, rows[:1])


def test_fits_far_off_their_touches_come_with_advice(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = np.concatenate([touches(1), touches(2) + [0.12, 0.0, 0.0]])  # bodies side by side
    arguments = ["fit", "superquadric", str(write(tmp_path / "p.csv", {"two": two})),
                 "--table-z", "0", "-o", str(tmp_path / "fits.csv")]
    assert cli.run(arguments) == 0
    said = capsys.readouterr().err
    assert said.startswith("1 set: ")
    assert "(rms): two (" in said
    assert "try --robust; if the body is no superquadric, `warpgrasp fit implicit`" in said
    assert cli.run([*arguments, "--robust"]) == 0
    assert "try --robust" not in capsys.readouterr().err
    write(tmp_path / "p.csv", {"one": touches(1)})
    assert cli.run(arguments) == 0
    assert capsys.readouterr().err == "1 set: 1 converged\n"


def test_sets_far_above_the_table_that_was_given_are_named(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A body 0.1 m high came out 0.4 m high, for it stands on the table."""
    sets = {"up": touches(1) + [0.0, 0.0, 0.3], "down": touches(1)}
    arguments = ["fit", "superquadric", str(write(tmp_path / "p.csv", sets)),
                 "-o", str(tmp_path / "fits.csv")]
    assert cli.run([*arguments, "--table-z", "0"]) == 0
    said = capsys.readouterr().err
    assert "no touch lies in the lower half" in said
    assert re.search(r"to the table: up \(from (299|30\d) mm on\); check --table-z", said)
    for right in (["--table-z", "0.29"], []):
        assert cli.run([*arguments, *right]) == 0
        assert "lower half" not in capsys.readouterr().err.replace("down (", "")


def test_bodies_touched_on_one_side_or_hardly_at_all_are_named(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    around = touches(1)
    sets = {"around": around, "side": around[around[:, 0] < 0.44],
            "patch": around[around[:, 0] < 0.44] * [1.0, 0.1, 0.1], "few": around[:8]}
    arguments = [str(write(tmp_path / "p.csv", sets)), "-o", str(tmp_path / "fits.csv")]
    assert cli.run(["fit", "superquadric", *arguments]) == 0
    said = capsys.readouterr().err
    assert "leave a side open, so that volumes may be far off: side, patch, few; " in said
    assert "touch all around, or give --table-z\n" in said
    assert cli.run(["fit", "superquadric", *arguments, "--table-z", "0"]) == 0
    said = capsys.readouterr().err
    assert "; touch all around\n" in said
    assert "--table-z" not in said  # it is given
    assert cli.run(["fit", "revolution", *arguments]) == 0
    said = capsys.readouterr().err
    assert "one side of the axis, which they tell badly: side" in said
    assert "around" not in said.split("one side of the axis")[1].splitlines()[0]


@pytest.mark.parametrize("table", [[], ["--table-z", "0"]])
def test_contours_of_touches_in_one_plane_are_named(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], table: list[str]) -> None:
    rng = np.random.default_rng(6)
    turn, share = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.0, 1.0, 60)
    way = np.stack([np.cos(turn), np.sin(turn), np.zeros(60)], axis=1)
    top = 0.04 * np.sqrt(share)[:, None] * way + [0.0, 0.0, 0.05]
    side = 0.04 * way + 0.05 * share[:, None] * [0.0, 0.0, 1.0]
    sets = {"top": top, "tilted": top @ [[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]] + [0, 0, 0.05],
            "side": side, "both": np.concatenate([top, side])}
    sets = {name: points + 3e-4 * rng.normal(size=points.shape) for name, points in sets.items()}
    arguments = [str(write(tmp_path / "p.csv", sets)), "-o", str(tmp_path / "fits.csv")]
    assert cli.run(["fit", "revolution", *arguments, *table]) == 0
    assert "lie in one plane, which tells no contour: top, tilted; " in capsys.readouterr().err


def test_contours_that_end_beyond_their_touches_and_steps_are_named(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Beyond the last touch nothing tells a height: some fits stop there, and others do not."""
    rng = np.random.default_rng(5)
    z, turn = rng.uniform(0.0, 0.12, (24, 72)), rng.uniform(-np.pi, np.pi, (24, 72))
    way = np.stack([np.cos(turn), np.sin(turn)], axis=2)
    straight = np.concatenate([0.035 * way, z[..., None]], axis=2)
    straight += 1e-4 * rng.normal(size=straight.shape)
    step = np.concatenate([np.where(z < 0.06, 0.04, 0.02)[..., None] * way, z[..., None]], axis=2)
    sets = {f"c{k}": points for k, points in enumerate(straight)} | {"step": step[0]}
    out = tmp_path / "fits.csv"
    assert cli.run(["fit", "revolution", str(write(tmp_path / "p.csv", sets)), "--table-z", "0",
                    "-o", str(out)]) == 0
    said = capsys.readouterr().err
    poor, beyond = (next(line for line in said.splitlines() if words in line)
                    for words in ("(rms): step (", "bodies end beyond their last touches"))
    assert "steps and edges of a contour are rounded" in poor
    for index, row in enumerate(read(out)[1][:24]):
        over = float(row["height_m"]) / straight[index, :, 2].max() - 1.0
        if abs(over - 0.04) > 0.005:
            assert (f"c{index} (" in beyond) == (over > 0.04), row


def test_planes_of_touches_along_a_line_are_named(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(4)
    face = rng.uniform(-0.5, 0.5, (40, 3)) * [0.06, 0.04, 0.0]
    sets = {"face": face, "line": face * [1.0, 0.02, 0.0], "ends": np.sign(face) * [0.02, 0, 0],
            "three": face[:3]}
    errors = {name: 0.001 * rng.normal(size=points.shape) for name, points in sets.items()}
    points = write(tmp_path / "p.csv", {name: sets[name] + errors[name] for name in sets})
    assert cli.run(["fit", "plane", str(points), "-o", str(tmp_path / "fits.csv")]) == 0
    assert "10 degrees and more: line, ends, three\n" in capsys.readouterr().err


def test_a_name_is_no_formula(tmp_path: Path) -> None:
    points = write(tmp_path / "points.csv", {"trial $\\alpha_{$": touches(1)})
    out, figure = tmp_path / "fits.csv", tmp_path / "fits.png"
    assert cli.run(["fit", "superquadric", str(points), "--table-z", "0", "-o", str(out),
                    "--figure", str(figure)]) == 0
    assert figure.exists()


def test_a_touch_of_no_set_is_an_error(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = write(tmp_path / "points.csv", {"a": touches(1), "": touches(2)})
    assert cli.run(["fit", "plane", str(points), "-o", str(tmp_path / "fits.csv")]) == 2
    assert "points.csv:62: set: is empty" in capsys.readouterr().err


@pytest.mark.slow
def test_fits_shared_out_over_processes_are_the_same_bytes(
        tmp_path: Path, points: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the set that cannot be fitted in either part, and parts that are not full."""
    alone, shared = tmp_path / "alone.csv", tmp_path / "shared.csv"
    assert cli.run(["fit", "superquadric", str(points), "-o", str(alone)]) == 0
    monkeypatch.setattr(fit_command, "SETS_A_PROCESS", 2)
    monkeypatch.setattr(fit_command, "core_count", lambda: 2)
    started: list[int] = []
    pool = fit_command.ProcessPoolExecutor

    def counted(workers: int, context: BaseContext) -> ProcessPoolExecutor:
        started.append(workers)
        return pool(workers, context)

    monkeypatch.setattr(fit_command, "ProcessPoolExecutor", counted)
    assert cli.run(["fit", "superquadric", str(points), "-o", str(shared)]) == 0
    assert started == [2]
    assert alone.read_bytes() == shared.read_bytes()


def test_small_sets_are_not_padded_to_a_large_one_among_them(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows keep their order, and each is that of the set alone."""
    rng = np.random.default_rng(3)
    sizes = [12, 3, 900, 40, 12, 2, 33]
    sets = {f"s{k}": rng.normal(size=(n, 3)) * [0.04, 0.03, 0.001] for k, n in enumerate(sizes)}
    slots: list[int] = []
    one = fit_command.fit_padded

    def counted(shape: str, part: tuple, **options: Any) -> Any:
        slots.append(part[1].size)
        return one(shape, part, **options)

    monkeypatch.setattr(fit_command, "fit_padded", counted)
    out = tmp_path / "planes.csv"
    assert cli.run(["fit", "plane", str(write(tmp_path / "all.csv", sets)), "-o", str(out)]) == 0
    assert sum(slots) < 2 * sum(sizes)
    rows = read(out)[1]
    assert [row["set"] for row in rows] == list(sets)
    for row in rows:
        only = write(tmp_path / "one.csv", {row["set"]: sets[row["set"]]})
        assert cli.run(["fit", "plane", str(only), "-o", str(out)]) == 0
        assert read(out)[1] == [row]
