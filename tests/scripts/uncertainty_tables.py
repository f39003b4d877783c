"""How far accepted contacts are off, and how often 90 % intervals hold the truth, by object.

    python tests/scripts/uncertainty_tables.py contacts --scans FOLDER
    python tests/scripts/uncertainty_tables.py contacts --hands leap barrett --objects block wedge
    python tests/scripts/uncertainty_tables.py intervals --errors 0 1 2

Prints Markdown tables: accepted contacts farther than 10 mm from where the finger touched; the
shares of episodes whose interval of the volume holds the true one, of those whose interval is
trusted, and of the true surface within the intervals of the recovered one. `--errors` are factors
of the default deviations of [errors].
"""

import argparse
import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

import interval_rows as tables
import numpy as np


def contacts(given: argparse.Namespace) -> None:
    """The table of contacts; in brackets: if places that only the model tells were accepted."""
    print("| hand, object | contacts | accepted [%] | off by more than 10 mm [% of accepted] |")
    print("|---|---|---|---|")
    for hand in given.hands:
        total = np.zeros(5, int)
        for name, table in tables.objects(given.scans, given.objects).items():
            cell = tables.cell_of(table, "rim6-ring12", given.seed, tables.errors_times(1.0), hand)
            row = tables.contact_row(cell, given.episodes)
            total += row
            _line(f"{hand}, {name}", row)
        _line(f"{hand}, all", total)


def _line(name: str, row: np.ndarray) -> None:
    felt, accepted, far, either, either_far = row
    print(f"| {name} | {felt} | {100 * accepted / max(felt, 1):.0f} "
          f"({100 * either / max(felt, 1):.0f}) | {100 * far / max(accepted, 1):.1f} "
          f"({100 * either_far / max(either, 1):.1f}) |", flush=True)


def intervals(given: argparse.Namespace) -> None:
    """The tables of intervals: volume, of trusted ones, surface (half width of the volume's; share
    trusted)."""
    for factor in given.errors:
        print(f"\n[errors] times {factor:g}\n\n| object | " + " | ".join(given.strategies) + " |\n"
              + "|---" * (1 + len(given.strategies)) + "|")
        shares = []
        for name, table in tables.objects(given.scans, given.objects).items():
            cells = []
            for strategy in given.strategies:
                cell = tables.cell_of(table, strategy, given.seed, tables.errors_times(factor))
                row = tables.interval_row(cell, given.episodes)
                shares.append(row["volume"])
                surface = "–" if math.isnan(row["surface"]) else f"{row['surface']:.2f}"
                cells.append(f"{row['volume']:.2f}, {row['trusted_volume']:.2f}, {surface} "
                             f"(±{row['half_width']:.2f}; {row['trusted']:.2f})")
            print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
        inside = sum(0.85 <= share <= 0.95 for share in shares)
        print(f"\n{inside} of {len(shares)} cells 85 to 95 %, least {min(shares):.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("contacts", "intervals"))
    parser.add_argument("--scans", type=Path, help="folder of scanned meshes [m]")
    parser.add_argument("--objects", nargs="*", help="names; the catalogue unless given")
    parser.add_argument("--hands", nargs="*", default=["utah_mit"])
    parser.add_argument("--episodes", type=int, default=32)
    parser.add_argument("--seed", type=int, default=8)
    parser.add_argument("--errors", type=float, nargs="*", default=[1.0])
    parser.add_argument("--strategies", nargs="*",
                        default=["ring18", "rim12-ring12", "coarse-to-fine"])
    options = parser.parse_args()
    (contacts if options.what == "contacts" else intervals)(options)
