"""How often intervals hold the truth, and how often boards of equal entries claim a difference.

    python tests/scripts/interval_coverage.py runs/coverage --trials 2000

Runs two sweeps into the folder, unless they are there: ten objects with 512 episodes of each
strategy, and 48 objects (more with `--scans`) with 64. Their rows are then taken for the truth and
drawn from.

- *These*: objects of the first are drawn once a trial, and of each so many episodes; the truth is
  the mean of all 512.
- *Like these*: objects of the second are drawn with replacement, and of each so many episodes; the
  truth is the mean of all 48.
- *Everyday objects* (`--everyday`): as *like these*, of forty members of the families instead.
- *Each object* (`--sweep`, a study of many episodes a cell): of each object that every entry has
  finished so many episodes are drawn; the truth is the mean of all. Over all entries, how often
  intervals of means and of differences to the first entry hold, and the least and the most of any
  entry.
- *Equal entries*: every entry of a board draws its own episodes of one strategy. A board claims
  something where an interval of a difference to its best excludes zero.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

from sweeps.analysis.interval import ObjectMeans
from sweeps.analysis.paired import read_paired
from sweeps.run.store import open_study

CATALOGUE = ("block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel",
             "wine_bottle", "beer_bottle", "coke_bottle", "orangina_bottle")
STRATEGIES = """
[[strategy]]
name = "ring6"
[[strategy]]
name = "ring4"
waypoints = { kind = "ring", count = 4 }
[[strategy]]
name = "hemisphere8"
waypoints = { kind = "hemisphere", count = 8 }
"""
METRIC, BOUNDS = "chamfer_mm", (0.0, np.inf)
FORTY = {"mug": 6, "bowl": 6, "hammer": 6, "bottle": 6, "box": 6, "toy": 6, "pliers": 4}
"""Everyday objects of the public half, the first so many of each family."""


def spec(episodes: int, objects: list[str]) -> str:
    """A study of these objects, each as it stands in a TOML list."""
    return (f"schema = 1\nseed = 33\nepisodes_per_cell = {episodes}\n"
            f"objects = [{', '.join(objects)}]\n{STRATEGIES}")


def many_objects(scans: Path | None) -> list[str]:
    """The catalogue, 38 superquadrics, and the first ten meshes [m] of a folder."""
    rng = np.random.default_rng(48)
    found = [f'"{name}"' for name in CATALOGUE]
    for number in range(38):
        a, b, h = *rng.uniform(18, 45, 2), rng.uniform(25, 80)
        e1, e2 = rng.uniform(0.1, 1.6, 2)
        found.append(f'{{ name = "s{number}", superquadric = {{ size_mm = [{a:.1f}, {b:.1f}, '
                     f'{h:.1f}], exponents = [{e1:.2f}, {e2:.2f}] }} }}')
    meshes = sorted(scans.glob("*.ply"))[:10] if scans else []
    found += [f'{{ name = "{mesh.stem}", mesh = "{mesh.resolve()}", units = "m" }}'
              for mesh in meshes]
    return found


def values_of(folder: Path, text: str) -> np.ndarray:
    """The metric (object, episode, strategy) of a study, which is run unless it is there."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    file = folder.with_suffix(".toml")
    file.write_text(text)
    subprocess.run([sys.executable, "-m", "sweeps", "sweep", str(file), "-o", str(folder),
                    "--workers", "2"], check=True, stdout=subprocess.DEVNULL)
    plan, stores = open_study([folder])
    return np.array(read_paired(plan, stores, [METRIC]).values[METRIC])


