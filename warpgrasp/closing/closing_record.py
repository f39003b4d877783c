# type: ignore  # Warp structs, whose fields type checkers cannot follow
"""Records of a closing as kernels see them: its path, and the rows they write for each finger."""


from warpgrasp.core.dtypes import mat42, real, struct, vec3, vec4


@struct
class PathStep:
    """A command, and the number of moves of the flexion joints since the start."""

    command: vec4
    moves: real


@struct
class LinkStep:
    """A link of the free finger at a step, in the frame of the finger's base.

    `start` and `end` bound its axis [m]; `come` bounds the distance [m] that any of its points has
    moved since the first step; `steps` is the number of steps per metre at its fastest from here on
    [1/m].
    """

    start: vec3
    end: vec3
    come: real
    steps: real


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
    point: vec3
    normal: vec3
    along: vec3
    bend: vec3
    depth: vec3
    link: int
    on_table: int
