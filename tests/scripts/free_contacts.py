"""How near contacts lie to the true ones where a free form placed them.

    python tests/scripts/free_contacts.py [--objects drill bowl-1001 ...] [--touches 192]

Episodes of `any-object`. Contacts are those of the free form (`fitted_freely`), and count where
they lie on it (`NEAR_M`), torques do not contradict it, the link is sure, and the place along it
too (`UNSURE_M`), as the verdict of a model's contacts has it. A row
for each object: means over episodes of the median distance [mm] from the true contact and of the
median along its normal, and the share of all that are more than 10 mm off.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from coverage_reach import body_table

from fit.implicit.query import implicit_values
from strategies.ready_made import STRATEGIES
from strategies.recovery.contact_verdict import NEAR_M, UNSURE_M
from strategies.recovery.evidence import CONTRADICTED_FROM
from strategies.recovery.free_contacts import BODY, fitted_freely
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.spec.cell import Cell
from warpgrasp.parameters import FitTable
from warpgrasp.robot import Grasps

FAR_M = 0.010


def misses(block: EpisodeBlock, table: FitTable) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of each world how far its counted contacts are from the true ones [m], and along their
    normals."""
    found, truth = block.exploration, block.truth
    belief = found.belief
    fits, placed = fitted_freely(found.felt, belief.links, table, (belief.errors, belief.arm))
    shape = placed.mask.shape
    point, normal = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
    slot = 0
    for procedure in found.procedures:
        if isinstance(procedure.felt, Grasps):
            closed = truth.closings[procedure.closing]
            wide = slice(slot, slot + procedure.slots)
            point[:, wide] = closed.point_m.reshape(shape[0], -1, 3)
            normal[:, wide] = closed.normal.reshape(shape[0], -1, 3)
        slot += procedure.slots
    widest = np.sqrt(np.linalg.eigvalsh(np.where(
        placed.mask[..., None, None], placed.covariance_m2, 0.0))[..., -1])
    away = implicit_values(fits, placed.points_m, BODY.mean)
    counted = (placed.mask & (placed.contradiction <= CONTRADICTED_FROM) & (widest <= UNSURE_M)
               & (np.abs(away) <= NEAR_M) & np.isfinite(point).all(-1))
    off = placed.points_m - point
    for world, mine in enumerate(counted):
        yield (np.linalg.norm(off[world, mine], axis=1),
               np.abs((off * normal).sum(-1)[world, mine]))


def main() -> None:
    """Reads the command line, prints the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=[
        "block", "drill", "mug-1001", "bowl-1001", "hammer-1001", "wine_bottle"])
    parser.add_argument("--touches", type=int, default=192)
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--seed", type=int, default=95)
    given = parser.parse_args()
    print("| object | contacts | distance [mm] | along the normal [mm] | beyond 10 mm [%] |\n"
          "|---|---|---|---|---|")
    strategy = replace(STRATEGIES["any-object"], touches=given.touches)
    for name in given.objects:
        cell = Cell(strategy, body_table(name), name, seed=given.seed)
        block = run_block(cell, np.arange(given.episodes), "cpu", curve=False)
        away, along = zip(*misses(block, cell.fit), strict=True)
        every = np.concatenate(away)
        print(f"| `{name}` | {len(every)} | {1e3 * np.mean([np.median(v) for v in away]):.1f} | "
              f"{1e3 * np.mean([np.median(v) for v in along]):.2f} | "
              f"{100 * (every > FAR_M).mean():.1f} |", flush=True)


if __name__ == "__main__":
    main()
