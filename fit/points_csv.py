"""CSV files of `warpgrasp fit`: sets of touches in, fits out.

Input columns are `set, x_m, y_m, z_m` (without `set`: one set; optional `nx, ny, nz`; other units
by `x_cm`, `x_mm`, or `x, y, z` where the caller says the unit). Output files have one row per set.
"""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from fit.fit_status import status_names
from fit.implicit.record import FreeForms
from fit.plane_record import PlaneFit
from fit.point_sets import PointSets
from fit.revolution.record import RevolutionFit
from fit.superquadric.record import SuperquadricFit
from warpgrasp.core.plain_text import csv_cell

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
NUMBER = {"m": "metres such as 0.0425", "cm": "centimetres such as 4.25",
          "mm": "millimetres such as 42.5"}
"""What a cell of a unit should hold."""
NORMAL = ("nx", "ny", "nz")
MISSING = ("", "na", "nan")
"""Cells without a value, in lower case."""
ROWS_AT_ONCE = 512
"""Few enough that Python's garbage collector does not walk through the rows again and again."""
LARGEST_M = 2.0
"""The diagonal of what may be touched by a hand on an arm [est]."""
SMALLEST_M = 0.002
"""Touches on anything that a finger feels the shape of are farther apart [est]."""


class PointsError(ValueError):
    """All errors of a points file, one per line: `file:line: column: what is wrong`."""

    def __init__(self, problems: Sequence[str]):
        super().__init__("\n".join(problems))
        self.problems = tuple(problems)


def read_points(path: str | Path, *, units: str | None = None,
                most_problems: int = 20) -> PointSets:
    """Read sets of touches from a CSV file.

    The unit of length is that of the columns (`x_m`, `x_cm` or `x_mm`), unless `units` says
    otherwise; then the columns may also be `x`, `y` and `z`. Unless it does, sets of more than
    `LARGEST_M` are refused, and files of which no set has `SMALLEST_M`: nobody touches them with
    one hand, and columns of millimetres named `x_m`, or of metres named `x_mm`, are the usual
    reason.

    A touch with a missing coordinate (an empty cell, NA or NaN) is left out and counted in
    `left_out`; its set stays, if without touches. Rows without any value are skipped. Infinity is
    accepted: a fit of such a set has the status `bad_points`.

    Raises PointsError with the file, line and column of each error (a missing column, a cell that
    is not a number, a row of the wrong length, no touches), and OSError if the file cannot be read.
    """
    try:
        return _read_points(Path(path), units, most_problems)
    except (UnicodeDecodeError, csv.Error) as error:
        raise PointsError([f"{path}: is not CSV text in UTF-8: {error}"]) from None


def _read_points(path: Path, units: str | None, most_problems: int) -> PointSets:
    problems: list[str] = []
    names: list[str] = []
    values: list[np.ndarray] = []
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file)
        header = [name.strip() for name in next(reader, [])]
        axes, named = _axes(path, header, units)
        columns = {name: k for k, name in enumerate(header)}
        numbered = ((reader.line_num, row) for row in reader if any(map(str.strip, row)))
        while block := list(islice(numbered, ROWS_AT_ONCE)):
            of_block = _Block(path, header, block, NUMBER[units or named])
            values.append(of_block.numbers([columns[name] for name in (*axes, *NORMAL)
                                            if name in columns]))
            names += of_block.names(columns.get("set"))
            problems += of_block.problems
    if not problems and all(np.isnan(of[:, :3]).any(axis=1).all() for of in values):
        problems.append(f"{path}:2: no points; a row of numbers for each touch should follow")
    if problems:
        hidden = len(problems) - most_problems
        shown = problems[:most_problems]
        raise PointsError([*shown, f"{path}: {hidden} more"] if hidden > 0 else shown)
    found = _grouped(names, np.concatenate(values))
    found = replace(found, touches_m=found.touches_m * UNITS_M[units or named])
    if units is None:
        _check_extent(path, found, named)
    return found


