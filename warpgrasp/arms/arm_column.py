"""Where an arm stands itself, so that nothing else can."""

from math import hypot
from pathlib import Path

from warpgrasp.parameters import ARM_COLUMN_M, FLOATING, OBJECT_REACH_M, PUMA560

_STANDS_BELOW_M = 0.5  # height of its base from which an arm hangs above objects [est]


def in_column(arm: str, x_m: float, y_m: float) -> str:
    """Why an object cannot stand at a place of the table; empty where it can.

    `arm` is the key `arm.kind` of a spec: a name or a file. `x_m` and `y_m` are the place in the
    world [m]. A column of `ARM_COLUMN_M` stands about the base of an arm. A floating wrist has
    none, nor has an arm that hangs above the objects.

    The sentence names the place by the keys of a spec, and says what would be right; a place that
    seems to be given in metres has a guess of what was meant. Raises ArmError for a file that is no
    arm's.
    """
    if arm == FLOATING:
        return ""
    at_x_m, at_y_m = 0.0, 0.0
    if arm != PUMA560:
        from warpgrasp.arms.arm_file import arm_from_file, arm_named

        model = arm_from_file(Path(arm)) if arm.endswith(".toml") else arm_named(arm)
        at_x_m, at_y_m, at_z_m = model.base_xyz_m
        if at_z_m > _STANDS_BELOW_M:
            return ""
    if hypot(x_m - at_x_m, y_m - at_y_m) >= ARM_COLUMN_M:
        return ""

    # Metres that were written as millimetres lie that near, too.
    meant = 1e3 * max(abs(x_m), abs(y_m))
    guess = (f"; lengths are in mm: did you mean x_mm = {1e6 * x_m:g}, y_mm = {1e6 * y_m:g}?"
             if ARM_COLUMN_M <= meant <= OBJECT_REACH_M else "")
    return (f"x_mm = {1e3 * x_m:g}, y_mm = {1e3 * y_m:g} is where the arm itself stands; should be "
            f"{1e3 * ARM_COLUMN_M:g} mm or more from x_mm = {1e3 * at_x_m:g}, "
            f"y_mm = {1e3 * at_y_m:g}{guess}")
