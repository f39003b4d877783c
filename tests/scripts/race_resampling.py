"""How often races end right, and what they cost, by resampling the rows of a sweep.

    python tests/scripts/race_resampling.py runs/rings --episodes 2000 --races 1000

Runs a sweep of 24 ring variants on the paper's six objects into the folder, unless it is there. Its
rows are then taken for the truth. A race draws replicates with replacement: of each object one
episode, with the scores that every entry has in it, failures and all. Cases:

- *real*: the rows as they are. Wrong is a winner that is worse than the best by more than `within`.
- *equal*: all entries draw episodes of one entry, each its own. Wrong is a race in which any entry
  was out.
- *tails*: one episode in a hundred, of each entry on its own, is worse by a Pareto draw (shape 2.1,
  whose variance is barely finite; 10 mm at least), on average by as much for all.
- *safe*: as *real*, scores cut at 30 mm, bounds that need no assumption.
- *thousand*: 1,000 entries, each with the residuals of one of the 24 (half of its episodes
  exchanged among themselves), and means that spread upwards from the best as a gamma distribution.

Costs are in replicates, an episode on each object. *Equal allocation* takes as many of every entry.
Planned in advance, with Bonferroni's correction, it needs (z s / within)^2 of each: `planned` with
z of N - 1 one-sided comparisons, `pairs` with that of all pairs, two-sided, as a leaderboard makes
them; s is the largest spread of a difference to the best. `hindsight` is what N - 1 comparisons
would have needed had the means been known: (z s / (within + difference))^2, the largest.
"""

import argparse
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ndtri

from sweeps.analysis.paired import read_paired
from sweeps.race.elimination import Part, Race, Rules
from sweeps.run.store import open_study

SPEC = """\
schema = 1
name = "rings"
seed = 3200
episodes_per_cell = {episodes}
objects = ["block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel"]

[[strategy]]
name = "ring"
waypoints = {{ kind = "ring", count = 4 }}

[sweep.grid]
"strategy.count" = [4, 5]
"strategy.tilt_deg" = [40, 55, 70]
"strategy.aim" = [0.4, 0.6]
"strategy.closings" = [["curl40", "base_then_curl"], ["together"]]
"""


@dataclass(frozen=True)
class Population:
    """What is drawn from: scores (entry, object, episode)."""

    scores: np.ndarray
    worst: np.ndarray
    """What a failed episode counts as, (object,): a race knows it from the priors' scores."""

    @property
    def worse(self) -> np.ndarray:
        """By how much each entry's mean is above the best, (entry,)."""
        means = self.scores.mean(axis=(1, 2))
        return means - means.min()

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation of a replicate's difference to the best, (entry,)."""
        apart = self.scores - self.scores[self.worse.argmin()]
        return np.sqrt(apart.var(axis=2).sum(axis=1)) / apart.shape[1]


Draw = Callable[[np.random.Generator, int], np.ndarray]
"""Scores of so many replicates, (entry, object, replicate)."""


def paired_draw(population: Population) -> Draw:
    """Of each object one episode, the same for all entries."""
    _, objects, episodes = population.scores.shape

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        drawn = rng.integers(0, episodes, (objects, count))
        return population.scores[:, np.arange(objects)[:, None], drawn]

    return draw


def own_draw(population: Population, entry: int) -> Draw:
    """Every entry draws its own episodes of one entry."""
    entries, objects, episodes = population.scores.shape

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        drawn = rng.integers(0, episodes, (entries, objects, count))
        return population.scores[entry][np.arange(objects)[:, None], drawn]

    return draw


def run_race(draw: Draw, entries: int, rules: Rules, seed: int, worst: np.ndarray) -> Race:
    """One race; replicates are drawn in blocks, so that all entries have the same."""
    rng = np.random.default_rng(seed)
    drawn = draw(rng, 64)
    race = Race(entries, rules)
    while asked := race.asked():
        while drawn.shape[2] < max(stop for _, _, stop in asked):
            drawn = np.concatenate([drawn, draw(rng, drawn.shape[2])], axis=2)
        race.take(asked, found_of(asked, drawn), worst)
    return race


def found_of(asked: list[Part], drawn: np.ndarray) -> list[np.ndarray]:
    """The scores of what was asked."""
    return [drawn[entry, :, start:stop] for entry, start, stop in asked]


