"""The command `export`: the robot as a file for other simulators."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sweeps.cli.app import Force, UsageError, app


@app.command
def export(file: Path, /, *, arm: Annotated[bool, Parameter(negative="")] = False,
            on: str | None = None,
            object_: Annotated[str | None, Parameter(name="--object")] = None,
            units: str | None = None, hand: str = "utah_mit", force: Force = False) -> int:
    """Write a hand as MJCF or URDF, from the numbers the simulator uses.

    Parameters
    ----------
    file
        Ends in .xml for MJCF (MuJoCo), in .urdf for URDF.
    arm
        The whole robot: the arm with the hand; the PUMA 560 unless `--on` names another.
    on
        The arm that carries the hand: a name (`warpgrasp arms`) or a TOML file.
    object_
        Put this object before it: a name (`warpgrasp objects`) or a mesh file, then with its units.
    units
        Of a mesh: m, cm, mm or in, or how long one unit of the file is, as "120 mm".
    hand
        A name (`warpgrasp hands`) or a TOML file that `warpgrasp hand` wrote.
    force
        Overwrite existing files: that one, and beside a URDF the meshes of the object.
    """
    from sweeps.cli.tools.export_robot import export_robot
    from warpgrasp.parameters import FLOATING, PUMA560

    if on == FLOATING:
        raise UsageError("--on: a floating wrist has no links; should be an arm")
    if units is not None and object_ is None:
        raise UsageError("--units: says how large a mesh is; should stand beside --object")
    return export_robot(file, arm=on or (PUMA560 if arm else None), what=object_, units=units,
                        hand=hand, force=force)
