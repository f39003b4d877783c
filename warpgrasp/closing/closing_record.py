# type: ignore  # Warp structs, whose fields type checkers cannot follow
"""Records of a closing as kernels see them: the rows they write for each finger."""

from warpgrasp.core.dtypes import mat42, real, struct, vec3, vec4


@struct
class ClosingRow:
    """The row of a `Closing`."""

    status: int
    step: int
    q: vec4
    tension: mat42
    difference: real


@struct
class ClosingTruthRow:
    """The row of a `ClosingTruth`; `along`, `bend` and `depth` are those of a `Equilibrium`."""

    q: vec4
    torque: vec4
    rest: vec4
    """Joints when the whole hand has come to rest: fingers that stopped may be pushed later."""
    point: vec3
    normal: vec3
    along: vec3
    bend: vec3
    depth: vec3
    link: int
    on_table: int
    touched: int
    """The first step, of those looked at, that pressed a link against something; -1 if none."""
    met: int
    """Whether it was closed together with the others, since their links touched it."""
    self_depth: real
    """How deep another finger or the palm presses into its skin [m]."""
