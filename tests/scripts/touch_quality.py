"""How well pads recover faces and contours, and what two thousand worlds in lock-step cost.

    python tests/scripts/touch_quality.py [--worlds 200] [--lockstep 2000] [--hand leap --arm none]

Starts are wrong by what a fitted body would be wrong by: faces 4 mm and 4 degrees, axes 8 mm a
number. Prints a Markdown table of the figures that docs/touch.md holds.
"""

import argparse
import time

import numpy as np
from scipy.spatial.transform import Rotation

from strategies.procedures.contour_follower import explore_contour
from strategies.procedures.contour_record import Axis
from strategies.procedures.contour_shape import match_profiles, profile_of, radius_at
from strategies.procedures.planar_explorer import explore_plane
from strategies.procedures.planar_faces import angle_between, planes_of
from strategies.procedures.touches import EndReason, true_touches
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, HandTable, SensorTable
from warpgrasp.robot import Robot, Truth

FACES = {"near": ((-0.03, 0.0, 0.06), (-1.0, 0.0, 0.0), (0.08, 0.12)),
         "left": ((0.0, 0.04, 0.06), (0.0, 1.0, 0.0), (0.06, 0.12))}
BOTTLES = ("wine_bottle", "beer_bottle", "coke_bottle", "orangina_bottle")


def robot_before(name: str, worlds: int, yaw: np.ndarray, seed: int) -> tuple[Robot, Truth]:
    """Robots, each before its own object turned by `yaw`."""
    pose = np.zeros((worlds, 7))
    pose[:, 0], pose[:, 5], pose[:, 6] = 0.45, np.sin(yaw / 2), np.cos(yaw / 2)
    truth = Truth(pose)
    key = np.arange(worlds).astype(np.uint64) + np.uint64(10_000 * seed)
    return Robot([body_from_name(name)], np.zeros(1, int), truth, key, ArmTable(kind=given.arm),
                 HandTable(kind=given.hand), SensorTable()), truth


def told_face(truth: Truth, face: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Where a fitted body would have the face, and its normal there."""
    point, normal, _ = FACES[face]
    turn = Rotation.from_quat(truth.body_pose[:, 3:])
    worlds = len(truth.body_pose)
    return (truth.body_pose[:, :3] + turn.apply(point) + rng.normal(0, 0.004, (worlds, 3)),
            turn.apply(normal) + rng.normal(0, np.radians(4), (worlds, 3)))


def planar(worlds: int, seed: int) -> None:
    """The block's neighbouring faces."""
    rng = np.random.default_rng(seed)
    robot, truth = robot_before("block", worlds, rng.uniform(-0.3, 0.3, worlds), seed)
    turn = Rotation.from_quat(truth.body_pose[:, 3:])
    found, faces, share = {}, {}, []
    for name, (_, normal, size) in FACES.items():
        found[name] = explore_plane(robot, *told_face(truth, name, rng))
        faces[name] = planes_of(found[name])
        off = np.degrees(np.arccos(np.clip((faces[name].normal * turn.apply(normal)).sum(1),
                                           -1, 1)))
        print(f"| block, {name} face: normal off, median [deg] | 1 | {np.median(off):.2f} |")
        table = found[name].touches
        point, _ = true_touches(table, truth)
        local = turn[table.world].inv().apply(point - truth.body_pose[table.world, :3])
        across = local[:, 1] if name == "near" else local[:, 0]
        for world in np.flatnonzero(found[name].reason == EndReason.COMPLETE):
            mine = (table.world == world) & np.isfinite(point[:, 0])
            share.append(min(np.ptp(across[mine]) / size[0], np.ptp(local[mine, 2]) / size[1])
                         if mine.any() else 0.0)
        ended, count = np.unique(found[name].reason, return_counts=True)
        print(f"| block, {name} face: how episodes ended | named | " + ", ".join(
            f"{EndReason(int(r)).name.lower()} {c}" for r, c in zip(ended, count, strict=True))
            + " |")
    angle, _ = angle_between(faces["near"], faces["left"])
    both = np.logical_and.reduce([e.reason == EndReason.COMPLETE for e in found.values()])
    error = np.abs(np.degrees(angle[both]) - 90)
    print(f"| neighbouring faces within 3 deg of 90, share | 0.90 | {(error <= 3).mean():.3f} |")
    print(f"| traces cover of a face, median (10th percentile) | 0.85 | {np.median(share):.3f} "
          f"({np.quantile(share, 0.1):.3f}) |")


def contours(worlds: int, seed: int, error_deg: float) -> None:
    """The four bottles and the lightbulb, the axis wrong by `error_deg`."""
    rng = np.random.default_rng(seed)
    known = {name: body_from_name(name).parts[0].profile_m for name in (*BOTTLES, "lightbulb")}
    right: list[bool] = []
    for name, contour in known.items():
        robot, _ = robot_before(name, worlds, np.zeros(worlds), seed)
        e = rng.normal(0.0, 0.008, (worlds, 4))
        axis = Axis.upright(0.45 + e[:, 0], e[:, 1], contour[-1, 0] + e[:, 2],
                            contour[:, 1].max() + e[:, 3])
        if error_deg:
            axis = axis.turned(np.full(worlds, np.radians(error_deg)),
                               rng.uniform(0, 2 * np.pi, worlds))
        exploration = explore_contour(robot, axis)
        ended = exploration.reason == EndReason.END_OF_OBJECT
        profile = profile_of(exploration)
        ended &= np.isfinite(profile.volume_m3)
        grid = np.arange(0.004, contour[-1, 0] - 0.004, 0.002)
        off = np.abs(radius_at(profile, grid)[ended] - np.interp(grid, *contour.T))
        z, r = contour.T
        volume = np.pi / 3 * (np.diff(z) * (r[:-1]**2 + r[:-1] * r[1:] + r[1:]**2)).sum()
        ratio = profile.volume_m3[ended] / volume
        if name in BOTTLES:
            names = match_profiles(profile, {n: known[n] for n in BOTTLES})
            right += [found == name for found, ok in zip(names, ended, strict=True) if ok]
        print(f"| {name}, axis off by {error_deg:g} deg: radius error [mm], volume ratio, ended | "
              f"1.5, within 10 % | {1e3 * np.median(off):.2f}, {np.median(ratio):.3f} "
              f"({(np.abs(ratio - 1) <= 0.1).mean():.0%} within), {ended.mean():.0%} |")
    print(f"| bottles distinguished, axis off by {error_deg:g} deg | 0.95 | {np.mean(right):.3f} |")


def lockstep(worlds: int) -> None:
    """One face of the block in many worlds at once."""
    rng = np.random.default_rng(8)
    robot, truth = robot_before("block", worlds, rng.uniform(-0.3, 0.3, worlds), 8)
    point, normal = told_face(truth, "near", rng)
    began, busy = time.monotonic(), time.process_time()
    found = explore_plane(robot, point, normal)
    print(f"| {worlds} worlds in lock-step, one face: touches, wall [s], processor [s] | | "
          f"{len(found.touches)}, {time.monotonic() - began:.1f}, "
          f"{time.process_time() - busy:.1f} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=200)
    parser.add_argument("--lockstep", type=int, default=2000)
    parser.add_argument("--hand", default=HandTable().kind)
    parser.add_argument("--arm", default=ArmTable().kind)
    given = parser.parse_args()
    print("| what | asked | measured |\n|---|---|---|")
    planar(given.worlds, 5)
    contours(given.worlds, 6, 0.0)
    contours(given.worlds, 7, 5.0)
    if given.lockstep:
        lockstep(given.lockstep)
