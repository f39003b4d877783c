"""The commands for arms: those that ship, and an arm from a URDF."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sweeps.cli.app import Force, Json, UsageError, app, named_numbers, refuse_existing


@app.command
def arms(*arms: str, json: Json = False) -> int:
    """List the arms that ship, or those that are named: joints, and length from the first one on.

    Parameters
    ----------
    arms
        Arms that ship, or files as `warpgrasp arm` writes them; by default all that ship.
    json
        Print JSON.
    """
    from sweeps.text_table import print_table
    from warpgrasp.arms.arm_file import SHIPPED_ARMS
    from warpgrasp.arms.serial_arm import arm_reach_m
    from warpgrasp.mechanism.arm import serial_model
    from warpgrasp.parameters import FLOATING, PUMA560, ArmTable

    table = ArmTable()
    ours = {PUMA560: (PUMA560, "6", f"{sum(table.a_m) + sum(table.d_m[1:]):.2f}",
                      "robotics-toolbox-python; Unimation bulletin"),
            FLOATING: (FLOATING, "0", "", "a floating wrist within a box")}

    def row(name: str) -> tuple[str, ...]:
        if (m := serial_model(ArmTable(kind=name))) is None:
            return ours[name]
        return name, str(len(m.joints)), f"{arm_reach_m(m):.2f}", m.source

    print_table(("arm", "joints", "length [m]", "source"),
                [row(name) for name in arms or (*ours, *SHIPPED_ARMS)], json)
    return 0


@app.command
def arm(urdf: Path, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
        flange: str | None = None,
        hold: Annotated[list[str] | None, Parameter(negative="")] = None,
        hand: str | None = None, force: Force = False) -> int:
    """Write an arm from a URDF as TOML, and say what was guessed.

    Parameters
    ----------
    urdf
        A URDF; its meshes are not read.
    out
        The file to write, .toml.
    flange
        The link that carries the hand, along its z axis; by default the one after the last joint of
        the only chain of six or seven joints, a gripper left out.
    hold
        A joint that stands still, such as a torso's, as NAME=DEGREES, or NAME=MILLIMETRES if it
        slides; more as in --hold A=0 --hold B=0.
    hand
        A hand that ships, or a file, whose palm is that link, as of a robot with arm and hand in
        one URDF: the flange is written where it carries that hand as the robot does.
    force
        Overwrite an existing file.
    """
    from sweeps.output import note, quiet_stdout
    from sweeps.result_file import check_result, write_result
    from warpgrasp.arms.arm_file import arm_text
    from warpgrasp.arms.urdf_arm import arm_from_urdf
    from warpgrasp.chain.chain_hand import hand_of_kind

    if out.suffix != ".toml":
        raise UsageError(f"--out: is {out}; should end in .toml")
    check_result(out)
    refuse_existing(out, force)
    carried = hand_of_kind(hand) if hand else None
    with quiet_stdout():
        model, notes = arm_from_urdf(urdf, flange=flange, hand=carried,
                                     held_deg_mm=named_numbers("--hold", hold or [], "torso=0"))
        for line in notes:
            note(line)
        write_result(out, arm_text(model).encode())
    print(out)
    return 0
