"""Arrays from outside are checked before kernels index by them."""

import numpy as np
import pytest

from warpgrasp.core.array_checks import check_kind, check_poses, check_range
from warpgrasp.core.dtypes import mat33, real, transform, vec3
from warpgrasp.core.kernel_launch import ShapeError, array_of, launch
from warpgrasp.geometry.body import distance_to_bodies, scene_of, signed_distance_to_bodies
from warpgrasp.geometry.scene import distance_kernel
from warpgrasp.objects.catalogue import body_from_name


@pytest.mark.parametrize("number", [-1, 3, np.nan, np.inf, 0.7, 2.0000001])
def test_what_is_no_whole_number_of_a_range_is_told(number: float) -> None:
    with pytest.raises(ValueError, match=r"body .*: wants 0 to 2"):
        check_range("body", np.array([0.0, 2.0, number]), 0, 2)


@pytest.mark.parametrize("numbers", [np.arange(3), np.array([0.0, 2.0]), np.zeros(0), 1])
def test_whole_numbers_of_a_range_pass(numbers: np.ndarray) -> None:
    check_range("body", numbers, 0, 2)


@pytest.mark.parametrize("ask", [distance_to_bodies, signed_distance_to_bodies])
def test_questions_about_bodies_are_checked(ask) -> None:
    """A body that is no number would be read from anywhere in memory."""
    scene = scene_of([body_from_name("block")], "cpu")
    with pytest.raises(ValueError, match="body nan: wants 0 to 0"):
        ask(scene, np.array([np.nan]), np.zeros((1, 2, 3)))
    for shape in ((2, 3), (1, 2, 2), (1, 2, 6)):
        with pytest.raises(ShapeError, match=r"points_m: of shape .*should be \(world, point, 3\)"):
            ask(scene, np.zeros(1, int), np.zeros(shape))


@pytest.mark.parametrize(("shape", "dtype"), [((2, 6), transform), ((14,), transform),
                                              ((3, 3, 2), mat33), ((0,), vec3)])
def test_rows_of_another_length_are_no_vectors(shape: tuple[int, ...], dtype: type) -> None:
    """Some were cut anew into vectors, others were an error of Warp."""
    with pytest.raises(ShapeError, match=f"shape .*; should end with .*{dtype.__name__}"):
        array_of(np.zeros(shape), dtype, "cpu")
    assert array_of(np.zeros((4, 7)), transform, "cpu").shape == (4,)
    assert array_of(np.zeros((4, 7)), real, "cpu").shape == (4, 7)


def test_no_array_is_told() -> None:
    """Warp takes None for an array at address 0, and the process ended."""
    scene = scene_of([body_from_name("block")], "cpu")
    with pytest.raises(ShapeError, match="'point' is NoneType, wants an array"):
        launch(distance_kernel, {"world": 1, "point": 1},
               {"body": "world", "point": "world point", "found": "world point"},
               {"scene": scene, "body": array_of(np.zeros(1), int, "cpu"), "point": None,
                "found": array_of(np.zeros((1, 1, 3)), vec3, "cpu")}, device="cpu")


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 0.0, 1.01])
def test_poses_are_places_and_unit_quaternions(wrong: float) -> None:
    pose = np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], (2, 3, 1))
    check_poses("pose", pose)
    pose[1, 2, 6] = wrong
    with pytest.raises(ValueError, match=r"pose: that of world 1 is .* of length 1"):
        check_poses("pose", pose)
    check_poses("pose", pose, pose[..., 6] == 1.0)


def test_kinds_are_told() -> None:
    check_kind("number", 1, int)
    check_kind("number", None, int, optional=True)
    for wrong, optional in ((None, False), ("1", True)):
        with pytest.raises(TypeError, match=r"number: is .*; should be of int"):
            check_kind("number", wrong, int, optional=optional)
