"""How often objects are recognized, and whether the probabilities are those observed.

    python tests/scripts/recognition_reliability.py --episodes 16 --scans ../shared/objects/ycb

Runs episodes of another seed than the shipped models were learned from: the catalogue's objects,
random ones that are not listed (`sweeps.episode.teaching`), and meshes [m] of a folder, which are
not listed either. Prints for each strategy the share of right answers by the models and by exact
bodies laid on the touches, and for each way predicted against observed shares. Unlisted episodes
are weighted to the share that `none_prior` says.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from strategies.ready_made import STRATEGIES
from strategies.recognition.answers import ALIGNMENT, Recognition
from sweeps.episode.episodes import cell_body, run_parts
from sweeps.episode.recognition_columns import recognize_objects, right_ones
from sweeps.episode.teaching import TEACHERS, unlisted_table
from sweeps.spec.cell import Cell
from warpgrasp.objects.catalogue_names import BODY_NAMES
from warpgrasp.parameters import RecognitionTable

EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0001)
TABLES = (RecognitionTable(), RecognitionTable(way=ALIGNMENT))


@dataclass(frozen=True)
class Answers:
    """Answers to episodes of one strategy, (episode,) each."""

    strategy: str
    kind: np.ndarray
    """catalogue, random or scan."""
    found: dict[str, Recognition]
    """By the `way` of the table."""
    right: dict[str, np.ndarray]


def answers_of(objects: Mapping[str, tuple[str, Mapping[str, Any]]], strategy: str, episodes: int,
               seed: int) -> Answers:
    """Answers by both tables; `objects` maps a name to its kind and table."""
    cells = [Cell(STRATEGIES[strategy], table, name, seed=seed)
             for name, (_, table) in objects.items()]
    kinds = [kind for kind, _ in objects.values()]
    bodies = [cell_body(cell) for cell in cells]
    block = run_parts([(cell, np.arange(episodes)) for cell in cells], bodies, "cpu")
    found = {table.way: recognize_objects(block.exploration.belief, block.recovered, table, "cpu")
             for table in TABLES}
    counts = [episodes] * len(bodies)
    right = {table.way: right_ones(found[table.way].name, bodies, table, counts)
             for table in TABLES}
    return Answers(strategy, np.repeat(kinds, episodes), found, right)


def reliability(answers: Sequence[Answers], none_prior: float = TABLES[0].none_prior
                ) -> dict[str, list[tuple[float, float, int, float, float]]]:
    """By way and for all: low, high, episodes, predicted and observed share of right answers.

    The last row of each is over all probabilities.
    """
    way = TABLES[0].way
    kind = np.concatenate([a.kind for a in answers])
    told = np.concatenate([a.found[way].way for a in answers])
    share = np.concatenate([a.found[way].probability for a in answers])
    right = np.concatenate([a.right[way] for a in answers])
    listed = kind == "catalogue"
    weight = np.where(listed, (1 - none_prior) / max((listed & (told != "")).sum(), 1),
                      none_prior / max((~listed & (told != "")).sum(), 1))
    tables = {}
    for name in ("all", *sorted(set(told) - {""})):
        mine = (told != "") if name == "all" else (told == name)
        rows = []
        for low, high in [*pairwise(EDGES), (EDGES[0], EDGES[-1])]:
            bin_ = mine & (np.nan_to_num(share, nan=-1.0) >= low) & (share < high)
            if bin_.any():
                w = weight[bin_]
                rows.append((low, min(high, 1.0), int(bin_.sum()),
                             float(np.average(share[bin_], weights=w)),
                             float(np.average(right[bin_], weights=w))))
        tables[name] = rows
    return tables


def held_out_objects(seed: int, unlisted: int, scans: Path | None) -> dict[str, tuple[str, dict]]:
    """Objects by name, each with its kind and its table."""
    found: dict[str, tuple[str, dict]] = {name: ("catalogue", {"name": name})
                                          for name in BODY_NAMES}
    for number in range(unlisted):
        table = unlisted_table(seed, number)
        found[table["name"]] = "random", table
    for mesh in sorted(scans.glob("*.ply")) if scans else []:
        found[mesh.stem] = "scan", {"mesh": str(mesh.resolve()), "units": "m", "name": mesh.stem}
    return found


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--unlisted", type=int, default=24)
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--strategy", nargs="*", default=list(TEACHERS))
    parser.add_argument("--scans", type=Path, default=None)
    asked = parser.parse_args()
    objects = held_out_objects(asked.seed, asked.unlisted, asked.scans)
    every: list[Answers] = []
    print("| strategy | objects | episodes | answered | right | right by exact bodies |")
    print("|---|---|---|---|---|---|")
    for strategy in asked.strategy:
        new = answers_of(objects, strategy, asked.episodes, asked.seed)
        every.append(new)
        for kind in ("catalogue", "random", "scan"):
            mine = new.kind == kind
            if mine.any():
                answered = new.found[TABLES[0].way].name[mine] != ""
                right, exact = (new.right[t.way][mine] for t in TABLES)
                print(f"| {strategy} | {kind} | {mine.sum()} | {answered.mean():.3f} | "
                      f"{right.mean():.3f} | {exact.mean():.3f} |", flush=True)
    print("\n| way | probability | episodes | predicted | observed |")
    print("|---|---|---|---|---|")
    for way, rows in reliability(every).items():
        for low, high, count, predicted, observed in rows:
            print(f"| {way} | {low:.2f} to {high:.2f} | {count} | {predicted:.3f} | "
                  f"{observed:.3f} |")


if __name__ == "__main__":
    main()
