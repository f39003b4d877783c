"""How a superquadric stands does not depend on what its axes are called."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fit.superquadric.geometry import superquadric, superquadric_inside_outside
from strategies.recovery.upright import faces_of, stand_upright

_LAID = {0: Rotation.from_euler("y", 90, degrees=True), 2: Rotation.identity(),
         1: Rotation.from_euler("x", -90, degrees=True)}


def test_a_cylinder_is_round_whichever_axis_is_upright() -> None:
    standing = stand_upright(superquadric((0.03, 0.03, 0.08), (0.1, 1.0), (0.4, 0.1, 0.08)))
    assert np.isclose(standing.section_exponent, 1.0)
    assert np.isclose(standing.profile_exponent, 0.1)
    assert np.isclose(standing.top_m, 0.16, atol=1e-3)
    assert np.isclose(standing.radius_m, 0.03, atol=1e-3)


def test_a_block_has_a_square_section_on_any_axis() -> None:
    for axis, turn in _LAID.items():
        stands = stand_upright(superquadric((0.03, 0.03, 0.03), (0.1, 0.1), (0.4, 0.1, 0.05),
                                            turn.as_quat()))
        assert np.isclose(stands.section_exponent, 0.1), axis
        assert np.allclose(np.abs(stands.axis[0]), [0, 0, 1], atol=1e-9)


@settings(max_examples=40)
@given(st.floats(0.1, 1.0), st.floats(0.1, 1.0), st.floats(-0.6, 0.6), st.floats(-3, 3),
       st.floats(-0.3, 0.3))
def test_faces_lie_on_the_surface_and_look_out(e1, e2, taper, yaw, tilt) -> None:
    turn = Rotation.from_euler("zx", [yaw, tilt]).as_quat()
    body = superquadric((0.03, 0.02, 0.06), (e1, e2), (0.4, 0.1, 0.06), turn, (taper, 0.0))
    points, normals = faces_of(body)
    assert np.allclose(np.linalg.norm(normals, axis=-1), 1.0)
    gauge = superquadric_inside_outside(body, points)
    assert np.allclose(gauge, 1.0, atol=0.02)
    assert (superquadric_inside_outside(body, points + 1e-3 * normals) > gauge).all()


def test_faces_of_a_bent_body_lie_on_its_surface() -> None:
    """A straight line from the middle towards an end leaves a banana through its side."""
    turn = Rotation.from_euler("yz", [90, 30], degrees=True).as_quat()
    body = superquadric((0.018, 0.018, 0.09), (0.8, 1.0), (0.4, 0.1, 0.018), turn, bend=(7.0, 0.4))
    points, normals = faces_of(body)
    assert np.allclose(superquadric_inside_outside(body, points), 1.0, atol=1e-6)
    # The ends look along the axis where it ends: turned by 7 / m times 0.09 m.
    along = Rotation.from_quat(turn).inv().apply(normals[0, 4:])
    assert np.allclose(np.abs(along[:, 2]), np.cos(7.0 * 0.09), atol=0.01)
