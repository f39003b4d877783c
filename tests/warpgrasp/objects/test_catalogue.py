"""Objects of tables: what is ignored, cut or out of size is refused, and told by its name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warpgrasp.geometry.body import BodyError, distance_to_bodies, scene_of
from warpgrasp.objects.catalogue import body_from_name, body_from_table, profile_from_csv

EGG = {"size_mm": [30, 30, 40], "exponents": [1, 1]}


@pytest.mark.parametrize(("key", "value"), [
    ("rpy_deg", [0, 90, 0]), ("at_mm", [0, 0, 500]), ("join", "union"), ("shape", "superquadric")])
def test_a_superquadric_is_placed_in_compounds_alone(key: str, value: Any) -> None:
    with pytest.raises(BodyError, match=rf"outside a compound: unknown key '{key}'.*there are"):
        body_from_table({"name": "egg", "superquadric": {**EGG, key: value}}, Path())
    part = {"shape": "superquadric", **EGG, key: value}
    assert body_from_table({"name": "egg", "compound": [part]}, Path())


def test_a_superquadrics_size_is_half_its_extent() -> None:
    egg = body_from_table({"name": "egg", "superquadric": EGG}, Path())
    assert np.allclose(np.subtract(egg.high_m, egg.low_m), (0.06, 0.06, 0.08))


def test_a_tapered_superquadric_is_as_wide_as_its_wider_end() -> None:
    up = np.linspace(0.0, np.pi / 2, 100_000)  # of which the edge is round
    wide = 0.06 * (np.cos(up) ** 0.1 * (1.0 + 0.5 * np.sin(up) ** 0.1)).max()
    for taper in ([0.5, -0.5], [-0.5, 0.5]):
        table = {"name": "egg", "superquadric": {**EGG, "exponents": [0.1, 0.1], "taper": taper}}
        egg = body_from_table(table, Path())
        assert np.allclose(np.subtract(egg.high_m, egg.low_m), (wide, wide, 0.08), atol=1e-4)


@pytest.mark.parametrize("size_mm", [[40, 20, 20], [20, 40, 20], [20, 20, 40]])
def test_a_bend_does_not_fold_the_longest_side(size_mm: list[int]) -> None:
    folded = {"name": "egg", "superquadric": {
        "size_mm": size_mm, "exponents": [1, 1], "bend_per_m": 25.0}}
    with pytest.raises(BodyError, match=r"bend_per_m = 25 folds the body over; below 25 is right"):
        body_from_table(folded, Path())


def test_a_bend_does_not_fold_corners_of_a_tapered_side() -> None:
    """The widest section, by sampling: its corner lies towards the middle of the bend."""
    keys = {"size_mm": [30, 30, 30], "exponents": [0.2, 0.2], "taper": [1, 1], "bend_deg": 45}
    up, turn = np.meshgrid(np.linspace(0, 1, 400), np.linspace(0, np.pi / 2, 400))
    section = 0.03 * (1 + up) * (1 - up**10) ** 0.1
    corner = (section * (np.cos(turn) ** 0.2 + np.sin(turn) ** 0.2) / np.sqrt(2)).max()
    for share, folds in ((0.99, False), (1.01, True)):
        body = {"name": "egg", "superquadric": {**keys, "bend_per_m": share / corner}}
        if folds:
            with pytest.raises(BodyError, match="folds the body over"):
                body_from_table(body, Path())
        else:
            body_from_table(body, Path())


def test_a_capsule_holds_its_round_ends() -> None:
    pill = {"shape": "capsule", "radius_mm": 40, "height_mm": 50}
    with pytest.raises(BodyError, match=r"compound\[0\]: capsule: height_mm = 50 .* 80 or more"):
        body_from_table({"name": "pill", "compound": [pill]}, Path())
    ball = body_from_table({"name": "pill", "compound": [{**pill, "height_mm": 80}]}, Path())
    assert np.allclose(np.subtract(ball.high_m, ball.low_m), 0.08, atol=1e-4)


def profile_file(folder: Path, rows: str, encoding: str = "utf-8") -> Path:
    (folder / "vase.csv").write_text("z_mm,r_mm\n" + rows, encoding=encoding)
    return folder / "vase.csv"


@pytest.mark.parametrize(("rows", "size"), [
    ("0,0.04\n0.09,0.04", "0.08 x 0.08 x 0.09"),  # typed in metres
    ("0,900\n100,900", "1800 x 1800 x 100"),
    ("0,40\n5000,40", "80 x 80 x 5000"),
])
def test_profiles_out_of_size(tmp_path: Path, rows: str, size: str) -> None:
    profile_file(tmp_path, rows)
    said = f"urn: comes out at {size} mm; a longest side of 5 to 1000 mm"
    with pytest.raises(BodyError, match=said):
        body_from_table({"name": "urn", "profile": "vase.csv"}, tmp_path)
    with pytest.raises(BodyError, match="urn: comes out at"):
        body_from_table({"name": "urn", "compound": [
            {"shape": "revolution", "profile": "vase.csv"}]}, tmp_path)


@pytest.mark.parametrize("table", [
    {"superquadric": {"size_mm": [30, 30, 600], "exponents": [1, 1]}},
    {"superquadric": {"size_mm": [2, 2, 2], "exponents": [1, 1]}},
    {"compound": [{"shape": "sphere", "radius_mm": 2}]},
    {"compound": [{"shape": "block", "size_mm": [100, 100, 900]},
                  {"shape": "block", "size_mm": [100, 100, 900], "at_mm": [0, 0, 800]}]},
])
def test_formulas_out_of_size(table: dict[str, Any]) -> None:
    with pytest.raises(BodyError, match=r"big or small: comes out at .* 5 to 1000 mm"):
        body_from_table({"name": "big or small", **table}, Path())


@pytest.mark.parametrize("part", [
    {"shape": "block", "size_mm": [20, 20, 1000]}, {"shape": "sphere", "radius_mm": 2.5}])
def test_the_limits_of_size_themselves(part: dict[str, Any]) -> None:
    assert body_from_table({"name": "limit", "compound": [part]}, Path())


@pytest.mark.parametrize(("rows", "says"), [
    ("0,40\nnan,40", ":3: z_mm nan: a number from"), ("0,40\n1e308,40", r":3: z_mm 1e\+308: "),
    ("0,4_0\n90,40", ":2: '0,4_0': two numbers are wanted"),
    ("0,40\n90,nan", ":3: r_mm nan: a number from 0 to 1000"), ("0,-1\n90,40", ":2: r_mm -1: "),
    ("0,40\n40,40\n40,20", ":4: z_mm 40 after 40: z must rise; a step needs two heights, such as")])
def test_profiles_name_the_number_that_is_wrong(tmp_path: Path, rows: str, says: str) -> None:
    with pytest.raises(BodyError, match=says):
        profile_from_csv(profile_file(tmp_path, rows))


@pytest.mark.parametrize("rows", ["0,0\n50,0\n50.001,30\n100,30", "0,30\n50,30\n50.001,0\n90,0"])
def test_radii_of_zero_below_and_above_a_body_are_left_out(tmp_path: Path, rows: str) -> None:
    """It floated on a needle that was touched."""
    (tmp_path / "p.csv").write_text(f"z_mm,r_mm\n{rows}\n")
    body = body_from_table({"profile": "p.csv"}, tmp_path)
    assert body.low_m[2] == 0.0
    assert body.high_m[2] == pytest.approx(0.05, abs=1e-5)


def test_lobes_that_nothing_joins_are_refused(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("z_mm,r_mm\n0,30\n50,0\n90,0\n100,30\n")
    with pytest.raises(BodyError, match=r"p\.csv:4: r_mm is 0 here and in the row before"):
        body_from_table({"profile": "p.csv"}, tmp_path)


def test_a_tapered_superquadric_has_its_own_box(tmp_path: Path) -> None:
    """It was that of the untapered one times the taper, on both sides."""
    table = {"size_mm": [20, 60, 30], "exponents": [1, 1], "taper": [0.0, 0.9]}
    alone = body_from_table({"name": "a", "superquadric": table}, tmp_path)
    part = body_from_table({"name": "a", "compound": [table | {"shape": "superquadric"}]}, tmp_path)
    assert alone.high_m == pytest.approx(part.high_m, abs=1e-5)
    assert alone.high_m[1] < 0.08


@pytest.mark.parametrize(("at_mm", "size_mm"), [
    ([0, 0, -50], [60, 80, 50]), ([0, 0, 50], [60, 80, 50]), ([30, 0, 0], [30, 80, 100]),
    ([0, -40, 0], [60, 40, 100])])
def test_a_tool_that_is_flush_with_a_face_leaves_nothing_of_it(
        at_mm: list[float], size_mm: list[float]) -> None:
    """The formula is zero on the face that was cut away; the body floated, or lay off the axis."""
    block = {"shape": "block", "size_mm": [60, 80, 100]}
    body = body_from_table({"name": "half", "compound": [
        block, block | {"join": "difference", "at_mm": at_mm}]}, Path())
    size = 1e3 * np.subtract(body.high_m, body.low_m)
    assert size == pytest.approx(size_mm, abs=0.05)
    assert body.low_m[2] == 0.0
    assert np.add(body.low_m, body.high_m)[:2] == pytest.approx(0.0, abs=1e-9)
    inside, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int),
                                   np.array([[[0.0, 0.0, 1e-3]]]))
    assert inside[0, 0] == pytest.approx(-1e-3, abs=3e-5)


def test_a_profile_as_excel_writes_it(tmp_path: Path) -> None:
    assert len(profile_from_csv(profile_file(tmp_path, "0,40\n90,40", "utf-8-sig"))) == 2


def test_one_limit_of_names(tmp_path: Path) -> None:
    assert body_from_table({"name": "n" * 80, "superquadric": EGG}, tmp_path)
    with pytest.raises(BodyError, match="1 to 80 characters"):
        body_from_table({"name": "n" * 81, "superquadric": EGG}, tmp_path)


def test_tables_may_hold_what_python_has_for_lists_and_numbers(tmp_path: Path) -> None:
    plain = {"name": "post", "compound": [{"shape": "block", "size_mm": [30, 30, 40]}]}
    numpy = {"name": "post", "compound": ({"shape": "block", "size_mm": np.array([30, 30, 40])},)}
    body, same = (body_from_table(plain, tmp_path), body_from_table(numpy, str(tmp_path)))
    assert (body.low_m, body.high_m) == (same.low_m, same.high_m)
    assert body_from_table({"object": "block", "stable_pose": np.int64(1)}, "").high_m[2] < 0.1
    for wrong in ("block", None, [plain]):
        with pytest.raises(BodyError, match="a table such as"):
            body_from_table(wrong, tmp_path)  # type: ignore[arg-type]
    with pytest.raises(BodyError, match="an object's name is 3: a text such as"):
        body_from_name(3)  # type: ignore[arg-type]
