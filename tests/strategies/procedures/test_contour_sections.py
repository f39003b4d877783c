"""Contours of circles and linear segments, against profiles that are known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.procedures.contour_record import Axis, ContourExploration
from strategies.procedures.contour_sections import linear_segments, profile_by_sections
from strategies.procedures.contour_shape import match_profiles
from strategies.procedures.touches import EndReason, MissedTips, TouchTable

NODES = np.array([[0.0, 0.03], [0.102, 0.03], [0.142, 0.012], [0.20, 0.012]])
VOLUME = np.pi / 3 * sum((b[0] - a[0]) * (a[1]**2 + a[1] * b[1] + b[1]**2)
                         for a, b in pairwise(NODES))


def explored(noise_m: float, shift_m: float = 0.0, worlds: int = 2) -> ContourExploration:
    """Two touches a section of the upright body `NODES`, whose axis is `shift_m` beside the given
    one; the second world's thumb felt nothing."""
    z = np.arange(0.012, 0.2, 0.01)
    rng = np.random.default_rng(1)
    rows = []
    for world in range(worlds):
        for part, height in enumerate(z):
            radius = np.interp(height, *NODES.T)
            for finger, azimuth in ((3, -1.7), (0, 1.4)):
                if world == 1 and finger == 3:
                    continue
                way = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
                rows.append((world, part, finger, [0.45 + shift_m, 0.0, height]
                             + (radius + noise_m * rng.normal()) * way, way))
    world, part, finger, point, normal = (np.array(v) for v in zip(*rows, strict=True))
    zero = np.zeros(len(world), int)
    table = TouchTable(world, part, finger, zero, zero, point, normal,
                       np.zeros((len(world), 4)), zero, np.zeros((len(world), 16, 16)),
                       np.zeros((len(world), 7)), zero, zero)
    none = np.zeros(worlds)
    axis = Axis.upright(none + 0.45, none, none + 0.2, none + 0.03)
    return ContourExploration(table, np.full(worlds, EndReason.END_OF_OBJECT), axis, 3, none, none,
                              none, none, none, MissedTips(zero[:0], np.zeros((0, 3))))


def test_a_body_of_linear_segments_is_found_again() -> None:
    found = profile_by_sections(explored(0.0, shift_m=0.004))
    assert np.isfinite(found.height_m[0]).sum() <= 6
    np.testing.assert_allclose(found.foot_m[0], [0.454, 0.0, 0.0], atol=1e-9)
    assert found.largest_radius_m[0] == pytest.approx(0.03, abs=1e-9)
    # The sections end 8 mm below the top.
    top = np.pi * 0.008 * 0.012**2
    assert found.volume_m3[0] == pytest.approx(VOLUME - top, rel=0.01)
    assert found.length_m[0] == pytest.approx(0.192)
    assert np.isnan(found.volume_m3[1])
    assert np.isnan(found.largest_radius_m[1])


def test_noise_is_averaged_by_the_segments() -> None:
    exact, noisy = (profile_by_sections(explored(noise)) for noise in (0.0, 0.0005))
    assert noisy.volume_m3[0] == pytest.approx(exact.volume_m3[0], rel=0.02)
    assert np.isfinite(noisy.height_m[0]).sum() <= 8


def test_the_nearest_profile_is_matched_and_nothing_where_nothing_was_felt() -> None:
    thin = NODES * [1.0, 0.5]
    found = profile_by_sections(explored(0.0003))
    assert match_profiles(found, {"thin": thin, "true": NODES}) == ["true", ""]


def test_profiles_are_compared_over_the_taller_of_the_two() -> None:
    """0.3 mm too wide all along is more, in the mean, than a stalk of 0.4 mm that is as tall."""
    wide = NODES + [0.0, 0.0003]
    stalk = np.concatenate([NODES, [[0.2001, 0.0004], [0.4, 0.0004]]])
    found = profile_by_sections(explored(0.0))
    assert match_profiles(found, {"wide": wide, "stalk": stalk})[0] == "stalk"


def test_segments_split_only_where_a_line_is_not_enough() -> None:
    height = np.linspace(0.0, 0.1, 11)
    straight = linear_segments(height, 0.02 + 0.1 * height, 0.001)
    np.testing.assert_allclose(straight, [[0.0, 0.02], [0.1, 0.03]], atol=1e-12)
    bent = np.minimum(0.02 + 0.5 * height, 0.04)
    np.testing.assert_allclose(linear_segments(height, bent, 0.001),
                               [[0.0, 0.02], [0.04, 0.04], [0.1, 0.04]], atol=1e-12)


def test_an_axis_of_another_length_changes_nothing() -> None:
    one = explored(0.0)
    longer = replace(one, axis=replace(one.axis, direction=3.0 * one.axis.direction))
    np.testing.assert_allclose(profile_by_sections(longer).radius_m,
                               profile_by_sections(one).radius_m, atol=1e-12)


def test_the_axis_of_a_leaning_body_is_carried_down_to_the_table() -> None:
    """It passes beside the foot that was given, and meets the table higher or lower than that."""
    one, foot = explored(0.0, shift_m=0.008), [0.45, 0.0, 0.0]
    turn = Rotation.from_rotvec([0.0, 0.4, 0.0])
    touches = replace(one.touches, point_m=turn.apply(one.touches.point_m - foot) + foot,
                      normal=turn.apply(one.touches.normal))
    axis = replace(one.axis, direction=turn.apply(one.axis.direction))
    found = profile_by_sections(replace(one, touches=touches, axis=axis))
    along = turn.apply([0.0, 0.0, 1.0])
    beside = turn.apply([0.008, 0.0, 0.0]) + foot
    np.testing.assert_allclose(found.foot_m[0], beside - beside[2] / along[2] * along, atol=1e-9)
