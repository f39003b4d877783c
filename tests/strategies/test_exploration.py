"""The loop of an episode: orders, budgets, strategies that fail, results that depend on nothing
but their own world."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import HELPERS

from strategies import exploration
from strategies.exploration import explore
from strategies.exploration_record import Exploration
from strategies.planners import register
from strategies.planners.from_strategy import MOST_STEPS, Budget, budget_of
from strategies.planners.ordered import OrderedPlanner
from strategies.planners.planner_file import PlannerError
from strategies.planners.probes import Grasp
from strategies.planners.registry import make_planner
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import BoundingCylinder, Ring
from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.ready_made import STRATEGIES
from strategies.recovery import refit_policy
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.refit_policy import Fitted, refitted
from strategies.strategy import Strategy
from warpgrasp.core.random import counter_key
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, FitTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth
from warpgrasp.touch.line_touch import LineTouch, Until

MINE = HELPERS / "mine.py"
QUICK = FitTable()
CLOSINGS = ("curl40",)


def run(planner, episodes=(0, 1), name="large_cylinder", budget: Budget | None = None,
        table: FitTable = QUICK, closings=CLOSINGS, observe=None) -> Exploration:
    worlds = len(episodes)
    key = counter_key(7, np.asarray(episodes))
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (worlds, 1))
    body = body_from_name(name)
    robot = Robot([body], np.zeros(1, int), Truth(pose), key, ArmTable(), HandTable(),
                  SensorTable())
    one = np.ones(worlds)
    prior = BoundingCylinder(0.45 * one, 0.0 * one, float(np.hypot(*body.high_m[:2])) * one,
                            body.high_m[2] * one)
    return explore(robot, planner, prior, key, table=table, closings=closings, budget=budget,
                   observe=observe)


def ordered(*order: str, count: int = 6, refit_every: int = 0) -> OrderedPlanner:
    strategy = Strategy("s", (Ring(count=count),), order=order, refit_every=refit_every)
    return OrderedPlanner(strategy, PlanarTable(faces=1), ContourTable(), DecideTable())


def mine(name: str, **options):
    return make_planner(f"{MINE}:{name}", options)


def test_a_users_function_and_class_run() -> None:
    found = run(mine("one_ring"))
    assert (found.status == "ok").all()
    assert not found.fault.any()
    assert [p.name for p in found.procedures] == ["containment"]
    assert found.belief.step == 1
    assert (found.belief.touches > 8).all()
    several = run(mine("Several", count=3))
    assert [p.step for p in several.procedures] == [0, 1, 2]
    assert np.array_equal(several.belief.evidence.mask.sum(1) > 0, [True, True])


def test_poses_that_were_rounded_are_taken() -> None:
    """They ended the command, or the unit of a study."""
    found = run(mine("rounded"))
    assert (found.status == "ok").all()
    assert (found.belief.touches > 8).all()


@pytest.mark.parametrize(("name", "options"), [
    ("expected-error", {"length_m": 0}), ("expected-error", {"length_m": float("nan")}),
    ("expected-error", {"per_second": "no"}), ("oracle", {"tried": 0}), ("oracle", {"tried": 2.5})])
def test_options_that_make_no_planner_are_refused(name: str, options: dict) -> None:
    """Episodes without a touch came of them, or the opposite of what was asked."""
    with pytest.raises(PlannerError, match=f"{next(iter(options))} is"):
        make_planner(name, options)


@pytest.mark.parametrize(("name", "says", "worlds"), [
    ("raises", "mine.py:31: raises: IndexError", [True, True]),
    ("wrong_shape", "shape (2, 7)", [True, True]),
    ("not_finite", "not finite: probe 2", [False, True]),
    ("through_the_table", "through the table (z below 0): probe 0", [True, False]),
    ("answers_with_none", "answers_with_none: answered with None; should be a list of Grasp, ",
     [True, True]),
    ("one_grasp", "one_grasp: answered with Grasp; should be a list of Grasp, ", [True, True]),
    ("a_word", "a_word: answered with str; should be a list of Grasp, ", [True, True]),
    ("a_list_of_words", "answered with str in a list; should be a list of ", [True, True]),
    ("leaves", "leaves: SystemExit: 3", [True, True]),
    ("unknown_closing", "Grasp.closings is ('curl99',); should be", [True, True]),
    ("a_set_of_closings", "; should be a tuple of names of: ", [True, True]),
    ("no_interval", "PlanarOptions.interval_m is 0.0; should be from", [True, True]),
    ("face_without_end", "a face whose direction has no length, or none", [True, True]),
    ("writes_to_its_uncertainty", "assignment destination is read-only", [True, True]),
    ("face_of_nan", "a face that is not finite: probe 0", [True, False]),
    ("axis_without_radius", "an axis whose radius is not above 0: probe ", [True, True]),
    ("axis_of_words", "FollowContour.axis.radius_m is <U4 of shape (2,); should be numbers of ",
     [True, True]),
    ("too_many_poses", "Grasp.hand_pose has 300,000,000 rows a world; should have at most 10,000",
     [True, True]),
    ("masked_pose", "Grasp.hand_pose is a masked array; should be a plain one", [True, True]),
    ("axis_without_length", "an axis whose direction has no length, or none", [True, True]),
])
def test_a_broken_strategy_is_a_status_with_file_and_line(name, says, worlds) -> None:
    found = run(mine(name))
    assert np.array_equal(found.status == "strategy_failed", worlds)
    assert np.array_equal(found.fault != "", worlds)
    for text in found.fault[worlds]:
        assert says in text
        assert text.startswith("mine.py:")
        assert "\n" not in text


def test_fingers_of_a_grasp_are_checked_and_close_alone() -> None:
    def one_finger(fingers: np.ndarray):
        asked = iter([True, False])

        def planner(belief: Belief):
            poses = waypoint_poses((Ring(count=6),), belief.prior, belief.hand, belief.seed)
            return [Grasp(poses, np.full((2, 6), next(asked)), fingers=fingers)]

        return run(planner)

    wrong = one_finger(np.ones((2, 6, 3), bool))
    assert "Grasp.fingers is bool of shape (2, 6, 3); should be bool of shape (2, 6, 4)" in str(
        wrong.fault[0])
    fingers = np.zeros((2, 6, 4), bool)
    fingers[0, :, 1] = fingers[1, 0, :3] = True
    found, every = one_finger(fingers), one_finger(np.ones((2, 6, 4), bool))
    made = every.procedures[0].felt.moves.status[:, :, 0] == ProbeStatus.CONTACT
    assert made.sum() > 2
    # A pose at which none closes is not made.
    assert found.belief.touches.tolist() == [made[0].sum(), 3 * made[1, 0]]


def test_each_world_is_told_its_own_fault() -> None:
    def low(belief: Belief) -> list[Grasp]:
        poses = waypoint_poses((Ring(),), belief.prior, belief.hand, belief.seed)[:, :3].copy()
        poses[[0, 1], [2, 1], 2] = [-0.01, -0.02]
        return [Grasp(poses, np.ones((2, 3), bool))]

    found = run(low)
    assert ": probe 2: [" in found.fault[0]
    assert ": probe 1: [" in found.fault[1]
    assert "-0.02 " in found.fault[1]


def test_a_fault_does_not_depend_on_the_worlds_beside_it() -> None:
    """It is a row's note, and rows are the same alone, in a longer unit and in a race."""
    def low(belief: Belief) -> list[Grasp]:
        return [Grasp(np.tile([0.45, 0.0, -0.01, 1.0, 0.0, 0.0, 0.0], (belief.worlds, 1, 1)))]

    beside, alone = (run(low, episodes).fault for episodes in ((0, 1), (1,)))
    assert beside[1] == alone[0] != ""