def held(low: np.ndarray, high: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Which intervals hold the truth."""
    return (low <= truth) & (truth <= high)


def coverage(over: str, truth: np.ndarray, samples: list[list[np.ndarray]]) -> str:
    """Of the means of each strategy, and of their differences to the first [%]."""
    hits = np.zeros(2 * truth.shape[1] - 1)
    for sample, means in zip(samples, truth, strict=True):
        board = ObjectMeans(len(means), 0)
        for values in sample:
            board.add(values)
        found, apart = board.values(over, BOUNDS), board.differences(0, over, simultaneous=False)
        hits += [*held(found.low, found.high, means),
                 *held(apart.low, apart.high, means - means[0])[1:]]
    return "  ".join(f"{v:5.1f}" for v in 100 * hits / len(samples))


def each_object(folder: Path, trials: int, rng: np.random.Generator) -> None:
    """Prints how often intervals of one object hold, by object and number of episodes."""
    plan, stores = open_study([folder])
    paired = read_paired(plan, stores, [METRIC])
    print("each object        episodes  % held, of all (least to most): means; differences")
    for name, values in zip(paired.objects, paired.values[METRIC], strict=True):
        means = values.mean(axis=0)
        for episodes in (8, 16, 64, 256):
            if 4 * episodes > len(values):  # too much of the truth itself
                continue
            hits = np.zeros((2, values.shape[1]))
            for _ in range(trials):
                board = ObjectMeans(len(means), 0)
                board.add(values[rng.choice(len(values), episodes, replace=False)])
                found = board.values("these", BOUNDS)
                apart = board.differences(0, "these", simultaneous=False)
                hits += [held(found.low, found.high, means),
                         held(apart.low, apart.high, means - means[0])]
            shares = 100 * hits / trials
            shown = (shares[0], shares[1][1:])
            print(f"{name:18} {episodes:9}  " + "; ".join(
                f"{part.mean():.1f} ({part.min():.1f} to {part.max():.1f})" for part in shown),
                flush=True)


def claims(board: ObjectMeans, over: str) -> bool:
    """Whether an entry is said to differ from the best."""
    best = int(np.argmin(board.values("these").value))
    found = board.differences(best, over)
    return bool(((found.low > 0) | (found.high < 0)).any())


def these_objects(deep: np.ndarray, trials: int, rng: np.random.Generator) -> None:
    """Prints how often intervals of these objects hold; `deep` has 512 episodes of each."""
    print("claim       objects  episodes  % held: means; differences to the first")
    for objects in (1, 3, 6, 10):
        for episodes in (8, 16, 64):
            samples, truth = [], []
            for _ in range(trials):
                drawn = rng.choice(len(deep), objects, replace=False)
                samples.append([deep[n][rng.choice(512, episodes, replace=False)] for n in drawn])
                truth.append(deep[drawn].mean(axis=(0, 1)))
            print(f"these       {objects:7}  {episodes:8}  "
                  f"{coverage('these', np.array(truth), samples)}", flush=True)


def like_these(many: np.ndarray, trials: int, rng: np.random.Generator) -> None:
    """Prints how often intervals of objects like these hold; `many` has 64 episodes of each."""
    print("claim       objects  episodes  % held: means; differences to the first")
    for objects in (3, 6, 10, 20):
        for episodes in (8, 16, 64):
            samples = [[many[n][rng.integers(0, 64, episodes)]
                        for n in rng.integers(0, len(many), objects)] for _ in range(trials)]
            truth = np.tile(many.mean(axis=(0, 1)), (trials, 1))
            print(f"like-these  {objects:7}  {episodes:8}  "
                  f"{coverage('like-these', truth, samples)}", flush=True)


def equal_entries(deep: np.ndarray, trials: int, rng: np.random.Generator) -> None:
    """Prints how many boards of equal entries claim a difference."""
    print("\nequal entries  objects  episodes  % of boards that claim: these  like-these")
    for entries in (2, 6, 15, 100):
        for objects, episodes in ((3, 8), (6, 8), (6, 16), (10, 64)):
            boards = trials if entries < 100 else max(1, trials // 4)
            count = np.zeros(2)
            for _ in range(boards):
                board = ObjectMeans(entries, 0)
                for n in rng.choice(len(deep), objects, replace=False):
                    board.add(deep[n][rng.integers(0, 512, (episodes, entries)), 0])
                count += [claims(board, "these"), claims(board, "like-these")]
            print(f"{entries:13}  {objects:7}  {episodes:8}  {100 * count[0] / boards:29.1f}  "
                  f"{100 * count[1] / boards:10.1f}", flush=True)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--scans", type=Path, help="folder of scanned meshes, which join the 48")
    parser.add_argument("--everyday", action="store_true", help="forty members of the families")
    parser.add_argument("--sweep", type=Path, help="look at each object of this study instead")
    given = parser.parse_args()
    rng = np.random.default_rng(1)
    if given.sweep is not None:
        each_object(given.sweep, given.trials, rng)
        return
    if given.everyday:
        forty = [f'"{family}-{seed}"' for family, count in FORTY.items() for seed in range(count)]
        like_these(values_of(given.folder / "everyday", spec(64, forty)), given.trials, rng)
        return
    deep = values_of(given.folder / "deep", spec(512, [f'"{name}"' for name in CATALOGUE]))
    many = values_of(given.folder / "many", spec(64, many_objects(given.scans)))
    these_objects(deep, given.trials, rng)
    like_these(many, given.trials, rng)
    equal_entries(deep, given.trials, rng)


if __name__ == "__main__":
    main()
