"""A race of 1,000 ring variants, timed, and its winner confirmed by an independent sweep.

    python tests/scripts/race_confirmed.py runs/thousand --within 1 --workers 2

Races 1,000 variants of a ring on the paper's six objects (count, tilt, aim, height of the palm,
closings), and says how long that took, what of it was the workers' and what the parent's processor
time. Then sweeps the winner, and the next of the race by their means, with 1,000 episodes of each
on other seeds, and says by how much the winner is behind the best of them, with the interval of
these objects. Fails if it is surely behind by more than the margin.
"""

import argparse
import csv
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from sweeps.analysis.entries import entries_of, entry_axes
from sweeps.analysis.paired import read_paired
from sweeps.run.plan import plan_study
from sweeps.run.store import open_study
from sweeps.spec.reader import read_spec

OBJECTS = '["block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel"]'
VARIANTS = """
[[strategy]]
name = "ring"
waypoints = { kind = "ring", count = 4 }
closings = ["together"]

[sweep.grid]
"strategy.count" = [3, 4, 5, 6]
"strategy.tilt_deg" = [30, 35, 40, 45, 50, 55, 60, 65, 70, 75]
"strategy.aim" = [0.3, 0.4, 0.5, 0.6, 0.7]
"strategy.closings" = [["curl40", "base_then_curl"], ["together"], ["curl40"], ["base_then_curl"],
                       ["together", "curl40"]]
"""
RACE_SEED, SWEEP_SEED = 3201, 3202


def run(words: list[str]) -> float:
    """Runs a command of warpgrasp; the seconds that it took come back."""
    began = time.monotonic()
    subprocess.run([sys.executable, "-m", "sweeps", *words], check=True,
                   stdout=subprocess.DEVNULL)
    return time.monotonic() - began


def spec(seed: int, episodes: int, rest: str) -> str:
    """A study of the six objects."""
    return (f'schema = 1\nseed = {seed}\nepisodes_per_cell = {episodes}\nobjects = {OBJECTS}\n'
            f"{rest}")


def strategies_of(file: Path, labels: list[str], seed: int, episodes: int) -> str:
    """The spec of a sweep of these entries alone, each a strategy of its own."""
    plan = plan_study(read_spec(file))
    entries = {entry.label: entry for entry in entries_of(plan, entry_axes(plan, None)[0])}
    tables = []
    for number, label in enumerate(labels):
        points = entries[label].points
        given = {key.removeprefix("strategy."): value for n, point in points.items()
                 for key, value in zip(plan.study.axes[n].keys, plan.study.axes[n].values[point],
                                       strict=True)}
        closings = list(given.pop("closings"))
        family = ", ".join(f"{key} = {value}" for key, value in given.items())
        tables.append(f'[[strategy]]\nname = "entry{number}"\n'
                      f'waypoints = {{ kind = "ring", {family} }}\nclosings = {closings}\n')
    return spec(seed, episodes, "\n".join(tables))


def main() -> int:
    """Runs both, prints what came out."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--within", type=float, default=1.0)
    parser.add_argument("--start", type=int, default=8)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rivals", type=int, default=9, help="of the race, beside its winner")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--budget-episodes", type=int)
    parser.add_argument("--set", action="append", default=[], help="as for sweep: fewer variants")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    file, race, sweep = (given.folder / name for name in ("race.toml", "race", "sweep"))
    file.write_text(spec(RACE_SEED, 64, VARIANTS))
    words = [text for value in given.set for text in ("--set", value)]
    if given.budget_episodes is not None:
        words += ["--budget-episodes", str(given.budget_episodes)]
    took = run(["race", str(file), "-o", str(race), "--within", str(given.within), "--start",
                str(given.start), "--workers", str(given.workers), *words])
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    rows = list(csv.DictReader((race / "race.csv").read_text().splitlines()))
    episodes = sum(int(row["n_episodes"]) for row in rows)
    units = len(list((race / "units").glob("*.parquet")))
    print(f"race of {len(rows):,}: {took:.0f} s, {used.ru_utime + used.ru_stime:.0f} s of "
          f"processor time, {episodes:,} episodes in {units:,} units, {rows[0]['strategy']}",
          flush=True)
    labels = [row["strategy"] for row in rows[:1 + given.rivals]]
    second = given.folder / "sweep.toml"
    second.write_text(strategies_of(file, labels, SWEEP_SEED, given.episodes))
    took = run(["sweep", str(second), "-o", str(sweep), "--workers", str(given.workers)])
    plan, stores = open_study([sweep])
    found = read_paired(plan, stores, ["chamfer_mm"]).statistics("chamfer_mm")
    means = found.values("these").value
    best = int(np.argmin(means))
    apart = found.differences(best, "these")
    print(f"sweep of {len(labels)}, {given.episodes:,} episodes of each on each object, {took:.0f} "
          f"s: the winner is number {1 + int((means < means[0]).sum())}, {apart.value[0]:.3f} mm "
          f"({apart.low[0]:.3f} to {apart.high[0]:.3f}) behind the first")
    return int(apart.low[0] > given.within)


if __name__ == "__main__":
    sys.exit(main())
