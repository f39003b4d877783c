"""Kills a race with SIGKILL at random moments, resumes it each time, and compares the end.

    python tests/scripts/hostile/kill_race.py --kills 200
    python tests/scripts/hostile/kill_race.py --kills 200 --what until
    python tests/scripts/hostile/kill_race.py --kills 200 --what search

It runs the stand-in episodes, slowed down, with one to three workers: a race of a list of entries,
`sweep --until`, or a race of a [search]. Fails if a table, the picture, or any unit differs from an
uninterrupted run.
"""

import argparse
import os
import random
import sys
import tempfile
from dataclasses import dataclass
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
SEARCH = SPEC[:SPEC.index('[[strategy]]\nname = "bee"')] + """
[search]
trials = 12
round = 6
finalists = 4
episodes = 8
"sensors.tendon_threshold_N" = { low = 1.0, high = 30.0 }
"strategy.closings" = [["together"], ["curl40", "base_then_curl"]]
"""
RUN = ("import sys; from sweeps.cli import main as cli; from sweeps.run import worker; "
       "worker.EPISODES = 'fake_episodes:slow_episodes'; "
       "cli.main(sys.argv[1:])")


@dataclass(frozen=True)
class Case:
    """What is killed: its spec, its command, and the tables that it leaves."""

    spec: str
    words: tuple[str, ...]
    within: str
    files: tuple[str, ...]

    def command(self, spec: Path, out: Path, workers: int) -> list[str]:
        """The whole command."""
        return [sys.executable, "-c", RUN, self.words[0], str(spec), "-o", str(out),
                self.words[1], self.within, "--workers", str(workers)]


CASES = {
    "race": Case(SPEC, ("race", "--within"), "0.3", ("race.csv", "race.svg")),
    "until": Case(SPEC, ("sweep", "--until"), "0.2", ("leaderboard.csv", "resolved.json")),
    "search": Case(SEARCH, ("race", "--within"), "0.5", ("race.csv", "race.svg", "search.csv")),
}


def kill_and_resume(folder: Path, case: Case, kills: int, seconds: float, seed: int
                    ) -> tuple[list[str], int]:
    """What went wrong, one line each, and how many times the race was completed."""
    spec, whole = folder / "spec.toml", folder / "whole"
    spec.write_text(case.spec)
    chance = random.Random(seed)
    wrong: list[str] = []
    if run_once(case.command(spec, whole, 2), environment(0, folder), chance, kill=False):
        return ["the uninterrupted race failed"], 0
    killed = rounds = 0
    while killed < kills:
        rounds += 1
        pieces = folder / f"pieces{rounds}"
        code: int | None = None
        while code is None:
            code = run_once(case.command(spec, pieces, chance.randint(1, 3)),
                            environment(seconds, folder), chance, kill=killed < kills)
            killed += code is None
            units = pieces / "units"
            there = len(list(units.glob("*.parquet"))) if units.exists() else 0
            print(f"kill {killed}, round {rounds}: {there} units", file=sys.stderr)
        wrong += [f"round {rounds} ended with {code}"] if code else compare(case, whole, pieces)
    return wrong, rounds


def compare(case: Case, whole: Path, pieces: Path) -> list[str]:
    """Files of the resumed race that differ from the uninterrupted one's."""
    names = sorted(os.listdir(whole / "units"))
    wrong = [f"{pieces.name}/{name} differs from the uninterrupted race"
             for name in (*case.files, *(f"units/{name}" for name in names))
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
    parser.add_argument("--what", choices=CASES, default="race")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wrong, rounds = kill_and_resume(Path(folder), CASES[given.what], given.kills,
                                        given.seconds, given.seed)
    print("\n".join(wrong) if wrong else
          f"{given.kills} kills, {given.what} completed {rounds} times: "
          f"{', '.join(CASES[given.what].files)} and all units are the same bytes")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
