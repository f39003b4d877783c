"""What a robot is given is refused, with what would be right, before any kernel takes it."""

from typing import Any

import numpy as np
import pytest

from strategies.procedures.containment import explore_by_containment, padded_commands
from warpgrasp.arms.arm_file import arm_named
from warpgrasp.arms.arm_model import ArmError
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_model import HandError
from warpgrasp.mechanism.arm import serial_model
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth

POSE = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
KEY = np.arange(2, dtype=np.uint64)
HAND = np.array([0.45, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0])


def robot(truth: Truth, key: np.ndarray = KEY, body: int = 1, kind: str = "utah_mit") -> Robot:
    return Robot([body_from_name("block")], np.zeros(body, int), truth, key, ArmTable(),
                 HandTable(kind=kind), SensorTable())


@pytest.mark.parametrize("last", [(0, 0, 0, 2.0), (0, 0, 0, 0), (np.nan, 0, 0, 1)])
def test_a_true_pose_has_a_unit_quaternion(last: tuple[float, ...]) -> None:
    pose = POSE.copy()
    pose[1, 3:] = last
    with pytest.raises(ValueError, match=r"body_pose: that of world 1 is \[0.45, .* of length 1"):
        Truth(pose)


@pytest.mark.parametrize(("place", "value"), [(2, 0.06), (2, -0.01), (3, 0.1), (4, 0.1)])
def test_objects_stand_on_the_table(place: int, value: float) -> None:
    """The table is at z = 0 of the object's own frame: it was raised or tilted with it."""
    pose = POSE.copy()
    pose[1, place] = value
    pose[1, 6] = np.sqrt(1.0 - (pose[1, 3:6] ** 2).sum())
    tilted = robot(Truth(pose))
    with pytest.raises(ValueError, match=r"that of world 1 is .* what is touched stands on the t"):
        explore_by_containment(tilted, np.tile(HAND, (2, 1, 1)), np.ones((2, 1), bool), ("curl40",))
    finger = np.zeros((4, 1, 4))
    with pytest.raises(ValueError, match=r"that of world 1 is .* what is touched stands on the t"):
        tilted.guarded_line(np.arange(2), np.tile(HAND, (2, 1)), np.tile([0.0, 0.0, -1.0], (2, 1)),
                            interval_m=0.001, steps=5, finger=0, commands_rad=finger)


@pytest.mark.parametrize("pose", [POSE[:, :6], POSE[0], POSE[None]])
def test_true_poses_are_rows_of_seven(pose: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"body_pose: of shape .*; should be \(world, 7\)"):
        Truth(pose)
    with pytest.raises(TypeError, match="body_pose: is list; should be a NumPy array"):
        Truth(POSE.tolist())


def test_poses_keys_and_bodies_are_as_many() -> None:
    for key, body in ((KEY[:1], 1), (np.arange(3, dtype=np.uint64), 1), (KEY, 3)):
        with pytest.raises(ValueError, match="should be one of each a world"):
            robot(Truth(POSE), key, body)
    assert robot(Truth(POSE), body=2).worlds == 2


@pytest.mark.parametrize("kind", ["utah_mit", "allegro"])
def test_closing_paths_that_there_are_are_named(kind: str) -> None:
    with pytest.raises(KeyError, match="closing path 'curl41'; should be one of together, curl25"):
        explore_by_containment(robot(Truth(POSE), kind=kind), np.zeros((2, 1, 7)),
                               np.ones((2, 1), bool), ("curl41",))


def test_what_is_no_list_of_closing_paths_or_bodies_is_refused() -> None:
    for closings in ((), "curl40", (name for name in ("curl40",))):
        with pytest.raises(ValueError, match=r'closings: are .*; should be names such as'):
            padded_commands(closings)  # type: ignore[arg-type]
    for bodies in (["block"], body_from_name("block"), [], None):
        with pytest.raises(ValueError, match=r"bodies: are .*; should be a list of Body"):
            Robot(bodies, np.zeros(1, int), Truth(POSE), KEY,  # type: ignore[arg-type]
                  ArmTable(), HandTable(), SensorTable())


