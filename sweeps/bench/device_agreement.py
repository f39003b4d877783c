"""The same closings, guarded lines, scores and rates on two devices.

    python -m sweeps.bench.device_agreement [--device cuda:0] [--worlds 256]

Exits with 1 where they disagree: more than 1 % of the closings stop at another step (a finger that
snaps through may stop elsewhere by the last bit), or, of those that stop at the same one, 1 % rest
more than a microradian apart, or scores differ by more than a micrometre.
"""

import argparse
import sys
import time

import numpy as np

from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.postures import poking_pose
from strategies.procedures.containment import explore_by_containment
from strategies.procedures.possible import extended_of
from strategies.ready_made import STRATEGIES
from sweeps.bench.measure import bodies_touched
from sweeps.bench.rows import body_of
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior
from sweeps.episode.scores import score_superquadrics
from warpgrasp.core.random import counter_key
from warpgrasp.parameters import ArmTable, HandTable, ObjectTable, SensorTable
from warpgrasp.robot import Robot, Truth

OBJECTS = ("block", "small_cylinder", "wedge", "lightbulb", "mesh")


def robot_of(name: str, key: np.ndarray, pose: np.ndarray, device: str) -> tuple[Robot, Truth]:
    """Robots before an object each."""
    truth = Truth(pose)
    return Robot([body_of(name)], np.zeros(1, int), truth, key, ArmTable(), HandTable(),
                 SensorTable(), device=device), truth


def closings(name: str, worlds: int, device: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Steps and joints of all closings of `ring6`, and how many a second."""
    key = counter_key(7, np.arange(worlds))
    pose = place_objects(ObjectTable(), key)
    prior = draw_prior(body_of(name), pose, ObjectTable(), key)
    poses = waypoint_poses(STRATEGIES["ring6"].waypoints, prior, HandTable(), key)
    wanted = np.ones(poses.shape[:2], bool)

    def close() -> tuple[np.ndarray, np.ndarray, float]:
        robot, truth = robot_of(name, key, pose, device)
        begin = time.perf_counter()
        grasps = explore_by_containment(robot, poses, wanted, STRATEGIES["ring6"].closings)
        rate = grasps.closing.status.size / (time.perf_counter() - begin)
        return grasps.closing.step, truth.closings[0].q_rad, rate

    close()  # compiles the kernels
    return close()


def lines(worlds: int, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps and contacts of guarded lines towards the block."""
    key = np.arange(worlds).astype(np.uint64)
    pose = np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (worlds, 1))
    robot, _ = robot_of("block", key, pose, device)
    inward = np.array([1.0, 0.0, 0.0])
    one = extended_of(robot.hand, robot.pads)
    at = poking_pose(one, np.array([0.41, 0.0, 0.06]), inward, np.array([0.0, 0.0, -1.0]))
    touch = robot.guarded_line(np.arange(worlds), np.tile(at, (worlds, 1)),
                               np.tile(inward, (worlds, 1)), interval_m=0.001, steps=40,
                               finger=one.finger, commands_rad=one.commands_rad)
    return touch.steps, touch.point_m


def main() -> None:
    """Compare, print, and exit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--worlds", type=int, default=256)
    arguments = parser.parse_args()
    good = True
    for name in OBJECTS:
        (step, q, slow), (step2, q2, fast) = (closings(name, arguments.worlds, device)
                                              for device in ("cpu", arguments.device))
        other = (step != step2).mean()
        apart = (np.nan_to_num(np.abs(q - q2)).max(-1)[step == step2] > 1e-6).mean()
        good &= other <= 0.01 and apart <= 0.01
        print(f"{name:15} other step {other:.4%}, apart {apart:.4%}, "
              f"{slow:,.0f} and {fast:,.0f} closings/s")
    (step, point), (step2, point2) = (lines(arguments.worlds, device)
                                      for device in ("cpu", arguments.device))
    off = np.abs(point - point2)[step == step2].max()
    good &= (step != step2).mean() <= 0.01 and off < 1e-5
    print(f"guarded lines   other step {(step != step2).mean():.4%}, contacts {off:.1e} m apart")
    body, _ = bodies_touched(arguments.worlds)
    pose = np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (arguments.worlds, 1))
    scores = [score_superquadrics(body, body_of("block"), pose, device=device)
              for device in ("cpu", arguments.device)]
    off = np.abs(scores[0].chamfer_m - scores[1].chamfer_m).max()
    good &= bool(off < 1e-6)
    print(f"scores          chamfer {off:.1e} m apart")
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
