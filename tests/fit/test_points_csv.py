"""Reading sets of touches, with every mistake named; writing the contract's rows."""

import csv

import numpy as np
import pytest

from fit.plane import fit_plane
from fit.points_csv import ROWS_AT_ONCE, PointsError, plane_rows, read_points, rows_csv


def test_sets_in_any_order_with_some_normals(tmp_path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("set,x_m,y_m,z_m,nx,ny,nz\nb,1,2,3,0,0,1\na,4,5,6,,,\nb,7,8,9,NA,NA,NA\n")
    sets = read_points(path, units="m")
    assert sets.names == ("b", "a")
    assert sets.count.tolist() == [2, 1]
    assert sets.touches_m[sets.slots(0)].tolist() == [[1, 2, 3], [7, 8, 9]]
    assert sets.normals is not None
    assert np.isfinite(sets.normals).all(axis=1).tolist() == [True, False, False]


def test_without_a_set_column_there_is_one_set(tmp_path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x_m,y_m,z_m\n1,2,3\n\n4,5,6\n")
    sets = read_points(path, units="m")
    assert sets.count.tolist() == [2]
    assert sets.normals is None


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_columns_name_their_unit(tmp_path, unit, scale) -> None:
    path = tmp_path / "points.csv"
    points = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    rows = "".join("{},{},{}\n".format(*row) for row in points / scale)
    path.write_text(f"x_{unit},y_{unit},z_{unit}\n{rows}")
    assert np.allclose(read_points(path).touches_m, points)


def test_millimetres_in_columns_of_metres_are_refused_unless_units_are_given(tmp_path) -> None:
    """They used to end as a converged body of 163 m."""
    path = tmp_path / "points.csv"
    path.write_text("set,x_m,y_m,z_m\na,0.01,0,0\na,0.05,0.02,0.03\nb,10,0,5\nb,80,30,20\n")
    with pytest.raises(PointsError, match=r"set b are 77.6 m across.*--units mm"):
        read_points(path)
    assert read_points(path, units="mm").touches_m[3].tolist() == [0.08, 0.03, 0.02]
    assert read_points(path, units="m").touches_m[3].tolist() == [80, 30, 20]


def test_metres_in_columns_of_millimetres_are_refused_unless_units_are_given(tmp_path) -> None:
    path = tmp_path / "points.csv"
    head = "set,x_mm,y_mm,z_mm\na,0.45,0,0\na,0.45,0,0\nb,0.43,0,0.02\nb,0.47,0.03,0.05\n"
    path.write_text(head)
    with pytest.raises(PointsError, match=r"x_mm: the points of no set are more than 5.83e-05 m"):
        read_points(path)
    assert read_points(path, units="m").touches_m[3].tolist() == [0.47, 0.03, 0.05]
    assert read_points(path, units="mm").touches_m[3, 2] == pytest.approx(5e-5)
    path.write_text(head + "c,440,0,0\nc,440,0,7\n")  # one set is of a size to be touched
    assert read_points(path).names == ("a", "b", "c")
    path.write_text("x_m,y_m,z_m\n0.4,0,0.1\n0.4,0,0.1\n")  # one place says nothing of the unit
    assert len(read_points(path).names) == 1


@pytest.mark.parametrize(("text", "said"), [
    ("x_m,y_m\n1,2\n", "points.csv:1: z_m: column is missing"),
    ("x_m,y_m,z_m\n1,two,3\n4,5,six\n", "points.csv:2: y_m: 'two' is not a number"),
    ("x_m,y_m,z_m\n1,2\n", "points.csv:2: 2 cells, should be 3"),
    ("x_m,y_m,z_m\n", "points.csv:2: no points"),
    ("", "points.csv:1: x_m, x_cm or x_mm: column is missing; there are: none"),
    ("x,y,z\n1,2,3\n", "there are: x, y, z. Columns x, y, z need --units m, cm or mm"),
    ("X_mm,Y_mm,Z_mm\n1,2,3\n", "points.csv:1: x_m, x_cm or x_mm: column is missing; there are: X"),
    ("x_mm;y_mm;z_mm\n1;2;3\n", "separated by commas, not by semicolons"),
    ("x_mm\ty_mm\tz_mm\n1\t2\t3\n", "separated by commas, not by tabs"),
    ("x_mm y_mm z_mm\n1 2 3\n", "separated by commas, not by spaces"),
    ("\nx_mm,y_mm,z_mm\n1,2,3\n", "there are: none. Line 1 should name the columns, such as"),
    ("1,2,3\n4,5,6\n", "there are: 1, 2, 3. Line 1 should name the columns, such as x_m,y_m,z_m"),
    ("# of a mug\nx_mm,y_mm,z_mm\n1,2,3\n", "delete comments above them"),
    ("x_mm,y_mm,z_mm\n1,2,?\n", "z_mm: '?' is not a number; write millimetres such as 42.5"),
    ("x_m,y_m,z_m,nx,ny,nz\n1,2,3,0,0,?\n", "nz: '?' is not a number; write a number such as"),
    ("x_m,y_m,z_m\n1,,3\nNA,5,6\n", "points.csv:2: no points"),
    ("x_m,y_m,z_m,x_mm,y_mm,z_mm\n1,2,3,4,5,6\n", "x_m and x_mm: touches in two units"),
    ("x_m,y_m,z_m,nx\n1,2,3,0\n", "points.csv:1: nx: a normal needs all of nx, ny, nz"),
])
def test_mistakes_name_the_line(tmp_path, text, said) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(PointsError) as error:
        read_points(path)
    assert said in str(error.value)


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_plain_columns_with_a_unit_given(tmp_path, unit, scale) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x,y,z\n1,2,3\n4,5,6\n")
    assert np.allclose(read_points(path, units=unit).touches_m, scale * np.array([
        [1, 2, 3], [4, 5, 6]]))
    path.write_text("x,y\n1,2\n")
    with pytest.raises(PointsError, match="1: z: column is missing"):
        read_points(path, units=unit)


@pytest.mark.parametrize("cell", ["", " ", "NA", "na", "NaN", "nan"])
def test_touches_without_a_coordinate_are_left_out(tmp_path, cell) -> None:
    path = tmp_path / "points.csv"
    path.write_text("set,x_m,y_m,z_m,nx,ny,nz\n"
                    f"a,1,2,3,0,0,1\na,4,{cell},6,0,0,1\nb,{cell},8,9,0,0,1\na,7,8,9,,,\n")
    sets = read_points(path, units="m")
    assert sets.names == ("a", "b")
    assert sets.left_out == (1, 1)
    assert sets.count.tolist() == [2, 0]
    assert sets.touches_m[sets.slots(0)].tolist() == [[1, 2, 3], [7, 8, 9]]
    assert sets.normals is not None
    assert sets.normals[0].tolist() == [0, 0, 1]


def test_every_mistake_at_once(tmp_path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x_m,y_m,z_m\n1,two,3\n4,5,six\n")
    with pytest.raises(PointsError) as error:
        read_points(path)
    assert len(error.value.problems) == 2


def test_rows_of_planes() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (2, 9, 3)) * [1, 1, 0] + [0, 0, 0.5]
    text = rows_csv(*plane_rows(["a", "b"], fit_plane(points))).decode()
    rows = list(csv.DictReader(text.splitlines()))
    assert [row["set"] for row in rows] == ["a", "b"]
    assert float(rows[1]["offset_m"]) == pytest.approx(0.5)
    assert rows[0]["status"] == "converged"


def test_sets_and_mistakes_go_on_over_blocks_of_rows(tmp_path) -> None:
    path = tmp_path / "points.csv"
    count = 3 * ROWS_AT_ONCE + 7
    rows = [f"s{k % 5},{k},{0.5 * k},-1" for k in range(count)]
    path.write_text("\n".join(["set,x_m,y_m,z_m", *rows]))
    sets = read_points(path, units="m")
    assert sets.names == ("s0", "s1", "s2", "s3", "s4")
    assert sets.count.tolist() == [len(range(s, count, 5)) for s in range(5)]
    for s in range(5):
        assert sets.touches_m[sets.slots(s), 0].tolist() == list(range(s, count, 5))
    rows[ROWS_AT_ONCE] = "s0,1,1_0,2"
    rows[2 * ROWS_AT_ONCE] = ",1,2,three"
    path.write_text("\n".join(["set,x_m,y_m,z_m", *rows]))
    with pytest.raises(PointsError) as error:
        read_points(path, units="m")
    places = [problem.removeprefix(f"{path}:").split(": ")[:2] for problem in error.value.problems]
    assert places == [[str(ROWS_AT_ONCE + 2), "y_m"], [str(2 * ROWS_AT_ONCE + 2), "z_m"],
                      [str(2 * ROWS_AT_ONCE + 2), "set"]]
