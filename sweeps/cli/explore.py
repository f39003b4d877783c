"""The commands for one episode, for points of your own, and for what there is to explore with."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sweeps.cli.app import Json, UsageError, app, device_of


@app.command
def explore(object_: str, /, *, strategy: str,
            out: Annotated[Path, Parameter(name=["--out", "-o"])], units: str | None = None,
            seed: int = 0, yaw_deg: float | None = None, x_m: float = 0.45, y_m: float = 0.0,
            replay: Annotated[bool, Parameter(negative="")] = False,
            device: str = "cpu") -> int:
    """Run one episode and write all that was felt: contacts, shape, a figure.

    Parameters
    ----------
    object_
        A name (`warpgrasp objects`) or a mesh file, then with its units.
    strategy
        A name (`warpgrasp strategies`).
    out
        The directory to write to.
    units
        Of a mesh: m, cm or mm.
    seed
        Names every random number of the episode.
    yaw_deg
        How the object is turned; at random if not given.
    x_m
        Where it stands, ahead of the robot's base.
    y_m
        Where it stands, to the left of the robot's base.
    replay
        Also write replay.html: the episode played again in 3-D (needs the extra `show`).
    device
        cpu, or cuda:0.
    """
    from sweeps.cli import explore_command

    if not abs(yaw_deg or 0.0) < 1e6:
        raise UsageError(f"--yaw-deg: is {yaw_deg}; should be a finite number")
    _check_place("--x-m", x_m)
    _check_place("--y-m", y_m)
    if not 0 <= seed < 2**63:
        raise UsageError(f"--seed: is {seed}; should be a whole number from 0 to 2^63 - 1")
    return explore_command.explore(
        object_, strategy, out, units=units, seed=seed, yaw_deg=yaw_deg, x_m=x_m, y_m=y_m,
        device=device_of(device), replay=replay)


def _check_place(name: str, value: float) -> None:
    """Raises UsageError for a place that a spec does not allow either."""
    from warpgrasp.parameters import OBJECT_REACH_M as far

    if not abs(value) <= far:
        guess = f"; did you mean {value / 1e3:g}?" if 10 <= abs(value) <= 1e3 * far else ""
        raise UsageError(f"{name}: is {value:g}; should be metres from {-far:g} to {far:g}{guess}")


@app.command
def fit(shape: Literal["superquadric", "plane", "revolution"], points: Path, /, *,
        out: Annotated[Path, Parameter(name=["--out", "-o"])],
        taper: Annotated[bool, Parameter(negative="")] = False,
        bend: Annotated[bool, Parameter(negative="")] = False,
        robust: Annotated[bool, Parameter(negative="")] = False, table_z: float | None = None,
        figure: Path | None = None) -> int:
    """Fit shapes to sets of touched points of your own.

    Parameters
    ----------
    shape
        superquadric, plane or revolution.
    points
        A CSV with columns x_m, y_m, z_m; set where there are several; nx, ny, nz, pointing out of
        the body, where felt.
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
    figure
        Also draw the sets, as .png, .svg or .pdf.
    """
    from sweeps.cli import fit as fit_command

    return fit_command.fit(shape, points, out, taper=taper, bend=bend, robust=robust,
                           table_z_m=table_z, figure=figure)


@app.command
def objects(*, json: Json = False) -> int:
    """List the objects there are.

    Parameters
    ----------
    json
        Print JSON.
    """
    from sweeps.cli import previews

    return previews.objects(as_json=json)


@app.command
def strategies(*, json: Json = False) -> int:
    """List the ready-made strategies.

    Parameters
    ----------
    json
        Print JSON.
    """
    from sweeps.cli import previews

    return previews.strategies(as_json=json)


@app.command(name="export")
def export_(file: Path, /, *, arm: Annotated[bool, Parameter(negative="")] = False,
            object_: Annotated[str | None, Parameter(name="--object")] = None,
            units: str | None = None) -> int:
    """Write the hand as MJCF or URDF, from the tables the simulator uses.

    Parameters
    ----------
    file
        Ends in .xml for MJCF (MuJoCo), in .urdf for URDF.
    arm
        The whole robot: PUMA 560 with the hand, 22 joints.
    object_
        Put this object before it: a name (`warpgrasp objects`) or a mesh file, then with its units.
    units
        Of a mesh: m, cm or mm.
    """
    from sweeps.cli.export import export

    return export(file, arm=arm, what=object_, units=units)
