"""The command `fit`: shapes from points of one's own."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sweeps.cli.app import app


@app.command
def fit(shape: Literal["superquadric", "plane", "revolution", "implicit"], points: Path, /, *,
        out: Annotated[Path, Parameter(name=["--out", "-o"])],
        taper: Annotated[bool, Parameter(negative="")] = False,
        bend: Annotated[bool, Parameter(negative="")] = False,
        robust: Annotated[bool, Parameter(negative="")] = False, table_z: float | None = None,
        normal_deg: float | None = None,
        units: Literal["m", "cm", "mm"] | None = None, figure: Path | None = None,
        meshes: Path | None = None) -> int:
    """Fit shapes to sets of touched points of your own.

    Parameters
    ----------
    shape
        superquadric, plane, revolution, or implicit: a free form, of any shape.
    points
        A CSV with columns x_m, y_m, z_m (or x_cm, x_mm and so on); set where there are several;
        nx, ny, nz, pointing out of the body, where felt.
    out
        The CSV to write, a row a set; contours of revolutions go to OUT.profile.csv.
    taper
        Superquadric: let it taper along z, 13 parameters instead of 11.
    bend
        Superquadric: let it bend, two parameters more.
    robust
        Superquadric: bear touches that are wrong (the other shapes always do).
    table_z
        Height of the table the body stands on, in metres.
    normal_deg
        Superquadric: by how many degrees nx, ny, nz err (one standard deviation); 2.9 if not given.
    units
        Of the points, whose columns may then be x, y, z; by default by the columns' names: x_m,
        x_cm or x_mm.
    figure
        Also draw the sets, as .png, .svg or .pdf.
    meshes
        Implicit: a folder for the surface of each set, as a .ply file.
    """
    from sweeps.cli.tools.fit_points import fit_points

    return fit_points(shape, points, out, taper=taper, bend=bend, robust=robust, table_z_m=table_z,
                      normal_deg=normal_deg, figure=figure, units=units, meshes=meshes)
