"""Runs a study of honest strategies beside a hundred planners that try to spoil it.

    python tests/scripts/hostile/hostile_planners.py --planners 100

Each hostile planner does its worst at once or after an honest grasp. The rows of the honest
strategies must be those of a study without the others, every hostile one must end in rows or a log
of its own, and no process may stay. Prints what each was told; fails with a line for each wrong.
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from sweeps.run.store import Store, open_study

HONEST = """\
schema = 1
seed = 5
episodes_per_cell = 4
objects = ["block"]
[[strategy]]
name = "ring6"
[[strategy]]
name = "top2-ring6"
"""
WORST = {
    "raises": "raise ValueError('no')",
    "interrupts": "raise KeyboardInterrupt",
    "exits": "sys.exit({n})",
    "exits at once": "os._exit({n})",
    "forks": "os.fork()",
    "forks and leaves": "os.fork() or os._exit({n})",
    "forks much": "[os.fork() for _ in range(3)]",
    "starts a process": "subprocess.Popen(['sleep', '3601'])",
    "crashes": "os.kill(os.getpid(), 11)",
    "is killed": "os.kill(os.getpid(), 9)",
    "is terminated": "os.kill(os.getpid(), 15)",
    "kills its group": "os.killpg(0, 15)",
    "stops": "os.kill(os.getpid(), 19)",
    "sleeps": "time.sleep(3601)",
    "spins": "[None for _ in iter(int, 1)]",
    "ignores signals": "[signal.signal(s, signal.SIG_IGN) for s in (2, 15)], time.sleep(3601)",
    "takes memory": "bytearray(1 << 40)",
    "fills memory": "[bytearray(1 << 28) for _ in iter(int, 1)]",
    "prints": "print('x' * (4 << 20), flush=True)",
    "prints controls": "print('\\x1b[2J\\x1b]0;mine\\x07', flush=True)",
    "answers nonsense": "return [object()]",
    "answers no numbers": "return [Grasp(np.full((belief.worlds, 1, 7), np.nan))]",
    "answers no shape": "return [Grasp(np.zeros(3))]",
    "answers for ever": "return iter(lambda: Grasp(honest(belief)), None)",
    "recurses": "return choose(belief)",
    "leaves threads": "threading.Thread(target=time.sleep, args=(3601,), daemon=False).start()",
    "spoils numpy": "np.zeros = np.array = None",
    "clears the environment": "os.environ.clear()",
    "closes files": "os.closerange(3, 200)",
    "leaves the folder": "os.chdir('/')",
    "writes to its belief": "belief.touches[:] = 0",
    "has a name with escapes": "raise ValueError('\\x1b[31m' + '\\u202e' * 50)",
}
FILE = """\
import os, signal, subprocess, sys, threading, time

import numpy as np
from strategies import Grasp
from strategies.poses import Ring, waypoint_poses


def honest(belief):
    return waypoint_poses([Ring(count=2)], belief.prior, belief.hand, belief.seed)


def choose(belief):
    if belief.step < {after}:
        return [Grasp(honest(belief))]
    if belief.step > {after}:
        return []
    {line}
    return [Grasp(honest(belief))]
"""


def sweep(spec: Path, out: Path, limit_s: float) -> int:
    """Runs a study from the command line; its exit code."""
    return subprocess.run(
        [sys.executable, "-m", "sweeps.cli.main", "sweep", str(spec), "-o", str(out), "--workers",
         "2", "--quiet", "--unit-timeout-s", str(limit_s)], check=False, capture_output=True,
        env={**os.environ, "MARK": "hostile"}).returncode


def leftovers() -> list[str]:
    """Processes that are still there: sleepers, and workers without a study."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            line = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            mine = folder.name.isdigit() and int(folder.name) != os.getpid()
            if mine and ("sleep 3601" in line or b"MARK=hostile" in (
                    folder / "environ").read_bytes()):
                found.append(f"{folder.name}: {line[:100]}")
        except OSError:
            continue
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planners", type=int, default=100)
    parser.add_argument("--limit-s", type=float, default=20.0)
    asked = parser.parse_args()
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "honest.toml").write_text(HONEST)
        text, kinds = HONEST, {}
        for number in range(asked.planners):
            kind = list(WORST)[number % len(WORST)]
            name = f"p{number}"
            line = WORST[kind].replace("{n}", str(number % 3))
            (folder / f"{name}.py").write_text(
                FILE.format(line=line, after=number // len(WORST) % 2))
            text += f'[[strategy]]\nname = "{name}"\nstrategy = "{name}.py:choose"\n'
            kinds[name] = kind
        (folder / "hostile.toml").write_text(text)
        began = time.monotonic()
        codes = [sweep(folder / f"{name}.toml", folder / name, asked.limit_s)
                 for name in ("honest", "hostile")]
        print(f"exit codes {codes}, {time.monotonic() - began:.0f} s")
        alone = {file.name: file.read_bytes() for file in (folder / "honest/units").iterdir()}
        for name, content in alone.items():
            file = folder / "hostile/units" / name
            if not file.exists() or file.read_bytes() != content:
                wrong.append(f"the honest unit {name} is not what it was alone")
        plan, _ = open_study([folder / "hostile"])
        store = Store(folder / "hostile")
        rows = csv.writer(sys.stdout)
        for unit in plan.units():
            name = unit.cell.strategy.name
            if name not in kinds:
                continue
            found = store.read(unit)
            log = store.log(unit)
            said = (str(found["status"][0]) + " " + str(found["note"][0]) if found is not None
                    else log.read_text().strip().splitlines()[-1] if log.exists() else "")
            rows.writerow([name, kinds[name], said[:110]])
            if not said:
                wrong.append(f"{name} ({kinds[name]}) has neither rows nor a log")
            if "\x1b" in said or "\u202e" in said:
                wrong.append(f"{name} ({kinds[name]}): control characters in what it was told")
        time.sleep(1.0)
        wrong += [f"left behind: {line}" for line in leftovers()]
    for line in wrong:
        print(line, file=sys.stderr)
    print(f"{asked.planners} planners, {len(wrong)} wrong")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