class _Block:
    """Some rows, read column by column, since a call for each cell would take longer than a fit."""

    def __init__(self, path: Path, header: Sequence[str], block: Sequence[tuple[int, list[str]]],
                 length: str):
        """`length` says what a cell of a coordinate should hold."""
        self._path, self._header, self._length = path, header, length
        self._wrong = [(line, f"{len(row)} cells, should be {len(header)} as in line 1")
                       for line, row in block if len(row) != len(header)]
        right = [(line, row) for line, row in block if len(row) == len(header)]
        self._lines = [line for line, _ in right]
        self._cells = list(zip(*(row for _, row in right), strict=True)) or [()] * len(header)

    def numbers(self, wanted: Sequence[int]) -> np.ndarray:
        """The numbers of the columns `wanted`, shape [row, column]; NaN where there is none."""
        return np.stack([self._column(k) for k in wanted], axis=1)

    def names(self, column: int | None) -> list[str]:
        """The set of each row."""
        if column is None:
            return ["0"] * len(self._lines)
        names = [cell.strip() for cell in self._cells[column]]
        self._wrong += [(line, "set: is empty; every touch should name its set")
                        for line, name in zip(self._lines, names, strict=True) if not name]
        return names

    @property
    def problems(self) -> list[str]:
        """What is wrong in what was read, in the order of the lines."""
        return [f"{self._path}:{line}: {what}"
                for line, what in sorted(self._wrong, key=lambda wrong: wrong[0])]

    def _column(self, k: int) -> np.ndarray:
        cells, name = self._cells[k], self._header[k]
        try:
            if "_" not in "".join(cells):
                return np.fromiter(map(float, cells), float, len(cells))
        except ValueError:  # some cell is not a number: look at each
            pass
        found = [_number(cell) for cell in cells]
        should = "a number such as 0.6" if name in NORMAL else self._length
        self._wrong += [(line, f"{name}: {cell.strip()!r} is not a number; write {should}")
                        for line, cell, number in zip(self._lines, cells, found, strict=True)
                        if number is None]
        return np.array([math.nan if number is None else number for number in found])


def _check_extent(path: Path, sets: PointSets, unit: str) -> None:
    """Raises PointsError for a set that is too large to have been touched by a hand, or where all
    are too small; a set of one place is neither."""
    low, high = sets.bounds_m()
    with np.errstate(over="ignore"):  # squares beyond all numbers make it inf, which is too large
        extent = np.linalg.norm(np.maximum(high - low, 0.0), axis=1)
    if (extent > LARGEST_M).any():
        n = int(extent.argmax())
        raise PointsError([
            f"{path}:1: x_{unit}: the points of set {sets.names[n]} are {extent[n]:.3g} m across; "
            f"objects of a hand are below {LARGEST_M:g} m. If they are millimetres, give --units "
            f"mm or name the columns x_mm, y_mm, z_mm; if not, --units {unit}"])
    if 0.0 < extent.max() < SMALLEST_M:
        raise PointsError([
            f"{path}:1: x_{unit}: the points of no set are more than {extent.max():.3g} m across; "
            f"objects of a hand are above {SMALLEST_M:g} m. If they are metres, give --units m or "
            f"name the columns x_m, y_m, z_m; if they are {unit}, --units {unit}"])


def _axes(path: Path, header: list[str], units: str | None) -> tuple[tuple[str, ...], str]:
    """The columns of x, y and z, and the unit that they are named by.

    Raises PointsError for columns that are missing or there twice, or in two units.
    """
    of_units = [unit for unit in UNITS_M if f"x_{unit}" in header]
    named = of_units[0] if of_units else None
    if named is None and units is not None and "x" in header:
        axes, named = ("x", "y", "z"), units
    else:
        axes = tuple(f"{axis}_{named or 'm'}" for axis in "xyz")
    problems = []
    if named is None:
        problems.append(f"{path}:1: x_m, x_cm or x_mm: column is missing{_hint(header)}")
    else:
        problems += [f"{path}:1: {name}: column is missing{_hint(header)}" for name in axes
                     if name not in header]
    if len(of_units) > 1:
        problems.append(f"{path}:1: x_{of_units[0]} and x_{of_units[1]}: touches in two units; "
                        "should be in one")
    normals = [name for name in NORMAL if name in header]
    if 0 < len(normals) < 3:
        problems.append(f"{path}:1: {normals[0]}: a normal needs all of nx, ny, nz")
    problems += [f"{path}:1: {name}: column appears twice" for name in dict.fromkeys(header)
                 if name and header.count(name) > 1]
    if problems:
        raise PointsError(problems)
    return axes, named or "m"


def _hint(header: list[str]) -> str:
    """Which columns there are, and why that may be."""
    there = f"; there are: {', '.join(header) or 'none'}"
    if header and header[0].startswith("#"):
        return f"{there}. Line 1 should name the columns; delete comments above them"
    if not any(header) or all(_number(name) is not None for name in header):
        return f"{there}. Line 1 should name the columns, such as x_m,y_m,z_m"
    for sign, word in ((";", "semicolons"), ("\t", "tabs"), (" ", "spaces")):
        if len(header) == 1 and sign in header[0]:
            return f"{there}. Columns should be separated by commas, not by {word}"
    if {"x", "y", "z"} <= set(header):
        return f"{there}. Columns x, y, z need --units m, cm or mm"
    return there