def with_tails(scores: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Scores (entry, object, episode) with rare episodes that are far worse."""
    worse = 10.0 * (1.0 + rng.pareto(2.1, scores.shape)) * (rng.random(scores.shape) < 0.01)
    return scores + worse - worse.mean(axis=2, keepdims=True)


def thousand(scores: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """1,000 entries made of the residuals of those there are."""
    entries, _, episodes = scores.shape
    residual = scores - scores.mean(axis=2, keepdims=True)
    made = residual[rng.integers(0, entries, 1000)]
    for one in made:
        moved = np.flatnonzero(rng.random(episodes) < 0.5)
        one[:, moved] = one[:, rng.permutation(moved)]
    return made + (4.0 + 3.0 * rng.gamma(2.0, 0.6, 1000))[:, None, None]


def report(name: str, population: Population, draw: Draw, rules: Rules, races: int) -> None:
    """Runs the races of one case, and prints its line."""
    entries = len(population.scores)
    worse, spread = population.worse, population.spread
    if name == "equal":  # of episodes that are not paired
        spread = np.sqrt(2.0 * population.scores.var(axis=2).sum(axis=1)) / len(
            population.scores[0])
    wrong, taken = 0, []
    for seed in range(races):
        race = run_race(draw, entries, rules, seed, population.worst)
        last = race.looks[-1]
        wrong += bool(last.out.any() if name == "equal"
                      else worse[last.leader] > rules.within)
        taken.append(last.total)
    alpha = 1.0 - rules.confidence
    one, two = -ndtri(alpha / (entries - 1)), -ndtri(alpha / entries / (entries - 1))
    planned, pairs = (entries * (z * spread.max() / rules.within) ** 2 for z in (one, two))
    hindsight = entries * ((one * spread / (rules.within + worse)) ** 2).max()
    mean = float(np.mean(taken))
    print(f"{name:9} {entries:7} {rules.within:6g} {rules.start:5} {races:5} {wrong:5} "
          f"{mean:11,.0f} {np.quantile(taken, 0.95):9,.0f} {planned / mean:8.1f} "
          f"{pairs / mean:6.1f} {hindsight / mean:9.1f}", flush=True)


def rows_of(folder: Path, episodes: int, workers: int) -> Population:
    """The scores of the sweep, which is run unless it is there."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    spec = folder.with_suffix(".toml")
    spec.write_text(SPEC.format(episodes=episodes))
    subprocess.run([sys.executable, "-m", "sweeps", "sweep", str(spec), "-o", str(folder),
                    "--workers", str(workers)], check=True, stdout=subprocess.DEVNULL)
    plan, stores = open_study([folder])
    names = ["chamfer_mm", "prior_chamfer_mm"]
    scores, priors = (np.array(read_paired(plan, stores, names).values[name]) for name in names)
    return Population(scores.transpose(2, 0, 1), priors.max(axis=(1, 2)))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--races", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    real = rows_of(given.folder, given.episodes, given.workers)
    scores, worst = real.scores, real.worst
    print("case      entries within start races wrong  replicates  95 % of  planned  pairs "
          "hindsight")
    for start in (2, 4, 8, 16):
        report("real", real, paired_draw(real), Rules(0.25, start=start), given.races)
    for within in (0.1, 0.5, 1.0, 2.0):
        report("real", real, paired_draw(real), Rules(within), given.races)
    best = int(real.worse.argmin())
    for start in (2, 4, 8):
        report("equal", Population(scores[[best] * len(scores)], worst), own_draw(real, best),
               Rules(0.5, start=start), given.races)
    tails = Population(with_tails(scores, np.random.default_rng(1)), worst)
    for start in (2, 4, 8, 16):
        report("tails", tails, paired_draw(tails), Rules(0.5, start=start), given.races)
    cut = Population(np.minimum(scores, 30.0), worst)
    report("safe", cut, paired_draw(cut), Rules(1.0, bounds=(0.0, 30.0)),
           max(1, given.races // 20))
    many = Population(thousand(scores, np.random.default_rng(3)), worst)
    for start in (4, 8):
        report("thousand", many, paired_draw(many), Rules(0.25, start=start),
               max(1, given.races // 20))


if __name__ == "__main__":
    main()
