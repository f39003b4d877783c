"""Pads: readings rise with load, the centroid finds a sphere, parameters act as they say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warpgrasp.core.kernel_launch import ShapeError
from warpgrasp.geometry.body import Body, Part, scene_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import HandTable, PadTable
from warpgrasp.touch.pad import pad_of, read_pads
from warpgrasp.touch.tactile_image import moments

QUIET = PadTable(noise_counts=0.0, gain_spread=0.0, repeatability=0.0, dead_fraction=0.0)
STRAIGHT = np.zeros((4, 4))
PITCH_ACROSS, PITCH_ALONG = 0.0127 / 16, 0.0254 / 16
AWAY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def sphere(radius: float) -> Body:
    return Body("ball", (Part(Shape.SPHERE, size_m=(radius, 0.0, 0.0)),),
                (-radius, -radius, 0.0), (radius, radius, 2 * radius))


def hand_at(pad_point: np.ndarray, palmar: np.ndarray) -> np.ndarray:
    """Hand pose whose straight index finger has the middle of its distal pad's flat part there."""
    straight = QUIET.length_m - QUIET.wrap_rad * (0.008 + QUIET.thickness_m)
    local = np.array([-0.040 + 0.009, -0.028, 0.0095 + 0.104 - straight / 2])
    side = np.cross([0.0, 0.0, 1.0], palmar)
    if np.linalg.norm(side) < 1e-9:
        side = np.array([0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    turn = Rotation.from_matrix(np.stack([palmar, side, np.cross(palmar, side)], 1))
    return np.concatenate([pad_point - turn.apply(local), turn.as_quat()])


def press(body: Body, poses: np.ndarray, pads: PadTable, key: int = 7, reading: int = 0):
    n = len(poses)
    return read_pads(scene_of([body], "cpu"), np.zeros(1, int), np.tile(AWAY, (n, 1)), HandTable(),
                     pads, np.full(n, key, np.uint64), poses, np.tile(STRAIGHT, (n, 1, 1)),
                     reading=reading)


FLAT = (body_from_name("block"), np.array([-0.030, 0.0, 0.060]), np.array([1.0, 0.0, 0.0]))
EDGE = (body_from_name("block"), np.array([-0.030, -0.040, 0.060]),
        np.array([1.0, 1.0, 0.0]) / np.sqrt(2))
CURVED = (sphere(0.04), np.array([-0.04, 0.0, 0.04]), np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("pads", [PadTable(), QUIET, replace(PadTable(), law="inverse_power")],
                         ids=["default", "quiet", "inverse power"])
@pytest.mark.parametrize("contact", [FLAT, EDGE, CURVED], ids=["flat", "edge", "curved"])
def test_readings_rise_with_load_until_saturation(contact, pads: PadTable) -> None:
    body, point, palmar = contact
    depth = np.linspace(0.0, 0.0024, 33)
    poses = np.stack([hand_at(point + palmar * d, palmar) for d in depth])
    # One reading's noise is not part of load against reading; gains and dead taxels are.
    images = press(body, poses, replace(pads, noise_counts=0.0, repeatability=0.0))
    load = images.force_N[:, 0, 2].sum((1, 2))
    counts = images.counts[:, 0, 2].astype(int)
    assert (np.diff(load)[load[1:] > 0] > 0).all()
    assert (load > 0).mean() > 0.7
    assert (np.diff(counts, axis=0) >= 0).all()
    total = counts.sum((1, 2))
    assert (np.diff(total)[load[1:] > 0.3] > 0).all()
    assert counts[-1].max() == 255
    assert counts[0].max() == 0


def test_centroid_is_within_half_a_taxel_on_a_sphere_at_default_noise() -> None:
    body, point, palmar = CURVED
    rng = np.random.default_rng(5)
    n = 200
    offset = rng.uniform([-0.003, -0.003], [0.003, 0.003], (n, 2))
    poses = np.stack([hand_at(point + palmar * 0.0004 + [0.0, o[0], o[1]], palmar)
                      for o in offset])
    scene = scene_of([body], "cpu")
    images = read_pads(scene, np.zeros(1, int), np.tile(AWAY, (n, 1)), HandTable(), PadTable(),
                       np.arange(n).astype(np.uint64), poses, np.tile(STRAIGHT, (n, 1, 1)))
    found = moments(images.counts[:, 0, 2], level=3.0).centroid
    # Two round bodies touch where the line between the centres leaves the finger; the pad bends
    # with the finger across, so the lateral place is an arc.
    straight = QUIET.length_m - QUIET.wrap_rad * 0.009
    centre = np.stack([-offset[:, 1], -offset[:, 0]], 1)  # of the sphere, along and across
    row = (straight / 2 + centre[:, 0]) / PITCH_ALONG - 0.5
    sideways = np.arctan2(centre[:, 1], 0.04 + 0.009 - 0.0004) * 0.009
    column = sideways / PITCH_ACROSS + 7.5
    error = found - np.stack([row, column], 1)
    assert np.median(np.abs(error), axis=0).max() < 0.25
    assert (np.abs(error) < 0.5).mean() > 0.97


def test_gains_last_for_an_episode_and_differ_between_taxels() -> None:
    body, point, palmar = FLAT
    poses = np.stack([hand_at(point + palmar * 0.0005, palmar)])
    steady = replace(PadTable(), noise_counts=0.0, repeatability=0.0)
    first = press(body, poses, steady, reading=0).counts
    np.testing.assert_array_equal(first, press(body, poses, steady, reading=1).counts)
    assert (first != press(body, poses, steady, key=8).counts).any()
    noisy = PadTable()
    assert (press(body, poses, noisy, reading=0).counts
            != press(body, poses, noisy, reading=1).counts).any()


def test_no_two_pads_share_noise_or_dead_taxels() -> None:
    """Of taxels without load: one that never reads a count in many readings is dead."""
    pads = replace(PadTable(), middle=True, proximal=True, noise_counts=3.0, dead_fraction=0.5)
    far = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]])
    read = np.array([press(FLAT[0], far, pads, reading=n).counts[0].reshape(12, -1)
                     for n in range(30)])
    alive = (read > 0).any(0)
    assert alive.mean() == pytest.approx(0.5, abs=0.04)
    every = press(FLAT[0], far, replace(pads, dead_fraction=0.0)).counts[0].reshape(12, -1)
    for of_pads in (alive.astype(float), every.astype(float)):
        alike = np.corrcoef(of_pads) - np.eye(12)
        assert np.abs(alike).max() < 5 / np.sqrt(256)


