"""Faces and contours felt by hands of chains: what the Utah-MIT hand recovers, and that it ends."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.poses.postures import opposed_pair
from strategies.procedures.contour_follower import explore_contour
from strategies.procedures.contour_record import Axis
from strategies.procedures.contour_shape import profile_of, radius_at
from strategies.procedures.planar_explorer import explore_plane
from strategies.procedures.planar_faces import planes_of
from strategies.procedures.possible import NotPossible, check_possible, extended_of, opposed_of
from strategies.procedures.touches import EndReason
from warpgrasp.chain.chain_hand import chain_of
from warpgrasp.chain.chain_pairs import chain_opposed
from warpgrasp.chain.chain_postures import pad_axes
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable, PadTable, SensorTable
from warpgrasp.robot import Robot, Truth

HANDS = ("allegro", "leap", "barrett")
WORLDS = 4
CALIBRATED = replace(ErrorTable.none(), mount_m=5e-4, mount_rad=float(np.radians(0.2)))


def robot_of(kind: str, name: str, worlds: int = WORLDS) -> tuple[Robot, Truth]:
    """Robots on floating wrists, calibrated but for their mounts."""
    yaw = np.random.default_rng(3).uniform(-0.3, 0.3, worlds)
    pose = np.zeros((worlds, 7))
    pose[:, 0], pose[:, 5], pose[:, 6] = 0.45, np.sin(yaw / 2), np.cos(yaw / 2)
    truth = Truth(pose)
    return Robot([body_from_name(name)], np.zeros(1, int), truth,
                 np.arange(worlds).astype(np.uint64) + np.uint64(31), ArmTable(kind="none"),
                 HandTable(kind=kind), SensorTable(), errors=CALIBRATED), truth


@pytest.mark.parametrize("kind", HANDS)
@pytest.mark.parametrize(("point", "normal", "size"), [
    ((0.0, 0.0, 0.12), (0.0, 0.0, 1.0), (0.06, 0.08)),
    ((-0.03, 0.0, 0.06), (-1.0, 0.0, 0.0), (0.08, 0.12))])
def test_a_face_of_the_block_is_recovered(kind: str, point, normal, size) -> None:
    robot, truth = robot_of(kind, "block")
    rng = np.random.default_rng(4)
    turn = Rotation.from_quat(truth.body_pose[:, 3:])
    near = truth.body_pose[:, :3] + turn.apply(point) + rng.normal(0, 0.004, (WORLDS, 3))
    found = explore_plane(robot, near, turn.apply(normal)
                          + rng.normal(0, np.radians(4), (WORLDS, 3)))
    assert (found.reason == EndReason.COMPLETE).all()
    face = planes_of(found)
    off = np.degrees(np.arccos(np.clip((face.normal * turn.apply(normal)).sum(1), -1, 1)))
    assert np.median(off) < 1.0
    assert off.max() < 2.0
    height = (face.normal * (truth.body_pose[:, :3] + turn.apply(point))).sum(1) - face.offset_m
    assert np.abs(np.median(height)) < 1e-3
    felt = found.touches
    assert felt.q_rad.shape[1] == extended_of(robot.hand, robot.pads).commands_rad.shape[2]
    assert (felt.finger == extended_of(robot.hand, robot.pads).finger).all()
    # Both ways and across, the touches span most of the face (a low edge ends at the table).
    local = turn.inv()
    for w in range(WORLDS):
        mine = felt.point_m[(felt.world == w) & np.isfinite(felt.point_m).all(1)]
        span = np.sort(np.ptp(local[w].apply(mine - truth.body_pose[w, :3]), axis=0))
        assert span[2] > 0.7 * max(size)
        assert span[1] > 0.7 * min(size)


@pytest.mark.parametrize("kind", HANDS)
def test_the_contour_of_a_bottle_is_recovered(kind: str) -> None:
    name = "beer_bottle"
    contour = body_from_name(name).parts[0].profile_m
    robot, _ = robot_of(kind, name)
    error = np.random.default_rng(2).normal(0.0, 0.004, (WORLDS, 4))
    found = explore_contour(robot, Axis.upright(
        0.45 + error[:, 0], error[:, 1], contour[-1, 0] + error[:, 2],
        contour[:, 1].max() + error[:, 3]))
    ended = found.reason == EndReason.END_OF_OBJECT
    assert ended.mean() >= 0.8
    grid = np.linspace(0.04, 0.8 * np.nanmedian(found.found_m[ended]), 40)
    off = np.abs(radius_at(profile_of(found), grid)[ended] - np.interp(grid, *contour.T))
    assert np.median(off) < 1.5e-3
    assert set(found.touches.finger) == set(opposed_pair(robot.hand, robot.pads).fingers)


@pytest.mark.parametrize("kind", [*HANDS, "utah_mit"])
@pytest.mark.parametrize("said", [True, False])
def test_the_pads_of_a_pair_come_towards_each_other(kind: str, said: bool) -> None:
    """As its file says, and as it is found where the file says nothing."""
    model = hand_named(kind) if said else replace(hand_named(kind), opposed=None)
    chain = chain_of(model)
    pair = chain_opposed(chain, PadTable())
    assert pair is not None
    np.testing.assert_allclose(pair.axes.T @ pair.axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(pair.axes) == pytest.approx(1.0)
    ends = []
    for sign, f, commands, ball in zip((1.0, -1.0), pair.fingers, pair.commands_rad, pair.ball_m,
                                       strict=True):
        tip, axes, radius = pad_axes(chain, f, commands[f], PadTable())
        assert radius == ball
        across = sign * ((tip - pair.middle_m) @ pair.axes[:, 0])
        assert -across[0] > pair.widest_half_m + ball
        assert np.abs(np.diff(tip, axis=0)).max() < 1.5e-3
        assert sign * axes[0, :, 0] @ pair.axes[:, 0] > 0.25
        others = [g for g in range(chain.fingers) if g != f]
        assert (commands[others] == commands[others, :1]).all()
        np.testing.assert_array_equal(commands[:, 0], pair.open_rad[:, 0])
        ends.append(across.max())
    # Each comes to the middle, its pad's face past it.
    assert min(e + ball for e, ball in zip(ends, pair.ball_m, strict=True)) >= -1e-6


def test_what_a_hand_cannot_do_is_said(tmp_path) -> None:
    """A hand without pads extends no finger; one whose thumb has none has no opposed pair."""
    model = hand_named("leap")
    bare = replace(model, extended=None, opposed=None,
                   fingers=tuple(replace(f, pads=()) for f in model.fingers))
    alone = replace(model, opposed=None, fingers=tuple(
        replace(f, pads=() if f.name == model.thumb else f.pads) for f in model.fingers))
    files = [tmp_path / f"{n}.toml" for n in ("bare", "alone")]
    for file, hand in zip(files, (bare, alone), strict=True):
        file.write_text(hand_text(hand))
    first, second = (HandTable(kind=str(file)) for file in files)
    with pytest.raises(NotPossible, match=r"not_possible: planar .* leap has a pad on its"):
        extended_of(first, PadTable())
    with pytest.raises(NotPossible, match="no opposed pair"):
        opposed_of(first, PadTable())
    check_possible("planar", second, PadTable())
    for procedure in ("contour", "decide"):
        with pytest.raises(NotPossible, match="no opposed pair"):
            check_possible(procedure, second, PadTable())


@pytest.mark.parametrize("procedure", ["planar", "contour", "decide"])
def test_the_utah_mit_hand_without_pads_on_its_fingertips_feels_with_none(procedure: str) -> None:
    check_possible(procedure, HandTable(), PadTable(middle=True))
    with pytest.raises(NotPossible, match=r"^not_possible: .* utah_mit ha.* last link"):
        check_possible(procedure, HandTable(), PadTable(distal=False, middle=True))
