"""Bodies made by hand: what is none is refused before kernels read it."""

from typing import Any

import numpy as np
import pytest

from warpgrasp.geometry.body import Body, BodyError, Part, scene_of, signed_distance_to_bodies
from warpgrasp.geometry.scene import Join, Shape

GOOD: dict[Shape, dict[str, Any]] = {
    Shape.CYLINDER: {"size_m": (0.03, 0.0, 0.1)},
    Shape.BLOCK: {"size_m": (0.03, 0.05, 0.1)},
    Shape.CAPSULE: {"size_m": (0.03, 0.0, 0.1)},
    Shape.REVOLUTION: {"profile_m": np.array([[0.0, 0.03], [0.1, 0.02]])},
    Shape.SUPERQUADRIC: {"superquadric": (0.03, 0.03, 0.05, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)},
    Shape.GRID: {"grid_m": np.ones((2, 2, 2), np.float32), "grid_cell_m": 0.01},
}


@pytest.mark.parametrize(("shape", "changed", "said"), [
    (Shape.REVOLUTION, {"profile_m": np.zeros((0, 2))}, "profile_m = .* two rows"),
    (Shape.REVOLUTION, {"profile_m": np.array([[0.1, 0.03], [0.0, 0.03]])}, "z rising"),
    (Shape.REVOLUTION, {"profile_m": np.array([[0.0, 0.03], [0.1, np.nan]])}, "profile_m = "),
    (Shape.REVOLUTION, {"profile_m": np.array([[0.0, -0.03], [0.1, 0.03]])}, "no r negative"),
    (Shape.REVOLUTION, {"profile_m": np.array([0.0, 0.03, 0.1, 0.03])}, "profile_m = "),
    (Shape.REVOLUTION, {"profile_m": np.array([[0.0, 0.0], [0.1, 0.0]])}, "one above 0"),
    (Shape.GRID, {"grid_m": np.zeros((0, 0, 0), np.float32)}, "grid_m = .* at least two"),
    (Shape.GRID, {"grid_m": np.zeros((4, 4), np.float32)}, "grid_m = "),
    (Shape.GRID, {"grid_cell_m": 0.0}, "grid_cell_m = 0.0: a length above 0"),
    (Shape.GRID, {"grid_cell_m": np.inf}, "grid_cell_m = inf: a length above 0"),
    (Shape.GRID, {"grid_cell_m": "1"}, "grid_cell_m = '1': a length above 0"),
    (Shape.CYLINDER, {"size_m": (-0.03, 0.0, 0.1)}, r"size_m = .* of a cylinder"),
    (Shape.CYLINDER, {"size_m": (np.nan, 0.0, 0.1)}, "size_m = .nan"),
    (Shape.CYLINDER, {"size_m": (0.03, 0.1)}, "size_m = "),
    (Shape.BLOCK, {"size_m": (0.03, 0.0, 0.1)}, "size_m = .* of a block"),
    (Shape.CAPSULE, {"size_m": (0.03, 0.0, 0.05)}, "the height twice the radius"),
    (Shape.CYLINDER, {"place": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0)}, "place = .* of length 1"),
    (Shape.CYLINDER, {"place": (0.0, 0.0, 0.0)}, "place = .* seven numbers"),
    (Shape.CYLINDER, {"join": 9}, "join = 9: one of Join"),
    (Shape.SUPERQUADRIC, {"superquadric": (0.03, 0.03, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)},
     "exponents above 0 to 2"),
    (Shape.SUPERQUADRIC, {"superquadric": (-0.03, 0.03, 0.05, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)},
     "half axes above 0"),
    (Shape.SUPERQUADRIC, {"superquadric": (0.03, 0.03, 0.1, 1.0, 1.0, 0.0, 0.0, 10.5, 0.0)},
     "a bend from 0 to below 1 / the largest half axis"),
    (Shape.SUPERQUADRIC, {"superquadric": (0.03, 0.03, 0.05, 1.0, 1.0)}, "nine numbers"),
])
def test_parts_that_are_none_are_refused(shape: Shape, changed: dict[str, Any], said: str) -> None:
    """Distances to a profile or a grid of no node were read beyond it and ended Python; a
    quaternion of length 2 put a cylinder 0.6 m away; a falling profile had no inside."""
    Part(shape, **GOOD[shape])
    with pytest.raises(BodyError, match=said):
        Part(shape, **GOOD[shape] | changed)


def test_a_shape_is_one_that_there_is() -> None:
    with pytest.raises(BodyError, match="shape = 99: one of Shape is wanted"):
        Part(99)  # type: ignore[arg-type]


def test_bodies_that_are_none_are_refused() -> None:
    part = Part(Shape.CYLINDER, **GOOD[Shape.CYLINDER])
    low, high = (-0.03, -0.03, 0.0), (0.03, 0.03, 0.1)
    Body("can", (part,), low, high)
    for parts in ((), ("cylinder",), (Part(Shape.SPHERE, Join.DIFFERENCE, size_m=(0.01, 0, 0)),)):
        with pytest.raises(BodyError, match=r"can: parts = .*: one Part at least is wan"):
            Body("can", parts, low, high)  # type: ignore[arg-type]
    for box in ((high, low), ((np.nan, 0.0, 0.0), high), (low, (0.03, 0.03))):
        with pytest.raises(BodyError, match=r"can: \(low_m, high_m\) = .*the lower one first"):
            Body("can", (part,), *box)  # type: ignore[arg-type]


def test_a_shape_is_the_same_in_numbers_of_another_type() -> None:
    """Its hash, which seeds episodes, was another one."""
    low, high = (-1.0, -1.0, 0.0), (1.0, 1.0, 2.0)
    one, other = (Body("block", (Part(Shape.BLOCK, place=place, size_m=size),), low, high)
                  for place, size in (((0.0,) * 6 + (1.0,), (2.0, 2.0, 2.0)),
                                      ((0,) * 6 + (1,), (2, 2.0, np.float64(2.0)))))
    assert one.content == other.content


def test_points_may_be_a_list() -> None:
    body = Body("can", (Part(Shape.CYLINDER, **GOOD[Shape.CYLINDER]),), (-0.03, -0.03, 0.0),
                (0.03, 0.03, 0.1))
    points = [[[0.05, 0.0, 0.05], [0.0, 0.0, 0.09]]]
    found = signed_distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int),
                                      points)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, [[0.02, -0.01]], atol=1e-12)
