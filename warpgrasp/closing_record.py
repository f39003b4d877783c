"""What the kernels of a closing write, a row each for a finger: what is felt, and what is true."""

import warp as wp

from warpgrasp.real import mat42, real, vec3, vec4


@wp.struct
class ClosingRow:
    """The row of a `Closing`."""

    status: int
    step: int
    q: vec4
    tension: mat42
    difference: real


@wp.struct
class ClosingTruthRow:
    """The row of a `ClosingTruth`; `along`, `bend` and `depth` are those of a `Rest`."""

    q: vec4
    torque: vec4
    point: vec3
    normal: vec3
    along: vec3
    bend: vec3
    depth: vec3
    link: int
    on_table: int
