"""The same closings, guarded lines, scores and episodes on two devices.

    python -m sweeps.bench.device_agreement [--device cuda:0] [--worlds 256]

Exits with 1 where they disagree: more than 1 % of the closings stop at another step (a finger that
snaps through may stop elsewhere by the last bit), or, of those that stop at the same one, 1 % rest
more than a microradian apart; scores differ by more than a micrometre; or of the episodes more than
5 % end otherwise, or their mean IoU differs by more than twice its standard error. A fit is
sensitive to the last bit of its contacts: single episodes differ, studies do not.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.postures import poking_pose
from strategies.procedures.containment import explore_by_containment
from strategies.procedures.possible import extended_of
from strategies.ready_made import STRATEGIES
from sweeps.bench.measure import bodies_touched
from sweeps.bench.rows import body_of
from sweeps.episode.episodes import place_objects, run_episodes
from sweeps.episode.given_prior import draw_prior
from sweeps.episode.scores import score_superquadrics
from sweeps.output import init_warp
from sweeps.spec.cell import Cell
from warpgrasp.core.random import counter_key
from warpgrasp.parameters import ArmTable, HandTable, ObjectTable, SensorTable
from warpgrasp.robot import Robot, Truth

CLOSINGS = (*((name, "utah_mit") for name in
              ("block", "small_cylinder", "wedge", "lightbulb", "mesh")),
            ("block", "allegro"), ("small_cylinder", "leap"))
"""Objects and hands."""
EPISODES = (("ring6", "block", "utah_mit"), ("even", "funnel", "utah_mit"),
            ("contour-first", "beer_bottle", "utah_mit"), ("ring6", "wedge", "allegro"))
"""Strategies, objects and hands."""


def robot_of(
    name: str, hand: HandTable, key: np.ndarray, pose: np.ndarray, device: str
) -> tuple[Robot, Truth]:
    """Robots before an object each."""
    truth = Truth(pose)
    return Robot([body_of(name)], np.zeros(1, int), truth, key, ArmTable(), hand, SensorTable(),
                 device=device), truth


def closings(name: str, hand: HandTable, worlds: int, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps (world, probe, grasp, finger) and true joints [rad] (..., joint) of all closings of
    `ring6`."""
    key = counter_key(7, np.arange(worlds))
    pose = place_objects(ObjectTable(), key)
    prior = draw_prior(body_of(name), pose, ObjectTable(), key)
    poses = waypoint_poses(STRATEGIES["ring6"].waypoints, prior, hand, key)
    robot, truth = robot_of(name, hand, key, pose, device)
    grasps = explore_by_containment(robot, poses, np.ones(poses.shape[:2], bool),
                                    STRATEGIES["ring6"].closings)
    return grasps.closing.step, truth.closings[0].q_rad


def lines(worlds: int, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps (world,) and contacts [m] (world, 3) of guarded lines towards the block."""
    key = np.arange(worlds).astype(np.uint64)
    pose = np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (worlds, 1))
    robot, _ = robot_of("block", HandTable(), key, pose, device)
    inward = np.array([1.0, 0.0, 0.0])
    one = extended_of(robot.hand, robot.pads)
    at = poking_pose(one, np.array([0.41, 0.0, 0.06]), inward, np.array([0.0, 0.0, -1.0]))
    touch = robot.guarded_line(np.arange(worlds), np.tile(at, (worlds, 1)),
                               np.tile(inward, (worlds, 1)), interval_m=0.001, steps=40,
                               finger=one.finger, commands_rad=one.commands_rad)
    return touch.steps, touch.point_m


def agreements(worlds: int, device: str) -> Iterator[tuple[str, bool]]:
    """A line for each comparison of `device` with the CPU, and whether it is as it should be."""
    both = ("cpu", device)
    for name, kind in CLOSINGS:
        (step, q), (step2, q2) = (closings(name, HandTable(kind=kind), worlds, d) for d in both)
        other = (step != step2).mean()
        apart = (np.nan_to_num(np.abs(q - q2)).max(-1)[step == step2] > 1e-6).mean()
        yield (f"closings of {kind} on {name}: {step.size:,}, other step {other:.3%}, "
               f"apart {apart:.3%}", other <= 0.01 and apart <= 0.01)
    (step, point), (step2, point2) = (lines(worlds, d) for d in both)
    other, off = (step != step2).mean(), np.abs(point - point2)[step == step2].max()
    yield (f"guarded lines: {step.size:,}, other step {other:.3%}, contacts {off:.1e} m apart",
           other <= 0.01 and off < 1e-5)
    body, _ = bodies_touched(worlds)
    pose = np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (worlds, 1))
    scores = [score_superquadrics(body, body_of("block"), pose, device=d) for d in both]
    off = np.abs(scores[0].chamfer_m - scores[1].chamfer_m).max()
    yield f"scores: {worlds}, chamfer {off:.1e} m apart", bool(off < 1e-6)
    for strategy, name, kind in EPISODES:
        cell = Cell(STRATEGIES[strategy], {"name": name}, name, hand=HandTable(kind=kind))
        rows = [run_episodes(replace(cell, seed=7), np.arange(worlds), d) for d in both]
        ended = (rows[0]["status"] == rows[1]["status"]).mean()
        iou = [np.nan_to_num(r["iou"].astype(float)) for r in rows]
        off, error = iou[1].mean() - iou[0].mean(), iou[0].std() / np.sqrt(worlds)
        yield (f"episodes of {strategy} of {kind} on {name}: {worlds}, {ended:.1%} end alike, mean "
               f"IoU {iou[0].mean():.4f} and {iou[1].mean():.4f}, standard error {error:.4f}",
               bool(ended >= 0.95 and abs(off) <= 2.0 * error))


def main() -> None:
    """Compare, print, and exit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--worlds", type=int, default=256)
    arguments = parser.parse_args()
    init_warp()
    good = True
    for line, right in agreements(arguments.worlds, arguments.device):
        good &= right
        print(line if right else f"{line}: NO", flush=True)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
