# type: ignore  # Warp functions, which type checkers cannot follow
"""Where the hand is along a guarded line: as believed, and truly, by errors of calibration."""

import warp as wp

from warpgrasp.core.dtypes import ZERO, real, transform, vec3, vec6
from warpgrasp.mechanism.puma560_kernel import Arm, puma_forward


@wp.func
def along_line(line: transform, direction: vec3, s: real):
    """The believed pose of the hand, `s` [m] along a line."""
    return transform(wp.transform_get_translation(line) + direction * s,
                     wp.transform_get_rotation(line))


@wp.func
def hand_slip(arm: Arm, q: vec6, believed: transform, hand_on_flange: transform, mount: transform):
    """The true pose of the hand in the frame of the believed one; `arm` is the true arm."""
    true = wp.transform_multiply(wp.transform_multiply(puma_forward(arm, q), hand_on_flange), mount)
    return wp.transform_multiply(wp.transform_inverse(believed), true)


@wp.func
def hand_at(
    line: transform, direction: vec3, s: real, slip: transform, last: transform, share: real,
    wobble: vec3
):
    """The true pose of the hand, a `share` of the way from where it slips by `slip` to `last`.

    Calibration errors change so little along a line that straight between its ends is exact to a
    micrometre.
    """
    a = wp.transform_get_rotation(slip)
    b = wp.transform_get_rotation(last)
    if wp.dot(a, b) < ZERO:
        b = -b
    x = wp.transform_get_translation(slip)
    off = transform(x + (wp.transform_get_translation(last) - x) * share,
                    wp.normalize(a + (b - a) * share))
    here = wp.transform_multiply(along_line(line, direction, s), off)
    return transform(wp.transform_get_translation(here) + wobble, wp.transform_get_rotation(here))