@pytest.mark.parametrize(("name", "kind"), [
    ("truth", "Truth"), ("arm", "ArmTable"), ("hand", "HandTable"), ("sensors", "SensorTable"),
    ("pads", "PadTable"), ("errors", "ErrorTable"), ("contact", "ContactTable"),
    ("true", "TrueTables")])
@pytest.mark.parametrize("wrong", [{}, "puma560", 1.0])
def test_tables_of_another_kind_are_refused(name: str, kind: str, wrong: Any) -> None:
    """An empty dictionary was taken for the default arm."""
    given: dict[str, Any] = {"truth": Truth(POSE), "arm": ArmTable(), "hand": HandTable(),
                             "sensors": SensorTable()} | {name: wrong}
    with pytest.raises(TypeError, match=f"{name}: is .*; should be of {kind}"):
        Robot([body_from_name("block")], np.zeros(1, int), key=KEY, **given)


def test_rehearsals_are_of_worlds_that_there_are() -> None:
    """World -1 was the last one."""
    own = robot(Truth(POSE))
    assert own.rehearsing(np.array([1, 1, 0])).worlds == 3
    for wrong, kind in ((np.array([-1]), ValueError), (np.array([2]), ValueError),
                        (np.ones(2, bool), TypeError), ([0], TypeError)):
        with pytest.raises(kind, match="rows"):
            own.rehearsing(wrong)  # type: ignore[arg-type]


def test_a_rehearsal_goes_on_where_its_worlds_are_noise_and_all() -> None:
    own = robot(Truth(POSE))
    asked: dict[str, Any] = {"direction": np.zeros((2, 3)), "interval_m": 0.0, "steps": 3,
                             "finger": 1, "commands_rad": np.zeros((4, 4, 4))}
    high = np.tile(HAND + [0.0, 0.0, 0.15, 0, 0, 0, 0], (2, 1))
    own.guarded_line(np.arange(2), high, **asked)
    own.guarded_line(np.ones(1, int), high[:1], **asked | {"direction": np.zeros((1, 3))})
    commands, count = padded_commands(("curl40",))
    first = own.rehearsing().grasp(high[:, None], np.ones((2, 1), bool), commands, count)
    turned = own.rehearsing(np.array([1, 0]))
    line, grasp = (turned.guarded_line(np.arange(2), high, **asked),
                   turned.grasp(high[:, None], np.ones((2, 1), bool), commands, count))
    felt = own.guarded_line(np.arange(2), high, **asked)
    np.testing.assert_array_equal(line.q_rad[::-1], felt.q_rad)
    np.testing.assert_array_equal(grasp.closing.q_rad[::-1], first.closing.q_rad)
    assert (felt.q_rad[0] != felt.q_rad[1]).all()
    assert own.line_count == 3


@pytest.mark.parametrize(("room", "made"), [(1, 1), (8, 1), (9, 2), (16, 2), (17, 3)])
def test_poses_are_left_out_once_all_closings_of_those_before_fill_the_room(
        room: int, made: int) -> None:
    """Each of three poses is closed at twice, by four fingers."""
    poses = np.tile(HAND + [0.0, 0.0, 0.15, 0, 0, 0, 0], (2, 3, 1))
    commands, count = padded_commands(("curl40", "curl25"))
    found = robot(Truth(POSE)).grasp(poses, np.ones((2, 3), bool), commands, count,
                                     np.array([room, 100]))
    tried = (found.moves.status != ProbeStatus.NOT_TRIED).all(2)
    np.testing.assert_array_equal(tried.sum(1), [made, 3])
    np.testing.assert_array_equal(tried[0], np.arange(3) < made)


def test_a_hand_or_arm_that_is_none_names_those_there_are() -> None:
    with pytest.raises(HandError, match=r"hand 'alegro'; should be one of utah_mit, allegro, "):
        robot(Truth(POSE), kind="alegro")
    with pytest.raises(ArmError, match="arm 'ur5'; should be one of ur5e, panda, puma560, none, "):
        serial_model(ArmTable(kind="ur5"))


