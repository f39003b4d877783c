"""What `warpgrasp fit` does: a CSV of sets of touches in, a CSV of recovered shapes out, a row a
set."""

import re
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from math import isfinite, radians
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from fit.arrays import joined, rows_of
from fit.fit_status import FAR, LEAST_EXTENT_M, status_names
from fit.point_sets import PointSets
from fit.points_csv import (
    free_form_rows,
    plane_rows,
    profile_rows,
    read_points,
    revolution_rows,
    rows_csv,
    superquadric_rows,
)
from sweeps.cli.tools.fit_advice import (
    free_form_advice,
    named,
    plane_advice,
    revolution_advice,
    superquadric_advice,
    vague_superquadrics,
)
from sweeps.output import init_warp, note
from sweeps.result_file import make_folder, why_unwritable, write_result
from sweeps.spec.errors import StoreError
from warpgrasp.core.cores import core_count
from warpgrasp.core.plain_text import counted

ON_ALL_CORES = ("superquadric", "implicit")
"""Shapes of which many sets are shared out; the others take no time."""
SETS_A_PROCESS = 1024
"""Sets that a process fits at a time; fewer than twice as many are fitted in this one."""
FIGURE_FORMATS = (".png", ".svg", ".pdf")
BELOW_SHARE, BELOW_M = 0.1, 0.005
"""More touches than this share lie farther than this below a table that is given too high."""
LEAST_NORMALS, INWARD_M = 8, 0.001
"""So many normals, half of which point inwards by more than what touches of a flat face may."""
MOST_NORMAL_DEG = 90.0
"""Normals that err by more tell nothing."""


def fit_points(shape: str, points: Path, out: Path, *, taper: bool, bend: bool, robust: bool,
               table_z_m: float | None, figure: Path | None, normal_deg: float | None = None,
               units: str | None = None, meshes: Path | None = None) -> int:
    """Fits every set of `points`, writes `out` (and the contours of revolutions beside it, and the
    surfaces of free forms into the folder `meshes`).

    Prints the files written; notes say what became of the sets. Raises PointsError with all that
    is wrong in the file, StoreError for options that contradict and files that cannot be used.
    """
    _check(shape, points, out, taper, bend, robust, table_z_m, normal_deg, figure, meshes)
    try:
        sets = read_points(points, units=units)
    except OSError as error:
        raise StoreError(f"{points}: cannot be read: {error.strerror or error}") from None
    if any(sets.left_out):
        note(_left_out(sets))
    if table_z_m is not None:
        _check_table(sets, table_z_m)
    if normal_deg is not None and sets.normals is None:
        raise StoreError(f"--normal-deg: {points} has no columns nx, ny, nz")
    if shape in ("superquadric", "implicit") and sets.normals is not None:
        for name in inward(sets):
            note(f"nx, ny, nz: most normals of {name} point to the middle of its touches; they "
                "should point out of the body")
    if meshes is not None:
        make_folder(meshes)
    found, vague = fit_on_all_cores(shape, sets, taper=taper, bend=bend, robust=robust,
                                    table_z_m=table_z_m, normal_deg=normal_deg)
    files = {out: rows_csv(*_rows(shape, sets.names, found))}
    if shape == "revolution":
        files[profile_path(out)] = rows_csv(*profile_rows(sets.names, found))
    if figure is not None:
        from sweeps.figures.fits import draw_fits

        files[figure] = draw_fits(sets, found, figure.suffix[1:])
    for path, content in files.items():
        write_result(path, content)
        print(path)
    if meshes is not None:
        for name, mesh in zip(mesh_names(sets.names), found.mesh, strict=True):
            if len(mesh.faces):
                write_result(meshes / name, mesh.as_ply())
        print(meshes)
    became, count = Counter(status_names(found.status)), len(sets.names)
    note(f"{counted(count, 'set')}: " + ", ".join(f"{n} {name}" for name, n in became.items()))
    for advice in _advice(shape, sets, found, vague, robust, table_z_m):
        note(advice)
    return 0


def _left_out(sets: PointSets) -> str:
    """Which sets have touches with a missing coordinate, and how many."""
    return "touches with a missing coordinate are left out: " + named(
        [f"{count} of set {name}" for name, count in zip(sets.names, sets.left_out, strict=True)
         if count])


