"""Shows that bodies chosen among all kinds are no worse than the model alone where that fits.

    python tests/scripts/chosen_bodies.py OUT.npz [--strategies ring6 ...] [--episodes 16]

For each strategy, episodes of the ten objects of the catalogue with `reconstruct = "chosen"`. Each
episode is scored twice, by the model it recovered and by the body chosen, so that the two pair. OUT
gathers episodes over several calls with different seeds; printed is the table of all it holds:
changes as shares of the model's mean, with 95 % intervals over episodes.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from paired_scores import LOSS, OBJECTS

from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import cell_body, run_parts
from sweeps.spec.cell import Cell

AT_ONCE = 16
"""Episodes of each object in one call."""


def measured(name: str, first: int, count: int, seed: int) -> np.ndarray:
    """Seed, episode, whether a body was chosen, and chamfer [mm] and IoU of model and choice,
    (episode, 7)."""
    cells = [Cell(STRATEGIES[name], {"name": thing}, thing, seed=seed) for thing in OBJECTS]
    cells = [replace(cell, fit=replace(cell.fit, reconstruct="chosen")) for cell in cells]
    bodies, rows = [cell_body(cell) for cell in cells], []
    for begin in range(first, first + count, AT_ONCE):
        episodes = np.arange(begin, min(begin + AT_ONCE, first + count))
        block = run_parts([(cell, episodes) for cell in cells], bodies, "cpu", curve=False)
        model = block.moments[-1].scores if block.moments else block.prior_scores
        assert block.rebuilt is not None
        rows.append(np.column_stack([
            np.full(len(model.iou), seed), np.tile(episodes, len(cells)), block.rebuilt.made,
            model.chamfer_m * 1e3, block.scores.chamfer_m * 1e3, model.iou, block.scores.iou]))
    return np.concatenate(rows)


def line_of(name: str, rows: np.ndarray) -> tuple[str, bool]:
    """A row of the table, and whether an interval does not exclude the loss."""
    cells, lost = [], False
    for model, chosen, bad in ((rows[:, 3], rows[:, 4], 1.0), (rows[:, 5], rows[:, 6], -1.0)):
        change = (chosen - model) / model.mean()
        mean, wide = change.mean(), 1.96 * change.std(ddof=1) / np.sqrt(len(change))
        cells.append(f"{100 * mean:+.1f} ({100 * (mean - wide):+.1f} to "
                     f"{100 * (mean + wide):+.1f})")
        lost |= bool(bad * mean + wide > LOSS)
    return (f"| `{name}` | {len(rows)} | {rows[:, 2].mean():.2f} | {rows[:, 3].mean():.2f} "
            f"| {cells[0]} | {cells[1]} |{' a loss is not excluded' * lost}"), lost


def main() -> int:
    """Reads the command line; 1 if a loss of 2 % is not excluded somewhere."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--strategies", nargs="*", default=list(STRATEGIES))
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=91)
    given = parser.parse_args()
    found = dict(np.load(given.out)) if given.out.exists() else {}
    for name in given.strategies:
        rows = measured(name, given.first, given.episodes, given.seed)
        found[name] = np.concatenate([found.get(name, np.zeros((0, 7))), rows])
        np.savez(given.out, **found)  # pyright: ignore[reportArgumentType]
        print(line_of(name, found[name])[0], flush=True)
    print("\n| strategy | episodes | chosen | chamfer [mm] | change of it [%] | change of IoU [%] |"
          "\n|---|---|---|---|---|---|")
    lines = [line_of(name, rows) for name, rows in found.items()]
    print("\n".join(line for line, _ in lines))
    return int(any(lost for _, lost in lines))


if __name__ == "__main__":
    raise SystemExit(main())