def test_a_file_of_a_hand_or_arm_ends_in_toml() -> None:
    for named, kind in ((hand_named, HandError), (arm_named, ArmError)):
        with pytest.raises(kind, match=r"'./my_own'; .* or a TOML file, whose name ends in \.toml"):
            named("./my_own")


def test_poses_of_the_hand_that_are_wanted_have_unit_quaternions() -> None:
    pose = np.tile([0.45, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0], (2, 2, 1))
    pose[1, 1, 3:] *= 1.01
    own = robot(Truth(POSE))
    commands = np.zeros((1, 4, 2, 4))
    wanted = np.ones((2, 2), bool)
    with pytest.raises(ValueError, match=r"hand_pose: that of world 1 is .* of length 1"):
        own.grasp(pose, wanted, commands, np.array([2]))
    with pytest.raises(ValueError, match=r"hand_pose: that of world 1 is .* of length 1"):
        own.guarded_line(np.arange(2), pose[:, 1], np.zeros((2, 3)), interval_m=1e-3, steps=2,
                         finger=1, commands_rad=np.zeros((4, 2, 4)))
    wanted[1, 1] = False
    own.grasp(pose, wanted, commands, np.array([2]))


def test_poses_and_masks_of_other_shapes_and_kinds_are_refused() -> None:
    pose, wanted = np.tile([0.45, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0], (2, 3, 1)), np.ones((2, 3), bool)
    own = robot(Truth(POSE))
    closes = np.ones((2, 3, 4), bool)
    right: dict[str, Any] = {"hand_pose": pose, "wanted": wanted, "closings": ("curl40",)}
    for name, value, kind, says in (
            ("hand_pose", pose[0], ValueError, r"of shape \(3, 7\); should be \(world 2, probe, 7"),
            ("hand_pose", pose[..., :6], ValueError, r"should be \(world 2, probe, 7\)"),
            ("hand_pose", pose.tolist(), TypeError, "is list; should be a NumPy array"),
            ("wanted", wanted[:, :2], ValueError, r"should be \(world 2, probe 3\)"),
            ("wanted", wanted * 1.0, TypeError, "is of float64; should be of bool"),
            ("room", 4, TypeError, "is int; should be a NumPy array of numbers"),
            ("closes", closes[..., :3], ValueError, r"\(world 2, probe 3, finger 4\)"),
            ("closes", closes * 1, TypeError, "is of int64; should be of bool")):
        given: dict[str, Any] = {**right, name: value}
        with pytest.raises(kind, match=f"{name}: .*{says}"):
            explore_by_containment(own, **given)


def test_a_device_that_is_not_here_is_refused_by_the_names_of_those_that_are() -> None:
    with pytest.raises(ValueError, match=r"device: there is no 'gpu' here; there are: cpu"):
        Robot([body_from_name("block")], np.zeros(1, int), Truth(POSE), KEY, ArmTable(),
              HandTable(), SensorTable(), device="gpu")


def test_keys_and_numbers_of_bodies_are_whole() -> None:
    for key in (np.zeros(2), [0, 1]):
        with pytest.raises(TypeError, match=r"key: .*; should be .*of whole numbers, \(world,\)"):
            robot(Truth(POSE), key)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"key: of shape \(2, 1\); should be \(world,\)"):
        robot(Truth(POSE), KEY[:, None])
    with pytest.raises(TypeError, match="body: is of float64; should be of whole numbers"):
        Robot([body_from_name("block")], np.zeros(1), Truth(POSE), KEY, ArmTable(), HandTable(),
              SensorTable())


