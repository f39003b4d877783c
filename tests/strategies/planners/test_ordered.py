"""Orders given in advance keep to their budgets, also where all poses are asked for at once."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import BODY, belief

from strategies.planners.ordered import OrderedPlanner
from strategies.planners.probes import CrossFaces, FollowContour, Grasp, wanted_of
from strategies.poses.waypoints import Ring
from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.ready_made import STRATEGIES
from strategies.recovery.belief import Belief
from strategies.strategy import Strategy
from sweeps.episode.episodes import run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.objects.families import family_table

RING = Strategy("s", (Ring(count=8, tilt_rad=np.radians(50)),), closings=("curl40",))
CURVE = "curve_touches"


def rows(strategy: Strategy, name: str = "block") -> dict[str, np.ndarray]:
    return run_episodes(Cell(strategy, {"name": name}, name, seed=4), np.arange(3), "cpu")


@pytest.mark.parametrize("order", [
    ("containment", "planar", "contour"), ("contour", "containment"), ("planar", "containment")])
def test_procedures_are_asked_for_in_their_order(order: tuple[str, ...]) -> None:
    asked = {"containment": Grasp, "planar": CrossFaces, "contour": FollowContour}
    planner = OrderedPlanner(replace(RING, order=order), PlanarTable(), ContourTable(),
                             DecideTable())
    steps = [planner(belief()) for _ in order]
    assert [[type(probe) for probe in step] for step in steps] == [[asked[name]] for name in order]
    assert planner(belief()) == []


def wanted(planner: OrderedPlanner, here: Belief) -> list[str]:
    """What the next step sends the two worlds of `here` to do."""
    found = ["", ""]
    for probe in planner(here):
        names = {CrossFaces: "faces", FollowContour: "contour"}
        for world in np.flatnonzero(wanted_of(probe, 2, here.hand).any(1)):
            found[world] = (found[world] + " " + names.get(type(probe), "grasp")).strip()
    return found


def test_what_finds_nothing_is_not_done_again_at_once() -> None:
    """Contours of objects that lie on the table were followed three times, and found nothing."""
    def in_order(*order: str) -> OrderedPlanner:
        return OrderedPlanner(replace(RING, order=order), PlanarTable(), ContourTable(),
                              DecideTable(turned_within=0.0))

    never = replace(belief(), fitted=np.zeros(2, bool))
    planner = in_order("decide", "decide", "decide")
    assert [wanted(planner, never) for _ in range(3)] == [
        ["faces"] * 2, ["contour"] * 2, ["faces"] * 2]
    round_ = replace(belief(), body=BODY._replace(exponents=np.array([[0.1, 1.0]] * 2)))
    planner = in_order("decide", "decide")
    assert [wanted(planner, round_) for _ in range(2)] == [["contour faces"] * 2, ["faces"] * 2]
    planner = in_order("contour", "containment", "decide")
    assert [wanted(planner, round_) for _ in range(3)] == [
        ["contour"] * 2, ["grasp"] * 2, ["contour faces"] * 2]


@pytest.mark.slow
def test_an_object_that_lies_is_found_where_grasps_find_little() -> None:
    table = family_table("hammer-11")
    assert table is not None
    found = run_episodes(Cell(STRATEGIES["coarse-to-fine"], table, "hammer-11", seed=91),
                         np.arange(8), "cpu")
    assert (found["status"] == "ok").sum() >= 6  # one of them where contours alone were followed
    assert np.median(found["chamfer_mm"]) < 0.5 * np.median(found["prior_chamfer_mm"])


def test_a_budget_of_time_ends_a_sequence_that_is_fitted_once() -> None:
    """After the pose after which it would have ended, had bodies been fitted after each; one that
    is not spent changes nothing."""
    whole = rows(RING)
    least = float(whole["robot_time_s"].min())
    assert least > 30.0
    short = replace(RING, robot_time_s=20.0)
    cut, each = rows(short), rows(replace(short, refit_every=1))
    assert ((cut["robot_time_s"] >= 20.0) & (cut["robot_time_s"] < least)).all()
    for column in ("touches", "contacts", "probes", "unreachable", "collisions"):
        np.testing.assert_array_equal(cut[column], each[column], err_msg=column)
    np.testing.assert_allclose(cut["robot_time_s"], each["robot_time_s"], rtol=1e-12)
    assert {len(curve) for curve in cut[CURVE]} == {1}
    unspent = rows(replace(RING, robot_time_s=1e4))
    for column, values in unspent.items():
        for mine, other in zip(values, whole[column], strict=True):
            np.testing.assert_array_equal(mine, other, err_msg=column)


def test_a_budget_of_volume_is_looked_at_after_every_pose() -> None:
    whole, sure = (rows(replace(RING, volume_ratio=ratio), "large_cylinder")
                   for ratio in (None, 30.0))
    assert (sure["touches"] <= whole["touches"]).all()
    assert (sure["touches"] < whole["touches"]).sum() == 2  # one is never as sure
