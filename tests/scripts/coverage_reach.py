"""How much of an object's surface a strategy touches, against touches, beside what it could.

    python tests/scripts/coverage_reach.py reach --poses 10000
    python tests/scripts/coverage_reach.py strategies --strategies rim12-ring12 any-object

Prints Markdown tables: the share of the surface (above what the table hides) within 10 mm of a
contact. `reach`: of the true contacts of free poses drawn evenly around the object, all directions
from above to level and every roll, with every closing path; and of the best 32, 96 and 192 of these
contacts, taken greedily, as if no touch ever missed. `strategies`: after 32, 96 and 192
touches; contacts where they truly were, and in brackets accepted ones where they are placed.
Bodies are chosen with `--objects`: names of the catalogue and of families, `drill`, `scissors`, or
files of meshes in metres.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fit.rotation import matrix_of_quaternion
from strategies.poses.closing_paths import CLOSING_PATHS
from strategies.procedures.containment import padded_commands
from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.ready_made import STRATEGIES
from sweeps.episode.contact_rows import contact_columns
from sweeps.episode.episodes import EpisodeBlock, cell_body, run_block
from sweeps.episode.touched_share import NEAR_M, open_surface, touched_points
from sweeps.spec.cell import Cell
from warpgrasp.core.random import counter_key, counter_uniform
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.objects.families import family_table
from warpgrasp.parameters import ArmTable, ErrorTable, FitTable, HandTable, SensorTable
from warpgrasp.robot import Robot, Truth

TOUCHES = (32, 96, 192)
MADE = ("contact", "no_contact", "blocked", "self_contact")
COMPOUNDS: dict[str, list[dict[str, Any]]] = {
    "drill": [
        {"shape": "block", "size_mm": [110, 70, 45]},
        {"shape": "capsule", "at_mm": [-10, 0, 20], "radius_mm": 20, "height_mm": 130},
        {"shape": "capsule", "at_mm": [-60, 0, 150], "rpy_deg": [0, 90, 0], "radius_mm": 27,
         "height_mm": 150},
        {"shape": "cylinder", "at_mm": [80, 0, 150], "rpy_deg": [0, 90, 0], "radius_mm": 14,
         "height_mm": 35}],
    "scissors": [
        {"shape": "block", "at_mm": [25, 0, 0], "rpy_deg": [0, 0, 8], "size_mm": [110, 14, 12]},
        {"shape": "block", "at_mm": [25, 0, 0], "rpy_deg": [0, 0, -8], "size_mm": [110, 14, 12]},
        {"shape": "cylinder", "at_mm": [-52, 18, 0], "radius_mm": 27, "height_mm": 12},
        {"shape": "cylinder", "at_mm": [-52, -18, 0], "radius_mm": 27, "height_mm": 12},
        {"shape": "cylinder", "join": "difference", "at_mm": [-52, 22, -1], "radius_mm": 15,
         "height_mm": 20},
        {"shape": "cylinder", "join": "difference", "at_mm": [-52, -22, -1], "radius_mm": 15,
         "height_mm": 20}]}
"""Bodies like those that no family has, upright and lying [est]."""


def body_table(name: str) -> dict[str, Any]:
    """The spec's table of an object named on the command line."""
    if name.endswith(".ply"):
        file = Path(name).resolve()
        return {"name": file.stem, "mesh": str(file), "units": "m"}
    if name in COMPOUNDS:
        return {"name": name, "compound": COMPOUNDS[name]}
    return family_table(name) or {"name": name}


