"""Where procedures go, worked out for the upright cylinders of `beliefs`."""

from dataclasses import replace

import numpy as np
from beliefs import BODY, belief

from strategies.planners.next_procedure import contour_to_follow
from strategies.procedures.options import ContourTable

BOTH = np.ones(2, bool)


def test_a_contour_is_about_the_line_on_which_the_body_stands() -> None:
    axis = contour_to_follow(belief(), ContourTable(), BOTH).axis
    np.testing.assert_array_equal(axis.direction, [[0.0, 0.0, 1.0]] * 2)
    np.testing.assert_allclose(axis.foot_m[:, :2], BODY.position_m[:, :2])
    np.testing.assert_allclose(axis.foot_m[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(axis.length_m, 0.14, rtol=1e-6)


def test_a_wrong_axis_is_off_by_its_error_towards_an_azimuth_of_its_own() -> None:
    seeds = np.array([3, 4], np.uint64)
    wrong = contour_to_follow(replace(belief(), seed=seeds), ContourTable(axis_error_rad=0.2), BOTH)
    way = wrong.axis.direction
    np.testing.assert_allclose(np.arccos(way[:, 2]), 0.2)
    azimuth = np.arctan2(way[:, 1], way[:, 0])
    assert abs(azimuth[0] - azimuth[1]) > 0.01
    again = contour_to_follow(replace(belief(), seed=seeds[::-1]), ContourTable(axis_error_rad=0.2),
                              BOTH)
    np.testing.assert_array_equal(again.axis.direction, way[::-1])