def _advice(shape: str, sets: PointSets, found: Any, vague: np.ndarray, robust: bool,
            table_z_m: float | None) -> list[str]:
    """Notes of fits that may be wrong."""
    if shape == "superquadric":
        return superquadric_advice(sets, found, vague, robust=robust, table_z_m=table_z_m)
    if shape == "revolution":
        return revolution_advice(sets, found, table_z_m=table_z_m)
    if shape == "implicit":
        return free_form_advice(sets.names, found)
    return plane_advice(sets, found)


def _check_table(sets: PointSets, table_z_m: float) -> None:
    """Notes of which sets the table cannot be true. Raises StoreError where it is of none."""
    finite, of_touch = np.isfinite(sets.touches_m).all(1), sets.of_touch
    good = np.bincount(of_touch[finite], minlength=len(sets.names))
    used = good > 0
    names = [name for name, there in zip(sets.names, used.tolist(), strict=True) if there]
    low, high = (bound[used] for bound in sets.bounds_m())
    deep = finite & (sets.touches_m[:, 2] < table_z_m - BELOW_M)
    below = np.bincount(of_touch[deep], minlength=len(sets.names))
    under = (below > BELOW_SHARE * good)[used]
    extent = np.maximum(np.linalg.norm(high - low, axis=1), LEAST_EXTENT_M)
    far = low[:, 2] - table_z_m > FAR * extent
    wrong = [f"--table-z: is {table_z_m:g}; the touches of {name} lie "
             f"{'below it' if below else 'far above it'}, from {z0:g} to {z1:g} m"
             for name, below, away, z0, z1 in zip(names, under, far, low[:, 2], high[:, 2],
                                                  strict=True) if below or away]
    if wrong and len(wrong) == len(names):
        raise StoreError(f"{wrong[0]}; should be the table's height in metres, below all touches")
    for line in wrong:
        note(line)


def inward(sets: PointSets) -> list[str]:
    """Names of sets whose normals seem to point into the body.

    Half of them do by more than `INWARD_M`, as seen from the mean of the touches [m]; outward
    ones of a convex body never do, for that mean lies within it.
    """
    out = []
    if sets.normals is None:
        return out
    for index, name in enumerate(sets.names):
        points, of_set = sets.touches_m[sets.slots(index)], sets.normals[sets.slots(index)]
        touched = np.isfinite(points).all(1)
        felt = touched & np.isfinite(of_set).all(1) & of_set.any(1)
        if felt.sum() < LEAST_NORMALS:
            continue
        unit = of_set[felt] / np.abs(of_set[felt]).max(axis=1, keepdims=True)
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        outward_m = ((points[felt] - points[touched].mean(axis=0)) * unit).sum(1)
        if np.median(outward_m) < -INWARD_M:
            out.append(name)
    return out


def fit_on_all_cores(shape: str, sets: PointSets, **options: Any) -> tuple[Any, np.ndarray]:
    """The fits of all sets, in order, by as many processes as there are cores where sets suffice;
    and of which superquadrics the touches tell little, bool (set,).

    A fit depends only on its own points, so that the rows are the same however they are shared out.
    """
    count, cores = len(sets.names), core_count()
    alone = shape not in ON_ALL_CORES or cores == 1 or count < 2 * SETS_A_PROCESS
    groups = _groups(sets, count if alone else SETS_A_PROCESS)
    parts, one = map(sets.padded, groups), partial(_fitted, shape, **options)
    if alone:
        found = list(map(one, parts))
    else:
        with ProcessPoolExecutor(min(cores, len(groups)), get_context("spawn")) as pool:
            found = list(pool.map(one, parts))
    order = np.argsort(np.concatenate(groups))
    return (rows_of(joined([fits for fits, _ in found]), order),
            np.concatenate([vague for _, vague in found])[order])


def _groups(sets: PointSets, most: int) -> list[np.ndarray]:
    """Numbers of the sets to fit together, so many at most: those padded to one number of touches,
    so that a large set does not pad the small ones."""
    from fit.optimize.batch import point_bucket

    width = np.array([point_bucket(int(count)) for count in sets.count])
    same = [np.flatnonzero(width == of) for of in np.unique(width)]
    return [group[first:first + most] for group in same for first in range(0, len(group), most)]


