"""Kills a study with SIGKILL at random moments, resumes it each time, and compares the end.

    python tests/scripts/hostile/kill_study.py --kills 50 --units 60

The study runs the stand-in episodes, slowed down, so that the kills meet it at work: the spine
(units, store, runner, leaderboard) is what is tested, not the simulator. Fails if the leaderboard
or any unit differs from an uninterrupted run, or if a unit was run after it had been written.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from sweeps.run.plan import Plan, plan_study
from sweeps.spec.reader import read_spec

HERE = Path(__file__).parents[2] / "helpers"
SPEC = """\
schema = 1
seed = 11
episodes_per_cell = {episodes}
objects = ["block", "wedge", "funnel"]
[[strategy]]
name = "ring6"
[[strategy]]
name = "random6"
"""
RUN = ("import sys; from sweeps.cli import main as cli; from sweeps.run import worker; "
       "worker.EPISODES = 'fake_episodes:logged_episodes'; cli.main(sys.argv[1:])")


def command(spec: Path, out: Path) -> list[str]:
    return [sys.executable, "-c", RUN, "sweep", str(spec), "-o", str(out), "--workers", "2"]


def environment(seconds: float, log: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(HERE), "FAKE_SECONDS": str(seconds),
            "FAKE_LOG": str(log)}


def study(folder: Path, units: int) -> Path:
    spec = folder / "spec.toml"
    spec.write_text(SPEC.format(episodes=64 * (units // 6)))
    return spec


def kill_and_resume(folder: Path, units: int, kills: int, seconds: float,
                    seed: int) -> tuple[list[str], int]:
    """What went wrong, one line each, and how many times the study was completed.

    A study that completes between two kills is compared and begun again in a new directory.
    """
    spec, whole = study(folder, units), folder / "whole"
    plan = plan_study(read_spec(spec))
    subprocess.run(command(spec, whole), check=True, capture_output=True,
                   env=environment(0, folder))
    chance = random.Random(seed)
    wrong: list[str] = []
    killed = rounds = 0
    while killed < kills:
        rounds += 1
        pieces, log = folder / f"pieces{rounds}", folder / f"log{rounds}"
        log.mkdir()
        code: int | None = None
        while code is None:
            code = run_once(command(spec, pieces), environment(seconds, log), chance,
                             kill=killed < kills)
            killed += code is None
            written = _mark_written(plan, pieces, log)
            print(f"kill {killed}, round {rounds}: {written} of {units} units", file=sys.stderr)
        if code:
            wrong.append(f"round {rounds} ended with {code}")
        wrong += _compare(whole, pieces)
        wrong += [f"{file.name} was run again after it was written" for file in log.iterdir()
                  if "after" in file.read_text()]
    return wrong, rounds


def run_once(run: list[str], given: dict[str, str], chance: random.Random,
              kill: bool) -> int | None:
    """Starts the study and kills it at a random moment; its exit code if it ended before."""
    process = subprocess.Popen(run, env=given, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        return process.wait(chance.uniform(0.5, 8.0) if kill else None)
    except subprocess.TimeoutExpired:
        # all at once (a lost machine) or the parent alone (its workers must notice)
        if chance.random() < 0.5:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
        process.wait()
        return None


def _mark_written(plan: Plan, pieces: Path, log: Path) -> int:
    """Notes for the stand-in which units are there; a run that begins one again says so."""
    count = 0
    for unit in plan.units():
        if (pieces / "units" / f"{unit.id}.parquet").exists():
            count += 1
            name = f"{unit.cell.strategy.name}-{unit.cell.object_name}-{unit.start}"
            (log / f"{name}.written").touch()
    return count


def _compare(whole: Path, pieces: Path) -> list[str]:
    names = sorted(os.listdir(whole / "units"))
    wrong = [f"{pieces.name}/{name} differs from the uninterrupted run"
             for name in ("leaderboard.csv", *(f"units/{name}" for name in names))
             if not (pieces / name).exists()
             or (pieces / name).read_bytes() != (whole / name).read_bytes()]
    if names != sorted(os.listdir(pieces / "units")):
        wrong.append(f"{pieces.name}/units holds other files")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--units", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=1.0, help="that a unit takes")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wrong, rounds = kill_and_resume(Path(folder), given.units, given.kills, given.seconds,
                                        given.seed)
    print("\n".join(wrong) if wrong else
          f"{given.kills} kills, study completed {rounds} times: the leaderboard and all "
          f"{given.units} units are the same bytes, none was run after it was written")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
