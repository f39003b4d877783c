"""What a second worker gains, and what the parent process costs, with the real simulator.

    python benchmarks/two_workers.py --episodes 1280

Runs the same study with one worker and with two, each in a fresh process and directory, and
prints for each: wall time, episodes a second, the processor time of the parent and of the workers,
and the share of the cores that the workers were given. On a machine that others use too the ratio
of wall times says little; the processor time an episode took says whether two workers hinder one
another. The two leaderboards must be the same bytes.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SPEC = """\
schema = 1
seed = 3
episodes_per_cell = {episodes}
objects = ["block", "large_cylinder"]
[[strategy]]
name = "ring6"
"""


def measure(spec: str, out: str, workers: int) -> dict[str, float]:
    """One run in this process: its own processor time is the parent's."""
    began, before = time.monotonic(), time.process_time()
    from sweeps.cli import main as cli

    code = cli.run(["sweep", spec, "-o", out, "--workers", str(workers)])
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"code": code, "workers": workers, "wall_s": time.monotonic() - began,
            "parent_cpu_s": time.process_time() - before,
            "workers_cpu_s": children.ru_utime + children.ru_stime}


def run(spec: Path, out: Path, workers: int, episodes: int) -> dict[str, float]:
    """A run in a fresh process."""
    done = subprocess.run(
        [sys.executable, __file__, "--inner", str(spec), str(out), str(workers)],
        stdout=subprocess.PIPE, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    if found["code"]:
        sys.exit(f"the sweep ended with {found['code']}")
    rate = episodes / found["wall_s"]
    share = found["workers_cpu_s"] / (workers * found["wall_s"])
    print(f"{workers} worker{'s' * (workers > 1)}: {found['wall_s']:.1f} s, {rate:.2f} episodes/s, "
          f"parent {found['parent_cpu_s']:.2f} s of processor time = "
          f"{100 * found['parent_cpu_s'] / found['wall_s']:.2f} % of the run and "
          f"{100 * found['parent_cpu_s'] / found['workers_cpu_s']:.2f} % of the workers' "
          f"{found['workers_cpu_s']:.1f} s, who had {100 * share:.0f} % of their cores",
          flush=True)
    return found


def main() -> None:
    """Runs the study twice and prints the ratio."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--episodes", type=int, default=1280, help="of each of two cells")
    parser.add_argument("--inner", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.inner:
        spec, out, workers = given.inner
        print(json.dumps(measure(spec, out, int(workers))))
        return
    print(f"{os.cpu_count()} cores, load before: {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spec = folder / "spec.toml"
        spec.write_text(SPEC.format(episodes=given.episodes))
        one, two = (run(spec, folder / str(n), n, 2 * given.episodes) for n in (1, 2))
        boards = [(folder / str(n) / "leaderboard.csv").read_bytes() for n in (1, 2)]
    print(f"two workers: {one['wall_s'] / two['wall_s']:.2f} times the episodes a second of one; "
          f"an episode took {two['workers_cpu_s'] / one['workers_cpu_s']:.2f} times the processor "
          f"time; leaderboards {'are the same bytes' if boards[0] == boards[1] else 'DIFFER'}")


if __name__ == "__main__":
    main()