def test_a_taxel_errs_by_its_repeatability_and_by_noise_apart() -> None:
    """Variances of both add up."""
    body, point, palmar = FLAT
    poses = np.tile(hand_at(point + palmar * 0.0004, palmar), (400, 1))

    def deviation(repeatability: float, noise: float) -> float:
        pads = replace(QUIET, repeatability=repeatability, noise_counts=noise)
        counts = read_pads(
            scene_of([body], "cpu"), np.zeros(1, int), np.tile(AWAY, (400, 1)), HandTable(), pads,
            np.arange(400).astype(np.uint64), poses, np.tile(STRAIGHT, (400, 1, 1))).counts[:, 0, 2]
        one = np.unravel_index(counts.mean(0).argmax(), (16, 16))
        assert 50 < counts[:, *one].mean() < 200
        return float(counts[:, *one].std())

    assert deviation(0.06, 6.0) == pytest.approx(
        np.hypot(deviation(0.06, 0.0), deviation(0.0, 6.0)), rel=0.12)


def test_dead_pads_read_nothing_and_pads_can_be_switched() -> None:
    body, point, palmar = FLAT
    poses = np.stack([hand_at(point + palmar * 0.0005, palmar)])
    assert press(body, poses, replace(PadTable(), dead_fraction=1.0)).counts.max() == 0
    more = press(body, poses, replace(PadTable(), middle=True)).counts
    assert more[0, :, 0].max() == 0
    assert more[0, :, 1].max() > 0


