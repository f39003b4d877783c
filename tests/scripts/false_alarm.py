"""How often two copies of one strategy are told apart: they must not be, but by chance.

    python tests/scripts/false_alarm.py --studies 100

Runs `sweeps/studies/false_alarm.toml` with so many study seeds (two strategies that differ in name
and noise stream alone) and counts whose 95 % interval of the difference contains zero. With a true
rate of 0.95, 93 to 97 of 100 is what about two thirds of such counts show; the count over more
studies says more. Takes some ten minutes for 100 on one core.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.episode.episodes import run_episodes
from sweeps.output import init_warp
from sweeps.run.plan import plan_study
from sweeps.run.store import Store
from sweeps.run.unit_file import write_unit
from sweeps.spec.reader import read_spec

SPEC = Path(__file__).parents[2] / "sweeps" / "studies" / "false_alarm.toml"


def interval(seed: int, episodes: int) -> tuple[float, float]:
    """The interval of the difference between the two copies, of one study."""
    plan = plan_study(read_spec(SPEC, (f"seed={seed}", f"episodes_per_cell={episodes}")))
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        store.open_for(plan, SPEC.read_bytes(), "cpu")
        for unit in plan.units():
            write_unit(store.path(unit), unit.id,
                       run_episodes(unit.cell, np.arange(unit.start, unit.stop), "cpu"))
        board = make_leaderboard(plan, [store])
    low, high = (board.header.index(name) for name in ("delta_ci_low", "delta_ci_high"))
    return float(board.rows[1][low]), float(board.rows[1][high])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first study seed")
    parser.add_argument("--episodes", type=int, default=8, help="of each copy on each object")
    given = parser.parse_args()
    init_warp()
    held = 0
    for number, seed in enumerate(range(given.first, given.first + given.studies), 1):
        low, high = interval(seed, given.episodes)
        held += low <= 0.0 <= high
        print(f"seed {seed}: [{low:.3f}, {high:.3f}] mm; {held} of {number} hold zero", flush=True)
