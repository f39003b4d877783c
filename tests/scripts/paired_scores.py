"""Shows that a change of how bodies are fitted or poses chosen makes no score worse.

    python tests/scripts/paired_scores.py run OUT.npz [--strategies even ...] [--meshes FOLDER]
    python tests/scripts/paired_scores.py compare BEFORE.npz AFTER.npz

`run` at two checkouts (`PYTHONPATH=CHECKOUT`): the same episodes of ten objects of the catalogue,
and of the meshes (.ply, in metres) of a folder. An episode's object, place and noise are those of
its number, so that episodes pair. `compare` prints, for each strategy, the mean difference as a
share of the mean before, with the 95 % interval, and processor time: of the scores at the end, and
of those along the way (means over the fits of an episode, from the fourth on).
"""

import argparse
import time
from pathlib import Path

import numpy as np

from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import run_cells
from sweeps.spec.cell import Cell

OBJECTS = ("block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel",
           "wine_bottle", "beer_bottle", "coke_bottle", "orangina_bottle")
LOSS = 0.02
"""What the intervals are to exclude."""
EARLY = 3
"""Fits at the begin of an episode that are left out of what is scored along the way."""
SCORES = {"chamfer_mm": 1.0, "iou": -1.0, "curve_chamfer_mm": 1.0, "curve_iou": -1.0}
"""And which way is worse."""


def measured(name: str, meshes: list[Path], episodes: int, seed: int) -> dict[str, np.ndarray]:
    """The scores of one strategy, an episode a row, and its processor time [s] for each."""
    tables = [{"name": name} for name in OBJECTS] + [
        {"name": mesh.stem, "mesh": str(mesh), "units": "m"} for mesh in meshes]
    cells = [Cell(STRATEGIES[name], table, table["name"], seed=seed) for table in tables]
    run_cells([(cell, np.arange(episodes, episodes + 1)) for cell in cells], "cpu")  # compiles
    begin = time.process_time()
    rows = run_cells([(cell, np.arange(episodes)) for cell in cells], "cpu")
    spent = time.process_time() - begin
    found = {score: np.concatenate([[_mean(v) for v in part[score]] for part in rows])
             for score in SCORES}
    print(f"{name}: {1e3 * spent / len(found['iou']):.1f} ms an episode", flush=True)
    return found | {"seconds": np.array(spent / len(found["iou"]))}


def _mean(value: float | np.ndarray) -> float:
    """A score, or the mean of a curve after its begin."""
    values = np.atleast_1d(value)
    return float(values[min(EARLY, len(values) - 1):].mean())


def compare(before: Path, after: Path) -> int:
    """Prints the table; 1 if an interval of a score at the end does not exclude the loss."""
    one, other = np.load(before), np.load(after)
    names = [key.removesuffix("/seconds") for key in one.files
             if key.endswith("/seconds") and key in other.files]
    head = " | ".join(f"{score} [%]" for score in SCORES)
    print(f"| strategy | ms an episode | {head} |\n|{'---|' * (len(SCORES) + 2)}")
    worse = 0
    for name in names:
        spent = [1e3 * float(run[f"{name}/seconds"]) for run in (one, other)]
        cells = [name, f"{spent[0]:.0f}, then {spent[1]:.0f}"]
        for score, bad in SCORES.items():
            first, then = one[f"{name}/{score}"], other[f"{name}/{score}"]
            change = (then - first) / first.mean()
            wide = 1.96 * change.std(ddof=1) / np.sqrt(len(change))
            cells.append(f"{100 * change.mean():+.1f} ({100 * (change.mean() - wide):+.1f} to "
                         f"{100 * (change.mean() + wide):+.1f})")
            if not score.startswith("curve"):
                worse += bool(bad * change.mean() + wide > LOSS)
        print(f"| {' | '.join(cells)} |")
    return int(worse > 0)


def main() -> int:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run")
    runs.add_argument("out", type=Path)
    runs.add_argument("--strategies", nargs="+", default=["even", "expected-error"])
    runs.add_argument("--meshes", type=Path)
    runs.add_argument("--episodes", type=int, default=32)
    runs.add_argument("--seed", type=int, default=20)
    compares = commands.add_parser("compare")
    compares.add_argument("before", type=Path)
    compares.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "compare":
        return compare(given.before, given.after)
    meshes = [] if given.meshes is None else sorted(given.meshes.glob("*.ply"))
    found = {f"{name}/{key}": values for name in given.strategies for key, values in
             measured(name, meshes, given.episodes, given.seed).items()}
    np.savez(given.out, **found)  # pyright: ignore[reportArgumentType]
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
