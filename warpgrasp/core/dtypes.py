# type: ignore  # Warp functions, which type checkers cannot follow
"""The number type of the simulator: float64 everywhere.

Contacts are decided by penetrations of some 20 micrometres against a skin of 2e4 N/m; in float32
the rounding of a fingertip's place would already be a visible torque. On a CPU both cost the same.
Literals in Warp functions are float32 unless wrapped, hence the named constants.
"""

from typing import TYPE_CHECKING, Any, TypeVar

import warp as wp

Record = TypeVar("Record")
if TYPE_CHECKING:
    def struct(record: type[Record]) -> type[Record]:
        """`wp.struct`, as type checkers should see it: a decorator that keeps the class."""
        return record
else:
    struct = wp.struct

real: Any = wp.float64
uint8: Any = wp.uint8
float32: Any = wp.float32
float32_vec3: Any = wp.vec3f
vec2: Any = wp.vec2d
vec3: Any = wp.vec3d
vec4: Any = wp.vec4d
mat33: Any = wp.mat33d
mat44: Any = wp.mat44d
quat: Any = wp.quatd
transform: Any = wp.transformd


class mat32(wp.types.matrix(shape=(3, 2), dtype=wp.float64)):
    """Three pairs."""


class mat34(wp.types.matrix(shape=(3, 4), dtype=wp.float64)):
    """Three planes, each a normal and an offset."""


class mat42(wp.types.matrix(shape=(4, 2), dtype=wp.float64)):
    """Four pairs."""


class mat66(wp.types.matrix(shape=(6, 6), dtype=wp.float64)):
    """Six directions of a rigid body each way."""


class mat76(wp.types.matrix(shape=(7, 6), dtype=wp.float64)):
    """Seven joints' directions of a rigid body."""


class mat77(wp.types.matrix(shape=(7, 7), dtype=wp.float64)):
    """Seven joints' places: positions and quaternions."""


class vec5(wp.types.vector(length=5, dtype=wp.float64)):
    """A plane, normal and level, and a distance."""


class vec6(wp.types.vector(length=6, dtype=wp.float64)):
    """Six numbers."""


class vec7(wp.types.vector(length=7, dtype=wp.float64)):
    """Seven numbers, as those of an arm's joints; joints that an arm has not are 0."""


ZERO = wp.constant(real(0.0))
HALF = wp.constant(real(0.5))
ONE = wp.constant(real(1.0))
TWO = wp.constant(real(2.0))
TINY = wp.constant(real(1e-12))
PI = wp.constant(real(3.141592653589793))
TWO_PI = wp.constant(real(6.283185307179586))


@wp.func
def lesser(a: real, b: real):
    """The lesser of two numbers in one instruction; `wp.min` takes five, to treat NaN."""
    return wp.where(a < b, a, b)


@wp.func
def greater(a: real, b: real):
    """The greater of two numbers; see `lesser`."""
    return wp.where(a > b, a, b)
