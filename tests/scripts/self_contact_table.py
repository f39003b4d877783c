"""How often stops at the object are taken for the hand's own links, and meetings are not detected.

    python tests/scripts/self_contact_table.py
    python tests/scripts/self_contact_table.py --hands leap --settings default --episodes 8

Prints the Markdown table of docs/model.md: stops of `rim6-ring12` with the paths `curl40` and
`together`, by hand and setting. A stop is of the object where a link on object or table bears the
largest force, and a true meeting where another finger or the palm does.
"""

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

import interval_rows as tables
import numpy as np

from sweeps.episode.episodes import run_block
from sweeps.spec.cell import Cell
from warpgrasp.parameters import ErrorTable, SensorTable, TrueTables
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps

OBJECTS = ("block", "large_cylinder", "small_cylinder", "wedge", "funnel", "wine_bottle")
PATHS = ("curl40", "together")
SETTINGS = {
    "default": lambda cell: cell,
    "noise": lambda cell: replace(
        cell, sensors=SensorTable(joint_noise_rad=math.radians(2.0))),
    "belief": lambda cell: replace(
        cell, errors=ErrorTable(scale=4.0),
        true=TrueTables(cell.hand, cell.sensors, cell.errors)),
    "errors twice as large": lambda cell: replace(cell, errors=ErrorTable(scale=2.0)),
    "links of 12 mm radius": lambda cell: replace(
        cell, hand=replace(cell.hand, link_radius_m=0.012)),
    "fingers 20 mm apart": lambda cell: replace(
        cell, hand=replace(cell.hand, finger_spacing_m=0.020)),
}
"""Changes to episodes; the last two are of the Utah-MIT hand alone."""


def stops(cell: Cell, episodes: int) -> np.ndarray:
    """Stops at object or table, those of them taken for the hand's own; true meetings, those of
    them taken for contacts."""
    block = run_block(cell, np.arange(episodes), "cpu", curve=False)
    counts = np.zeros(4, int)
    for procedure in block.exploration.procedures:
        assert isinstance(procedure.felt, Grasps)
        status = procedure.felt.closing.status
        true = block.truth.closings[procedure.closing]
        taken, kept = (status == ProbeStatus.SELF_CONTACT), (status == ProbeStatus.CONTACT)
        told = taken | kept
        met = told & true.self_contact
        felt = told & ~true.self_contact & (true.link >= 0)
        counts += [felt.sum(), (felt & taken).sum(), met.sum(), (met & kept).sum()]
    return counts


def main(hands: list[str], settings: list[str], episodes: int, seed: int) -> None:
    """Print a row for each hand and setting."""
    print("| hand | setting | contacts on the object | taken for the hand's own | true meetings "
          "| not detected |\n|---|---|---|---|---|---|")
    for hand in hands:
        for setting in settings:
            total = np.zeros(4, int)
            for table in tables.objects(names=OBJECTS).values():
                cell = tables.cell_of(table, "rim6-ring12", seed, tables.errors_times(1.0), hand)
                cell = replace(cell, strategy=replace(cell.strategy, closings=PATHS))
                total += stops(SETTINGS[setting](cell), episodes)
            felt, taken, met, kept = total
            missed = f"{100 * kept / met:.1f} %" if met else ""
            print(f"| {hand} | {setting} | {felt:,} | {100 * taken / max(felt, 1):.1f} % | {met:,} "
                  f"| {missed} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hands", nargs="*", default=["utah_mit"])
    parser.add_argument("--settings", nargs="*", choices=SETTINGS, default=["default"])
    parser.add_argument("--episodes", type=int, default=24)
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    main(given.hands, given.settings, given.episodes, given.seed)
