"""The commands for arms: those that ship, and an arm from a URDF."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sweeps.cli.app import Force, Json, UsageError, app, refuse_existing


@app.command
def arms(*files: Path, json: Json = False) -> int:
    """List the arms that ship, or those of files: joints, and length from the first joint on.

    Parameters
    ----------
    files
        Arms as `warpgrasp arm` writes them.
    json
        Print JSON.
    """
    from sweeps.text_table import print_table
    from warpgrasp.arms.arm_file import SHIPPED_ARMS, arm_from_file, arm_named
    from warpgrasp.arms.serial_arm import arm_reach_m
    from warpgrasp.parameters import FLOATING, PUMA560, ArmTable

    table = ArmTable()
    found = [(str(file), arm_from_file(file)) for file in files]
    ours = [] if found else [
        (PUMA560, "6", f"{sum(table.a_m) + sum(table.d_m[1:]):.2f}",
         "robotics-toolbox-python; Unimation bulletin"),
        (FLOATING, "0", "", "a floating wrist within a box")]
    found = found or [(name, arm_named(name)) for name in SHIPPED_ARMS]
    print_table(("arm", "joints", "length [m]", "source"),
                [*ours, *((name, str(len(m.joints)), f"{arm_reach_m(m):.2f}", m.source)
                          for name, m in found)], json)
    return 0


@app.command
def arm(urdf: Path, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
        flange: str | None = None, force: Force = False) -> int:
    """Write an arm from a URDF as TOML, and say what was guessed.

    Parameters
    ----------
    urdf
        A URDF; its meshes are not read.
    out
        The file to write, .toml.
    flange
        The link that carries the hand, along its z axis; by default the one after the last joint of
        the only chain of six or seven joints.
    force
        Overwrite an existing file.
    """
    from sweeps.output import note, quiet_stdout, write_atomic
    from sweeps.spec.errors import StoreError
    from warpgrasp.arms.arm_file import arm_text
    from warpgrasp.arms.urdf_arm import arm_from_urdf

    if out.suffix != ".toml":
        raise UsageError(f"--out: is {out}; should end in .toml")
    refuse_existing(out, force)
    with quiet_stdout():
        model, notes = arm_from_urdf(urdf, flange=flange)
        for line in notes:
            note(line)
        try:
            write_atomic(out, arm_text(model).encode())
        except OSError as error:
            raise StoreError(f"{out}: cannot be written: {error.strerror or error}") from None
    print(out)
    return 0
