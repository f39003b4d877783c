"""Arrays from outside are checked before kernels index by them."""

import numpy as np
import pytest

from warpgrasp.core.array_checks import check_range
from warpgrasp.core.kernel_launch import ShapeError
from warpgrasp.geometry.body import distance_to_bodies, scene_of, signed_distance_to_bodies
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
