# type: ignore  # Warp functions, which type checkers cannot follow
"""The axes of a turned frame: what `wp.quat_rotate` gives for the unit vectors, to the last bit,
with a third of its operations (the products with zeros left out)."""

import warp as wp

from warpgrasp.core.dtypes import ONE, TWO, mat33, quat


@wp.func
def frame_axes(r: quat):
    """The axes x, y and z as rows."""
    x = r[0]
    y = r[1]
    z = r[2]
    w = r[3]
    c = TWO * w * w - ONE
    by_x = TWO * x
    by_y = TWO * y
    by_z = TWO * z
    turn_x = x * w * TWO
    turn_y = y * w * TWO
    turn_z = z * w * TWO
    return mat33(c + x * by_x, y * by_x + turn_z, z * by_x - turn_y,
                 x * by_y - turn_z, c + y * by_y, z * by_y + turn_x,
                 x * by_z + turn_y, y * by_z - turn_x, c + z * by_z)