def test_an_error_that_cannot_be_told_is_a_fault_too() -> None:
    class Silent(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    def fails(belief: Belief) -> list[Grasp]:
        raise Silent

    found = run(fails)
    assert (found.status == "strategy_failed").all()
    assert "fails: Silent" in found.fault[0]


@pytest.mark.parametrize("array", [
    lambda belief: belief.prior.radius_m, lambda belief: belief.evidence.points_m,
    lambda belief: belief.body.size_m, lambda belief: belief.active])
def test_a_strategy_cannot_write_into_what_it_is_handed(array) -> None:
    """What the run itself goes on with would be changed."""

    def writes(belief: Belief) -> list[Grasp]:
        array(belief)[:] = 0
        return []

    found = run(writes)
    assert (found.status == "strategy_failed").all()
    assert "read-only" in found.fault[0]


def test_a_strategy_that_never_ends_is_stopped() -> None:
    found = run(mine("never_ends"), episodes=(0,), table=QUICK,
                budget=Budget(touches=40))
    assert found.belief.touches[0] >= 40
    assert found.belief.step <= MOST_STEPS
    assert not found.stopped.any()


def test_steps_are_counted_in_each_world() -> None:
    asked = iter(range(99))

    def in_turn(belief: Belief) -> list[Grasp]:
        poses = waypoint_poses((Ring(),), belief.prior, belief.hand, belief.seed)[:, :1]
        return [Grasp(poses, (np.arange(2) == next(asked) % 2)[:, None])]

    found = run(in_turn, budget=Budget(steps=3))
    assert found.stopped.all()
    assert found.belief.step == 6
    assert [np.sum([p.took_part for p in found.procedures], 0).tolist()] == [[3, 3]]


def test_an_order_given_in_advance_is_carried_out_to_its_end(
        monkeypatch: pytest.MonkeyPatch) -> None:
    most = 6
    monkeypatch.setattr("strategies.planners.from_strategy.MOST_STEPS", most)
    strategy = Strategy("s", (Ring(count=most + 2, palm_clearance_m=0.3),),
                        order=("containment", "contour"), refit_every=1)
    found = run(OrderedPlanner(strategy, PlanarTable(), ContourTable(), DecideTable()),
                episodes=(0,), budget=budget_of(strategy))
    assert found.belief.step == most + 3
    assert found.procedures[-1].name == "contour"
    assert not found.stopped.any()
    assert budget_of(replace(strategy, call="even")).steps == most


def test_planners_that_cannot_be_made_say_why(tmp_path: Path) -> None:
    for call, options, says in (
            ("nonsense", {}, "no strategy 'nonsense'; there are: "),
            (f"{MINE}:nonsense", {}, "has no function or class 'nonsense'"),
            (f"{tmp_path}/absent.py:f", {}, "cannot be read"),
            (f"{MINE}:one_ring", {"count": 1}, "takes no options"),
            (f"{MINE}:Several", {"size": 1}, "has no option 'size'; there are: count")):
        with pytest.raises(PlannerError, match=None) as error:
            make_planner(call, options)
        assert says in str(error.value)
    idle = tmp_path / "idle.py"
    idle.write_text("class Idle:\n    pass\n\nclass Deaf:\n    def __call__(self):\n"
                    "        return []\n\ndef nothing():\n    return None\n"
                    "class Fussy:\n    def __init__(self, size):\n        raise ValueError('no')\n")
    with pytest.raises(PlannerError, match=r"cannot take the options .*size.*: ValueError: no"):
        make_planner(f"{idle}:Fussy", {"size": 1})
    for name, made in (("Idle", "an? Idle"), ("Deaf", "a Deaf"), ("nothing", "a NoneType")):
        with pytest.raises(PlannerError, match=rf"gives {made} that cannot be asked; .*__call__"):
            make_planner(f"{idle}:{name}", {})
    broken = tmp_path / "broken.py"
    broken.write_text("import numpy\n\nx = 1 / 0\n")
    with pytest.raises(PlannerError, match=r"broken\.py:3: ZeroDivisionError"):
        make_planner(f"{broken}:f", {})
    broken.write_text("def f(:\n")
    with pytest.raises(PlannerError, match=r"broken\.py:1: SyntaxError"):
        make_planner(f"{broken}:f", {})


def test_the_decorator_registers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(register.PLANNERS, "registered-by-a-test", ())  # gone when the test ends
    found = register.planner("registered-by-a-test")(lambda belief: [])
    assert make_planner("registered-by-a-test", {}) is found


def test_budgets_end_an_episode() -> None:
    by_touches = run(ordered("containment", refit_every=1), budget=Budget(touches=10))
    reached = by_touches.belief.touches
    assert ((reached >= 10) & (reached < 10 + 4)).all()
    by_time = run(ordered("containment", refit_every=1), budget=Budget(robot_time_s=15.0))
    assert (by_time.belief.time_s >= 15.0).all()
    assert (by_time.belief.time_s < 40.0).all()
    whole = run(ordered("containment", refit_every=1, count=12), table=QUICK)
    sure = run(ordered("containment", refit_every=1, count=12), table=QUICK,
               budget=Budget(volume_ratio=30.0))
    assert (sure.belief.touches < whole.belief.touches).all()


@pytest.mark.parametrize("order", ["contour", "planar"])
def test_misses_count_as_touches_for_pads_too(
    order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every guarded line until contact that was made, felt or not, and the time of each line."""
    made, felt, time = np.zeros(2, int), np.zeros(2, int), np.zeros(2)
    guarded_line = Robot.guarded_line

    def counted(robot: Robot, rows: np.ndarray, *given: Any, **also: Any) -> LineTouch:
        touch = guarded_line(robot, rows, *given, **also)
        until_contact = also.get("until", Until.CONTACT) == Until.CONTACT
        stands = np.isin(touch.status, (ProbeStatus.UNREACHABLE, ProbeStatus.COLLISION))
        made[rows] += until_contact & ~stands
        felt[rows] += until_contact & (touch.status == ProbeStatus.CONTACT)
        time[rows] += touch.time_s
        return touch

    monkeypatch.setattr(Robot, "guarded_line", counted)
    belief = run(ordered(order)).belief
    assert np.array_equal(belief.touches, made)
    assert (made > felt).all()
    assert (felt > 10).all()
    assert belief.time_s == pytest.approx(time)


@pytest.mark.parametrize("touches", [12, 22])
def test_grasps_that_cannot_be_made_use_up_no_touches(touches: int) -> None:
    """A batch is cut where it would have been, had its poses been asked for one by one."""
    def some_barred(every: int) -> Exploration:
        low = Ring(count=5, palm_clearance_m=-0.01)  # the hand strikes the object
        strategy = Strategy("s", (low, Ring(count=9)), refit_every=every)
        return run(OrderedPlanner(strategy, PlanarTable(), ContourTable(), DecideTable()),
                   episodes=(0, 1, 2), budget=Budget(touches=touches))

    at_once, one_by_one = some_barred(0), some_barred(1)
    assert (one_by_one.belief.touches >= touches).all()
    assert np.array_equal(at_once.belief.touches, one_by_one.belief.touches)
    assert np.allclose(at_once.belief.time_s, one_by_one.belief.time_s, rtol=1e-12)  # sums' order
    for world in range(3):
        a, b = (np.concatenate([p.felt.closing.q_rad[world].reshape(-1, 4) for p in f.procedures])
                for f in (at_once, one_by_one))
        assert np.array_equal(a[np.isfinite(a).all(1)], b[np.isfinite(b).all(1)])
    assert at_once.belief.step == 1


def test_orders_repeat_and_share_out_their_waypoints() -> None:
    found = run(ordered("containment", "planar", "containment"), name="block")
    names = [p.name for p in found.procedures]
    assert names == ["containment", "planar", "containment"]
    shapes = [p.felt.closing.status.shape[1] for p in found.procedures if p.name == "containment"]
    assert shapes == [3, 3]
    assert found.belief.evidence.mask.shape[1] == sum(p.slots for p in found.procedures)
    assert len(found.belief.faces) == 1


@pytest.mark.slow
def test_grasps_after_a_contour_are_fitted_from_scratch(monkeypatch: pytest.MonkeyPatch) -> None:
    """A contour that explains what pads felt spares fits of pads alone: bodies refined from the
    contour's own to twelve grasps ended up to 23 mm off, and their contacts barred the contour."""
    scratch: list[int] = []

    def counted(felt, links, table, **options):
        scratch.append(int((felt.mask & ~felt.by_pad).sum()))
        return recover_bodies(felt, links, table, **options)

    monkeypatch.setattr(refit_policy, "recover_bodies", counted)
    found = run(ordered("contour", "containment"), (0,), "large_cylinder")
    assert found.recovered.revolution is not None
    assert len(scratch) == 2
    assert scratch[0] == 0 < scratch[1]


def test_a_needle_among_its_touches_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was, and `decide` crossed the faces of what was not there."""

    def needle(felt, links, table, **options):
        fits, placed = recover_bodies(felt, links, table, **options)
        return replace(fits, size_m=fits.size_m * [1e-3, 1e-3, 1.0]), placed

    monkeypatch.setattr(refit_policy, "recover_bodies", needle)
    found = run(ordered("containment"))
    assert (found.status == "fit_implausible").all()
    assert np.allclose(found.belief.body.size_m[:, 0], found.belief.prior.radius_m)


def test_a_body_that_contacts_contradict_is_no_result_but_is_gone_on_by(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Fingers that stop at one another make such bodies."""

    def contradicted(*arguments: Any) -> Fitted:
        last = refitted(*arguments)
        placed = replace(last.placed, contradiction=np.full(last.placed.mask.shape, 50.0))
        return replace(last, placed=placed, rough=np.zeros_like(last.rough))

    monkeypatch.setattr(exploration, "refitted", contradicted)
    seen: list[tuple[Belief, Recovered]] = []
    found = run(ordered("containment", refit_every=3),
                observe=lambda belief, recovered: seen.append((belief, recovered)))
    assert len(seen) > 1
    assert (found.status == "fit_implausible").all()
    for belief, recovered in seen:
        assert (recovered.shape == Shape.PRIOR).all()
        assert np.array_equal(recovered.superquadric.size_m[:, 0], belief.prior.radius_m)
        assert belief.fitted.all()
        assert not np.array_equal(belief.body.size_m[:, 0], belief.prior.radius_m)


def test_path_and_time_do_not_depend_on_the_probes_of_others() -> None:
    """Pairwise sums of padded rows would differ in the last digit."""
    poses: list[np.ndarray] = []

    def some(belief: Belief) -> list[Grasp]:
        if belief.step:
            return []
        if not poses:
            poses.append(waypoint_poses((Ring(count=24),), belief.prior, belief.hand, belief.seed))
        count = 24 if belief.worlds == 2 else 11
        wanted = np.arange(count) < np.array([[11], [24]])[:belief.worlds]
        return [Grasp(poses[0][:belief.worlds, :count], wanted)]

    both, alone = run(some).belief, run(some, (0,)).belief
    assert both.path_m[0] == alone.path_m[0] > 0.0
    assert both.time_s[0] == alone.time_s[0] > 0.0


def test_cutting_a_sequence_changes_no_contact() -> None:
    whole, cut = run(ordered("containment")), run(ordered("containment", refit_every=2))
    assert np.array_equal(whole.belief.touches, cut.belief.touches)
    a, b = (np.concatenate([p.felt.closing.q_rad for p in f.procedures], 1)
            for f in (whole, cut))
    assert np.array_equal(a, b, equal_nan=True)


@pytest.mark.parametrize("name", [
    pytest.param("block", marks=pytest.mark.slow), "large_cylinder"])
def test_a_world_does_not_depend_on_the_worlds_beside_it(name: str) -> None:
    strategy = STRATEGIES["coarse-to-fine"]

    def planner() -> OrderedPlanner:
        return OrderedPlanner(strategy, PlanarTable(faces=2), ContourTable(), DecideTable())

    both = run(planner(), (0, 3), name, closings=strategy.closings)
    alone = run(planner(), (3,), name, closings=strategy.closings)
    assert np.array_equal(both.belief.touches[1:], alone.belief.touches)
    for field in alone.recovered.superquadric._fields:
        assert np.array_equal(getattr(both.recovered.superquadric, field)[1:],
                              getattr(alone.recovered.superquadric, field)), field
    assert np.array_equal(both.recovered.shape[1:], alone.recovered.shape)
    if alone.recovered.revolution is not None and both.recovered.revolution is not None:
        mine_, theirs = alone.recovered.revolution.radius_m, both.recovered.revolution.radius_m
        width = mine_.shape[1]
        assert np.array_equal(theirs[1:, :width], mine_, equal_nan=True)
    wanted = {"block": "planar", "large_cylinder": "contour"}[name]
    assert wanted in [p.name for p in alone.procedures]


def test_belief_holds_no_truth() -> None:
    found = run(ordered("containment"))
    for name in vars(found.belief):
        assert "true" not in name
        assert "truth" not in name