@pytest.mark.parametrize(("changed", "error", "said"), [
    ({"commands_rad": np.zeros((4, 0, 4))}, ValueError, r"commands_rad: of shape \(4, 0, 4\); "),
    ({"commands_rad": np.zeros((0, 1, 4))}, ValueError, r"commands_rad: of shape \(0, 1, 4\); "),
    ({"commands_rad": np.full((4, 1, 4), np.nan)}, ValueError,
     r"commands_rad: is nan at \(0, 0, 0\); should be finite"),
    ({"commands_rad": [[[0.0] * 4]] * 4}, TypeError, "commands_rad: is list; should be a NumPy"),
    ({"rows": np.array([0, -1])}, ValueError, "rows -1: wants 0 to 1"),
    ({"rows": np.array([0, 2])}, ValueError, "rows 2: wants 0 to 1"),
    ({"rows": np.ones(2, bool)}, TypeError, "rows: is of bool; should be of whole numbers"),
    ({"rows": np.zeros(2, int)}, ValueError, r"rows: are \[0, 0\]; should name a world only once"),
    ({"rows": np.zeros(1, int)}, ValueError, r"hand_pose: of shape \(2, 7\); should be \(row 1, "),
    ({"direction": np.full((2, 3), np.nan)}, ValueError, r"direction: is nan at \(0, 0\); should"),
    ({"direction": np.array([0.0, 0.0, -1.0])}, ValueError, r"direction: of shape \(3,\); should"),
    ({"interval_m": np.inf}, ValueError, "interval_m: is inf; should be finite"),
    ({"interval_m": np.full(3, 0.001)}, ValueError, r"interval_m: of shape \(3,\); should be one"),
    ({"interval_m": -0.001}, ValueError, "interval_m: is -0.001; should be 0 or more"),
    ({"interval_m": np.array([0.0, -0.001])}, ValueError, "interval_m: is -0.001; should be 0 or"),
    ({"direction": np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])}, ValueError,
     r"direction: is \[0.0, 0.0, 2.0\]; should be of length 1 at most"),
    ({"steps": -1}, ValueError, "steps -1: wants 0 to"),
    ({"steps": 2.5}, ValueError, "steps 2.5: wants 0 to"),
    ({"until": 2}, ValueError, "until 2: wants 0 to 1"),
])
def test_lines_that_cannot_be_made_are_refused(changed: dict[str, Any], error: type[Exception],
                                               said: str) -> None:
    """Commands of no step were read beyond their end and ended Python; row -1 read the robot before
    the first; lines along no number ended `unreachable` with a path of NaN; a negative interval
    was taken off the path."""
    asked = {"rows": np.arange(2), "hand_pose": np.tile(HAND, (2, 1)),
             "direction": np.tile([0.0, 0.0, -1.0], (2, 1)), "interval_m": 0.001, "steps": 5,
             "finger": 0, "commands_rad": np.zeros((4, 1, 4))}
    with pytest.raises(error, match=said):
        robot(Truth(POSE)).guarded_line(**asked | changed)
    assert robot(Truth(POSE)).guarded_line(**asked).steps.shape == (2,)


def test_commands_of_a_grasp_are_numbers() -> None:
    """Fingers that closed along NaN ended with `no_contact`, as if there were no object."""
    commands, count = padded_commands(("curl40",))
    wanted = np.ones((2, 1), bool)
    for value in (np.nan, np.inf):
        with pytest.raises(ValueError, match=r"commands_rad: is .* at \(0, 0, 0, 0\); should be f"):
            robot(Truth(POSE)).grasp(np.tile(HAND, (2, 1, 1)), wanted, commands + value, count)
    with pytest.raises(TypeError, match="commands_rad: is list; should be a NumPy array"):
        robot(Truth(POSE)).grasp(np.tile(HAND, (2, 1, 1)), wanted,
                                 commands.tolist(), count)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["utah_mit", "allegro"])
def test_commands_of_a_grasp_are_of_the_hands_own_joints(kind: str) -> None:
    """Of hands of chains a joint more was left out, and a joint less named no argument."""
    commands, count = padded_commands(("curl40",), HandTable(kind=kind))
    own, pose = robot(Truth(POSE), kind=kind), np.tile(HAND, (2, 1, 1))
    wanted, told = np.ones((2, 1), bool), r"commands_rad: .* \(grasp, finger 4, step, joint 4\)"
    more = np.concatenate([commands, commands[..., :1]], -1)
    for wrong in (commands[..., :-1], more, commands[:, :-1]):
        with pytest.raises(ValueError, match=told):
            own.grasp(pose, wanted, wrong, count)
    with pytest.raises(ValueError, match="number of grasps 0: wants 1 to"):
        own.grasp(pose, wanted, commands[:0], count[:0])