def _number(cell: str) -> float | None:
    """NaN for a cell without a value, None for one that is not a number."""
    cell = cell.strip()
    if cell.lower() in MISSING:
        return math.nan
    try:
        # Python accepts underscores between digits; a CSV file should not.
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _grouped(names: Sequence[str], values: np.ndarray) -> PointSets:
    """Rows of `values` [row, 3 or 6] as sets, by the name of each row; rows without all three
    coordinates are left out."""
    number = {name: k for k, name in enumerate(dict.fromkeys(names))}
    of_row = np.fromiter(map(number.__getitem__, names), int, len(names))
    missing = np.isnan(values[:, :3]).any(axis=1)
    left_out = np.bincount(of_row[missing], minlength=len(number))
    values, of_row = values[~missing], of_row[~missing]
    order = np.argsort(of_row, kind="stable")
    return PointSets(tuple(number), values[order, :3], np.bincount(of_row, minlength=len(number)),
                     values[order, 3:] if values.shape[1] > 3 else None,
                     tuple(left_out.tolist()) if missing.any() else ())


def superquadric_rows(names: Sequence[str], fit: SuperquadricFit) -> tuple[list[str], list[list]]:
    """Header and rows for superquadrics."""
    header, rows = _table(names, fit, "a1_m a2_m a3_m eps1 eps2 px_m py_m pz_m qx qy qz qw kx ky "
                          "bend_per_m bend_angle_rad rms_mm", fit.size_m, fit.exponents,
                          fit.position_m, fit.quaternion_xyzw, fit.taper, fit.bend,
                          1e3 * fit.rms_m)
    header.insert(-1, "iterations")
    for row, iterations in zip(rows, fit.iterations, strict=True):
        row.insert(-1, iterations)
    return header, rows


def plane_rows(names: Sequence[str], fit: PlaneFit) -> tuple[list[str], list[list]]:
    """Header and rows for planes."""
    return _table(names, fit, "nx ny nz offset_m rms_mm extent_u_m extent_v_m",
                  fit.normal, fit.offset_m, 1e3 * fit.rms_m, fit.extent_m)


def revolution_rows(names: Sequence[str], fit: RevolutionFit) -> tuple[list[str], list[list]]:
    """Header and rows for surfaces of revolution; see `profile_rows`."""
    return _table(names, fit, "px_m py_m pz_m ax ay az height_m volume_m3 rms_mm",
                  fit.position_m, fit.axis, fit.height_m, fit.volume_m3, 1e3 * fit.rms_m)


def profile_rows(names: Sequence[str], fit: RevolutionFit) -> tuple[list[str], list[list]]:
    """Header and rows of the second file for surfaces of revolution: one row per contour node."""
    share = np.linspace(0.0, 1.0, fit.radius_m.shape[1])
    return ["set", "z_m", "radius_m", "radius_std_m"], [
        [name, s * height, radius, std]
        for name, height, radii, stds in
        zip(names, fit.height_m, fit.radius_m, fit.radius_std_m, strict=True)
        for s, radius, std in zip(share, radii, stds, strict=True)]


def free_form_rows(names: Sequence[str], found: FreeForms) -> tuple[list[str], list[list]]:
    """Header and rows for free forms."""
    return _table(names, found, "volume_m3 volume_low_m3 volume_high_m3 std_mm gap_mm rms_mm",
                  found.volume_m3, found.interval_m3, 1e3 * found.std_m, 1e3 * found.gap_m,
                  1e3 * found.rms_m)


def _table(
    names: Sequence[str], fit: Any, columns: str, *values: np.ndarray
) -> tuple[list[str], list[list]]:
    return (["set", "n", *columns.split(), "status"],
            [[name, int(n), *row, status] for name, n, row, status in
             zip(names, fit.n_points, np.column_stack(values), status_names(fit.status),
                 strict=True)])


def rows_csv(header: Sequence[str], rows: Iterable[Sequence]) -> bytes:
    """Content of a CSV file: nine significant digits, NA for NaN and infinity."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue().encode()


def _cell(value) -> str:
    if isinstance(value, float | np.floating):
        return format(value + 0.0, ".9g") if math.isfinite(value) else "NA"
    return csv_cell(str(value))
