"""Kills a race with SIGKILL at random moments, resumes it each time, and compares the end.

    python tests/scripts/kill_race.py --kills 200

The race runs the stand-in episodes, slowed down, with one to three workers. Fails if `race.csv`,
the picture, or any unit differs from an uninterrupted run.
"""

import argparse
import os
import random
import sys
import tempfile
from pathlib import Path

from kill_study import environment, run_once

SPEC = """\
schema = 1
seed = 12
objects = ["block", "wedge", "funnel"]
""" + "".join(f"""[[strategy]]
name = "{name}"
waypoints = {{ kind = "ring", count = 6 }}
""" for name in ("ant", "bee", "cow", "dog", "cat", "fox", "horse", "elephant"))
RUN = ("import sys; from sweeps.run import worker; from sweeps.cli import main as cli; "
       "worker.EPISODES = 'fake_episodes:slow_episodes'; cli.main(sys.argv[1:])")


def command(spec: Path, out: Path, workers: int) -> list[str]:
    return [sys.executable, "-c", RUN, "race", str(spec), "-o", str(out), "--within", "0.3",
            "--workers", str(workers)]


def kill_and_resume(folder: Path, kills: int, seconds: float, seed: int) -> tuple[list[str], int]:
    """What went wrong, one line each, and how many times the race was completed."""
    spec, whole = folder / "spec.toml", folder / "whole"
    spec.write_text(SPEC)
    chance = random.Random(seed)
    wrong: list[str] = []
    if run_once(command(spec, whole, 2), environment(0, folder), chance, kill=False):
        return ["the uninterrupted race failed"], 0
    killed = rounds = 0
    while killed < kills:
        rounds += 1
        pieces = folder / f"pieces{rounds}"
        code: int | None = None
        while code is None:
            code = run_once(command(spec, pieces, chance.randint(1, 3)),
                            environment(seconds, folder), chance, kill=killed < kills)
            killed += code is None
            units = pieces / "units"
            there = len(list(units.glob("*.parquet"))) if units.exists() else 0
            print(f"kill {killed}, round {rounds}: {there} units", file=sys.stderr)
        wrong += [f"round {rounds} ended with {code}"] if code else compare(whole, pieces)
    return wrong, rounds


def compare(whole: Path, pieces: Path) -> list[str]:
    """Files of the resumed race that differ from the uninterrupted one's."""
    names = sorted(os.listdir(whole / "units"))
    wrong = [f"{pieces.name}/{name} differs from the uninterrupted race"
             for name in ("race.csv", "race.svg", *(f"units/{name}" for name in names))
             if not (pieces / name).exists()
             or (pieces / name).read_bytes() != (whole / name).read_bytes()]
    if names != sorted(os.listdir(pieces / "units")):
        wrong.append(f"{pieces.name}/units holds other files")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=2.0, help="that a first unit takes")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wrong, rounds = kill_and_resume(Path(folder), given.kills, given.seconds, given.seed)
    print("\n".join(wrong) if wrong else
          f"{given.kills} kills, race completed {rounds} times: race.csv, race.svg and all units "
          "are the same bytes")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