def test_false_touches_are_as_frequent_as_said() -> None:
    noisy = replace(PadTable(), noise_counts=2.0, threshold_counts=6.0)
    n = 400
    far = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (n, 1))
    images = read_pads(scene_of([FLAT[0]], "cpu"), np.zeros(1, int), np.tile(AWAY, (n, 1)),
                       HandTable(), noisy, np.arange(n).astype(np.uint64), far,
                       np.tile(STRAIGHT, (n, 1, 1)))
    seen = (images.counts[:, :, 2].max((2, 3)) >= 6).mean()
    told = noisy.false_touch_probability()
    assert abs(seen - told) < 4 * np.sqrt(told * (1 - told) / (4 * n))


@pytest.mark.parametrize("law", [
    {"least_ohm": 1e5}, {"least_ohm": 1e6}, {"law": "inverse_power", "newton_ohm": 1e6}])
def test_a_pad_that_no_force_makes_conduct_is_refused(law) -> None:
    with pytest.raises(ValueError, match="ohm under load"):
        pad_of(replace(PadTable(), **law), HandTable())


def test_a_pad_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="does not fit link 2"):
        pad_of(replace(PadTable(), length_m=0.045), HandTable())


def test_a_taxel_is_pressed_flat_beyond_its_thickness() -> None:
    """A finger laid ever deeper into a block: force by depth, soft first, then hardly giving."""
    pads = PadTable(gain_spread=0.0, dead_fraction=0.0)
    body = body_from_name("block")
    scene, stands = scene_of([body], "cpu"), np.array([[0, 0, 0, 0, 0, 0, 1.0]])
    q = np.zeros((1, 4, 4))
    q[:, :, 1] = np.pi / 2  # links lie level, palmar sides down
    reach = HandTable().link_radius_m + pads.thickness_m
    found = []
    for depth in (0.0005, 0.001, 0.0015):
        # Finger 1 lies along the top of the block, its distal link over the middle.
        height = body.high_m[2] + reach - depth - HandTable().abduction_offset_m
        pose = np.array([[-0.09 + HandTable().palm_gap_m / 2, 0, height, 0, 0, 0, 1.0]])
        found.append(read_pads(scene, np.zeros(1, int), stands, HandTable(), pads,
                               np.zeros(1, np.uint64), pose, q).force_N[0, 1, 2].max())
    # The columns nearest to the middle stand half a pitch aside on the round pad.
    lift = reach * (1.0 - np.cos(pads.width_m / 32 / reach))
    k, flat = pads.stiffness_N_m, pads.flat_stiffness_N_m
    soft, deep = np.array([0.0005, 0.001]) - lift, 0.0015 - lift - pads.thickness_m
    np.testing.assert_allclose(found, [*(soft * k), pads.thickness_m * k + deep * flat], rtol=1e-6)


@pytest.mark.parametrize(("name", "shape"), [
    ("hand_pose", (1, 6)), ("body_pose", (2, 7)), ("q_rad", (1, 3, 4)), ("q_rad", (1, 4, 3))])
def test_hands_of_another_shape_are_refused(name: str, shape: tuple[int, ...]) -> None:
    """Some were an error of Warp that named no argument."""
    pose = np.array([[0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    given = {"body_pose": pose, "hand_pose": pose, "q_rad": np.zeros((1, 4, 4))}
    given[name] = np.zeros(shape)
    with pytest.raises(ShapeError, match=f"{name}: of shape .*; should be "):
        read_pads(scene_of([body_from_name("block")], "cpu"), np.zeros(1, int), hand=HandTable(),
                  pads=PadTable(), key=np.zeros(1, np.uint64), **given)