def free_contacts(body: Body, poses: int, seed: int = 0, worlds: int = 64) -> np.ndarray:
    """True contacts on a body of hand poses drawn evenly about it, in its frame (contact, 3) [m].

    A pose is aimed at a point of the body's surface or up to 30 mm beside it, and raised where the
    open hand would strike the table; where it strikes the body nothing is felt. The robot has no
    errors, and objects are turned at random.
    """
    surface = sample_body(body).surface_m
    key = counter_key(seed, np.arange(worlds))
    draw = counter_uniform(counter_key(key[:, None, None], np.arange(-(-poses // worlds))[:, None],
                                       np.arange(10)))
    yaw = 2 * np.pi * counter_uniform(counter_key(key, 999))
    pose = np.zeros((worlds, 7))
    pose[:, 0], pose[:, 5], pose[:, 6] = 0.45, np.sin(yaw / 2), np.cos(yaw / 2)
    hand = HandTable()
    at = surface[(draw[..., 0] * len(surface)).astype(int)] @ matrix_of_quaternion(
        pose[:, 3:]).swapaxes(1, 2) + pose[:, None, :3]
    at = at + 0.030 * (2 * draw[..., 1:4] - 1)
    tilt = np.arccos(draw[..., 4] * 1.1 - 0.1)
    around, roll = 2 * np.pi * draw[..., 5], 2 * np.pi * draw[..., 6]
    turn = Rotation.from_euler("ZYZ", np.stack([around, np.pi - tilt, roll], -1).reshape(-1, 3))
    approach = turn.apply([0.0, 0.0, 1.0]).reshape(at.shape)
    length = hand.abduction_offset_m + sum(hand.link_length_m)
    place = at - approach * (length * (0.3 + 0.8 * draw[..., 7:8]))
    hand_pose = np.concatenate([place, turn.as_quat().reshape(*at.shape[:2], 4)], -1)
    lowest = lowest_of_hand(hand, hand_pose.reshape(-1, 7)).reshape(at.shape[:2])
    hand_pose[..., 2] += np.maximum(0.001 + 0.008 * draw[..., 8] - lowest, 0.0)
    truth = Truth(pose)
    robot = Robot([body], np.zeros(1, int), truth, key, ArmTable(), hand, SensorTable(),
                  errors=ErrorTable(scale=0.0))
    commands, count = padded_commands(tuple(CLOSING_PATHS))
    robot.grasp(hand_pose, np.ones(hand_pose.shape[:2], bool), commands, count)
    felt = truth.closings[0]
    mine = (felt.link >= 0) & ~felt.on_table & ~felt.self_contact
    mine &= np.nan_to_num(felt.point_m[..., 2]) > TABLE_MARGIN_M
    world = np.nonzero(mine)[0]
    local = Rotation.from_quat(pose[world, 3:]).inv().apply(felt.point_m[mine] - pose[world, :3])
    return local


def lowest_of_hand(hand: HandTable, hand_pose: np.ndarray) -> np.ndarray:
    """Height of the lowest place of open hands (pose, 7), (pose,) [m]."""
    commands, _ = padded_commands(("curl40",))
    q = np.broadcast_to(commands[0, :, 0], (len(hand_pose), 4, 4))
    fingers = hand_links(hand, hand_pose, q)[0][..., 2].min((1, 2)) - hand.link_radius_m
    thick = hand.palm_thickness_m / 2
    ends = [(x, y, -thick) for x in (-hand.palm_gap_m / 2, hand.palm_gap_m / 2)
            for y in (-hand.finger_spacing_m, hand.finger_spacing_m)]
    turn = matrix_of_quaternion(hand_pose[:, 3:])
    palm = (np.einsum("pj,ej->pe", turn[:, 2], np.array([*ends, (0, 0, -hand.mount_length_m)]))
            + hand_pose[:, 2:3]).min(1) - thick
    return np.minimum(fingers, palm)


def reach(given: argparse.Namespace) -> None:
    """The table of what the hand could touch."""
    print("| object | poses | contacts | reachable share | with a tenth of the poses | best "
          + " | best ".join(map(str, TOUCHES)) + " |")
    print("|---" * (5 + len(TOUCHES)) + "|")
    for name in given.objects:
        table = body_table(name)
        body = cell_body(Cell(STRATEGIES["ring6"], table, table["name"]))
        found = free_contacts(body, given.poses, given.seed)
        surface = open_surface(body, 2048)
        few = found[::10]
        print(f"| {table['name']} | {given.poses} | {len(found)} | "
              f"{touched_points(surface, found).mean():.2f} | "
              f"{touched_points(surface, few).mean():.2f} | "
              + " | ".join(f"{share:.2f}" for share in best_shares(surface, found)) + " |",
              flush=True)


def best_shares(surface: np.ndarray, found: np.ndarray) -> list[float]:
    """Shares covered by the best `TOUCHES` contacts of `found` (contact, 3): each one that covers
    most of what those before it left, which is within 37 % of the best there is."""
    surface, found = surface[::2], found[::max(len(found) // 2000, 1)]
    near = np.linalg.norm(surface[:, None] - found[None], axis=-1) <= NEAR_M
    left, shares = np.ones(len(surface), bool), []
    for count in range(1, TOUCHES[-1] + 1):
        best = near[left].sum(0).argmax() if left.any() else 0
        left &= ~near[:, best]
        if count in TOUCHES:
            shares.append(1.0 - left.mean())
    return shares


def shares(block: EpisodeBlock) -> np.ndarray:
    """Shares (world, touches, 2): by contacts where they truly were, and by accepted ones where
    they are placed."""
    columns = contact_columns(block.exploration, block.truth)
    pose, surface = block.truth.body_pose, open_surface(block.body)
    felt = (columns["verdict"] != "") & (columns["verdict"] != "table")
    out = np.zeros((len(pose), len(TOUCHES), 2))
    for world in range(len(pose)):
        mine = columns["world"] == world
        number = np.cumsum(np.isin(columns["status"][mine], MADE))
        for kind, (names, counts) in enumerate((
                (("true_x_m", "true_y_m", "true_z_m"), felt),
                (("x_m", "y_m", "z_m"), columns["accepted"] == 1))):
            points = np.stack([columns[n][mine] for n in names], 1)
            use = counts[mine] & np.isfinite(points).all(1)
            local = (points - pose[world, :3]) @ matrix_of_quaternion(pose[world, 3:])
            for k, most in enumerate(TOUCHES):
                out[world, k, kind] = touched_points(surface, local[use & (number <= most)]).mean()
    return out


def strategies(given: argparse.Namespace) -> None:
    """The table of strategies."""
    print("| strategy | object | " + " | ".join(map(str, TOUCHES)) + " | touches | contacts | "
          "failed | chamfer [mm] | s per episode |")
    print("|---" * (7 + len(TOUCHES)) + "|")
    for name in given.objects:
        for word in given.strategies:
            table = body_table(name)
            strategy = STRATEGIES[word]
            if strategy.call:
                strategy = replace(strategy, touches=TOUCHES[-1])
            fit = FitTable(reconstruct=given.reconstruct)
            if given.rough:
                fit = replace(fit, rivals=False, rounds=1, taper=False)
            cell = Cell(strategy, table, table["name"], seed=given.seed, fit=fit)
            began = time.process_time()
            block = run_block(cell, np.arange(given.episodes), "cpu")
            spent = (time.process_time() - began) / given.episodes
            share = np.median(shares(block), 0)
            belief = block.exploration.belief
            print(f"| {word} | {table['name']} | " + " | ".join(
                f"{true:.2f} ({placed:.2f})" for true, placed in share) +
                f" | {np.median(belief.touches):.0f}"
                f" | {np.median(belief.evidence.mask.sum(1)):.0f}"
                f" | {(block.status != 'ok').mean():.2f}"
                f" | {1e3 * np.median(block.scores.chamfer_m):.1f} | {spent:.2f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("reach", "strategies"))
    parser.add_argument("--objects", nargs="+", default=[
        "block", "drill", "mug-1", "bowl-1", "hammer-1", "pliers-1", "scissors"])
    parser.add_argument("--strategies", nargs="+", default=["rim12-ring12", "even", "coverage"])
    parser.add_argument("--reconstruct", default="superquadric")
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--seed", type=int, default=34)
    parser.add_argument("--rough", action="store_true", help="quicker fits: for touches alone")
    given = parser.parse_args()
    {"reach": reach, "strategies": strategies}[given.what](given)
