"""Resident memory of a study of 20,000 episodes against one of 200,000, with stand-in episodes.

    python tests/scripts/memory_study.py --episodes 20000 200000

Each runs with one worker in a fresh process: units, store, runner and leaderboard are what is
measured. Then the finished study is run again, which should say so and read it through once.
Fails if the memory of the parent or of the worker grows by more than 5 % from first to last.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parents[1] / "helpers"
SPEC = """\
schema = 1
seed = 5
episodes_per_cell = {episodes}
objects = ["block", "wedge"]
[[strategy]]
name = "ring6"
[[strategy]]
name = "random6"
"""


def inner(spec: str, out: str) -> None:
    """Runs the study in this process and prints what it took."""
    sys.path.insert(0, str(HERE))
    from sweeps.cli import main as cli
    from sweeps.run import worker

    worker.EPISODES = "fake_episodes:run_episodes"
    began = time.monotonic()
    code = cli.run(["sweep", spec, "-o", out])
    usage = [resource.getrusage(who).ru_maxrss / 1024
             for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    print(json.dumps({"code": code, "parent_MiB": usage[0], "worker_MiB": usage[1],
                      "wall_s": time.monotonic() - began}))


def measure(folder: Path, episodes: int) -> dict[str, float]:
    """A study of so many episodes, run in a fresh process; then run again."""
    folder.mkdir()
    spec = folder / "spec.toml"
    spec.write_text(SPEC.format(episodes=episodes // 4))
    runs = []
    for _ in range(2):
        done = subprocess.run([sys.executable, __file__, "--inner", str(spec), str(folder / "out")],
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                              check=True)
        runs.append(json.loads(done.stdout.splitlines()[-1]))
        if runs[-1]["code"]:
            sys.exit(f"the sweep ended with {runs[-1]['code']}")
    first, again = runs
    print(f"{episodes} episodes: parent {first['parent_MiB']:.0f} MiB, worker "
          f"{first['worker_MiB']:.0f} MiB, {first['wall_s']:.1f} s; run again when finished: "
          f"{again['wall_s']:.1f} s, parent {again['parent_MiB']:.0f} MiB", flush=True)
    return first


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--episodes", type=int, nargs="+", default=[20_000, 200_000])
    parser.add_argument("--inner", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.inner:
        inner(*given.inner)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        found = [measure(Path(folder) / str(n), count) for n, count in enumerate(given.episodes)]
    growth = {name: found[-1][name] / found[0][name] - 1 for name in ("parent_MiB", "worker_MiB")}
    print(", ".join(f"{name[:-4]} {100 * value:+.1f} %" for name, value in growth.items()))
    return any(value > 0.05 for value in growth.values())


if __name__ == "__main__":
    sys.exit(main())