def _fitted(shape: str, sets: tuple, **options: Any) -> tuple[Any, np.ndarray]:
    """`fit_padded`, and of which superquadrics the touches tell little."""
    found, (points, mask, _) = fit_padded(shape, sets, **options), sets
    if shape != "superquadric":
        return found, np.zeros(len(mask), bool)
    return found, vague_superquadrics(found, points, mask, options["table_z_m"])


def fit_padded(shape: str, sets: tuple, *, taper: bool = False, bend: bool = False,
              robust: bool = False, table_z_m: float | None = None,
              normal_deg: float | None = None) -> Any:
    """The fits of one shape to padded sets: a `SuperquadricFit`, `PlaneFit`, `RevolutionFit` or
    `FreeForms`.

    Planes come without the weights of touches, which no file holds.
    """
    points, mask, normals = sets
    if shape == "plane":
        from fit.plane import fit_plane

        found = fit_plane(points, mask)
        return replace(found, weight=found.weight[:, :0])
    if shape == "revolution":
        from fit.revolution.fit import fit_revolution

        return fit_revolution(points, mask, table_z=table_z_m)
    if shape == "implicit":
        from fit.implicit.free_bodies import fit_free_forms

        init_warp()
        return fit_free_forms(points, mask, normals, table_z_m=table_z_m)
    from fit.superquadric.fit import fit_superquadric
    from fit.superquadric.record import SuperquadricOptions

    options = SuperquadricOptions(taper=taper, bend=bend, loss="cauchy" if robust else "none")
    if normal_deg is not None:
        options = replace(options, normal_std_rad=radians(normal_deg))
    return fit_superquadric(points, mask, normals=normals, table_z=table_z_m, options=options)


def profile_path(out: Path) -> Path:
    """The file of the contours beside `out`: fits.csv has fits.profile.csv."""
    return out.with_name(f"{out.stem}.profile{out.suffix or '.csv'}")


def mesh_names(names: Sequence[str]) -> list[str]:
    """A file for the mesh of each set: its name, of letters, digits, points and hyphens, after its
    number if two sets would have the same file."""
    plain = [re.sub(r"[^\w.-]+", "_", name).strip("._") or "set" for name in names]
    shared = len({name.lower() for name in plain}) < len(plain)
    return [f"{number}-{name}.ply" if shared else f"{name}.ply"
            for number, name in enumerate(plain, 1)]


def _rows(shape: str, names: tuple[str, ...], found: Any) -> tuple[list[str], list[list]]:
    return {"superquadric": superquadric_rows, "plane": plane_rows,
            "revolution": revolution_rows, "implicit": free_form_rows}[shape](names, found)


def _check(shape: str, points: Path, out: Path, taper: bool, bend: bool, robust: bool,
           table_z_m: float | None, normal_deg: float | None, figure: Path | None,
           meshes: Path | None) -> None:
    """Raises StoreError with everything wrong about the options."""
    problems = [f"{name}: is for superquadric, not for {shape}" for name, given in
                (("--taper", taper), ("--bend", bend), ("--robust", robust))
                if given and shape != "superquadric"]
    if table_z_m is not None:
        if shape == "plane":
            problems.append("--table-z: is for solid shapes, not for plane")
        elif not isfinite(table_z_m):
            problems.append(f"--table-z: is {table_z_m}; should be a finite number of metres")
    if normal_deg is not None:
        if shape != "superquadric":
            problems.append(f"--normal-deg: is for superquadric, not for {shape}")
        elif not 0.0 <= normal_deg <= MOST_NORMAL_DEG:
            problems.append(f"--normal-deg: is {normal_deg:g}; should be a number of degrees from "
                            f"0 to {MOST_NORMAL_DEG:g}")
    if figure is not None and figure.suffix.lower() not in FIGURE_FORMATS:
        problems.append(f"--figure: {figure}: should end in {', '.join(FIGURE_FORMATS)}")
    if meshes is not None and shape != "implicit":
        problems.append(f"--meshes: is for implicit, not for {shape}")
    written = [path for path in (out, figure) if path is not None]
    if shape == "revolution":
        written.append(profile_path(out))
    named = [path.resolve() for path in (points, *written)]
    if len(set(named)) < len(named):
        problems.append(f"--out: {out}: a file is named twice; it would be written over")
    problems += [wrong for path in written if (wrong := why_unwritable(path))]
    if problems:
        raise StoreError("\n".join(problems))
