"""Stand-ins for the simulator: rows from counters, quick and the same everywhere."""

import hashlib
import os
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from sweeps.run.plan import BLOCK
from sweeps.run.unit_file import Columns
from sweeps.run.worker import RunCells
from sweeps.spec.cell import CONTACTS, Cell


def cell_by_cell(rows: Callable[[Cell, np.ndarray, str], Columns]) -> RunCells:
    """What a worker calls, of what runs one cell."""
    def run_cells(parts: Sequence[tuple[Cell, np.ndarray]], device: str) -> list[Columns]:
        return [rows(cell, episodes, device) for cell, episodes in parts]

    return run_cells


def _uniform(cell: Cell, episode: int, purpose: str) -> float:
    """Keyed as the simulator's numbers are: by seed, object and episode, not by the strategy."""
    text = f"{cell.seed} {cell.object_name} {episode} {purpose}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:6]) / 2**48


def _units(episodes: np.ndarray) -> np.ndarray:
    """The first episode of each unit."""
    return episodes[episodes % BLOCK == 0]


def rows_of(cell: Cell, episodes: np.ndarray, device: str = "cpu") -> Columns:
    quality = len(cell.strategy.name) + 0.1 * cell.sensors.tendon_threshold_N
    luck = np.array([_uniform(cell, int(e), "luck") for e in episodes])
    own = np.array([_uniform(cell, int(e), cell.strategy.name) for e in episodes])
    failed = own < 0.05
    named = np.where(own < 0.7, cell.object_name, "block")
    return {
        "status": np.where(failed, "fit_failed", "ok"),
        "contacts": (20 + 10 * luck).astype(np.int64),
        "touches": (40 + 10 * luck).astype(np.int64),
        "robot_time_s": 60 + 5 * luck,
        "chamfer_mm": np.where(failed, np.nan, quality + 4 * luck + own),
        "iou": np.where(failed, np.nan, 1 / (1 + 0.1 * (quality + luck))),
        "recognized_as": named,
        "recognized": named == cell.object_name,
    }


run_episodes = cell_by_cell(rows_of)


def _slow_rows(cell: Cell, episodes: np.ndarray, device: str = "cpu") -> Columns:
    time.sleep(float(os.environ.get("FAKE_SECONDS", "0.02")) * len(_units(episodes)))
    return rows_of(cell, episodes)


slow_episodes = cell_by_cell(_slow_rows)


@cell_by_cell
def counted_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Leaves a line a unit in the file FAKE_LOG."""
    with Path(os.environ["FAKE_LOG"]).open("a") as log:
        for first in _units(episodes):
            log.write(f"{cell.strategy.name} {cell.object_name} {first}\n")
    return rows_of(cell, episodes)


@cell_by_cell
def deadly_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Kills its worker on one object, once or always; raises on another."""
    if cell.object_name == "wedge":
        once = Path(os.environ["FAKE_LOG"])
        if not once.exists():
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    if cell.object_name == "funnel":
        os.kill(os.getpid(), signal.SIGSEGV)
    if cell.object_name == "lightbulb":
        raise RuntimeError("this bulb always breaks")
    return rows_of(cell, episodes)


@cell_by_cell
def broken_disk(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    import sweeps.output

    def no_space(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    if episodes[0] > 0:
        sweeps.output.os.fsync = no_space  # type: ignore[attr-defined]
    return rows_of(cell, episodes)


@cell_by_cell
def hanging_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Never comes back on one object."""
    while cell.object_name == "wedge":
        time.sleep(3600)
    return rows_of(cell, episodes)


@cell_by_cell
def logged_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Slow, and notes in FAKE_LOG/<cell and block> whether each unit was there when it began."""
    for first in _units(episodes):
        log = Path(os.environ["FAKE_LOG"]) / f"{cell.strategy.name}-{cell.object_name}-{first}"
        with log.open("a") as stream:
            stream.write("after\n" if log.with_suffix(".written").exists() else "before\n")
    return _slow_rows(cell, episodes)


def _batched_rows(cell: Cell, episodes: np.ndarray, device: str = "cpu") -> Columns:
    """Leaves a line a call in the file FAKE_LOG: of what, and how many units it was for."""
    with Path(os.environ["FAKE_LOG"]).open("a") as log:
        log.write(f"{cell.object_name} {len(_units(episodes))}\n")
    return rows_of(cell, episodes)


batched_episodes = cell_by_cell(_batched_rows)

def with_contacts(rows: Columns, cell: Cell, episodes: np.ndarray) -> Columns:
    """The rows and, if they are kept, contacts: of every third episode none, of the next one, then
    two."""
    if cell.keep == "contacts":
        rows[CONTACTS] = np.empty(len(episodes), object)
        for n, episode in enumerate(episodes):
            count = int(episode) % 3
            rows[CONTACTS][n] = {
                "procedure": np.full(count, "containment", object),
                "probe": np.arange(count, dtype=np.int32),
                "status": np.full(count, "contact", object),
                "x_m": np.full(count, 0.45 + 0.001 * episode, np.float32),
                "taxel_peak": np.full(count, np.nan, np.float32)}
    return rows


@cell_by_cell
def touching_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    return with_contacts(_batched_rows(cell, episodes), cell, episodes)


BAD = 320


@cell_by_cell
def bad_episode(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Raises, dies or hangs (FAKE_HOW) where one episode of the block is asked for."""
    rows = _batched_rows(cell, episodes)
    if cell.object_name == "block" and BAD in episodes:
        if os.environ["FAKE_HOW"] == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if os.environ["FAKE_HOW"] == "hang":
            time.sleep(3600)
        raise RuntimeError("this episode is bad")
    return rows


@cell_by_cell
def planned_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Calls a planner of the user's, a function of a file, as an exploration does, and notes its
    fault."""
    from strategies.planners.guarded_call import guarded_call
    from strategies.planners.planner_file import planner_file

    fault = ""
    if cell.strategy.call:
        file, _, name = cell.strategy.call.rpartition(":")
        planner = getattr(planner_file(Path(file)).module, name)
        try:
            with guarded_call():
                planner(None)
        except Exception as error:
            from strategies.planners.register import fault_text  # imports Warp and JAX

            fault = fault_text(planner, error)
    return rows_of(cell, episodes) | {"note": np.full(len(episodes), fault, object)}


@cell_by_cell
def faulty_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """The strategy "horse" is at fault in every episode, and its rows say why."""
    if cell.strategy.name != "horse":
        return rows_of(cell, episodes)
    return rows_of(cell, episodes) | {
        "status": np.full(len(episodes), "strategy_failed", object),
        "note": np.full(len(episodes), "no horse knows how", object)}


@cell_by_cell
def told_processes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Notes the process that ran a row, and how many units its call had."""
    note = f"{os.getpid()} {len(_units(episodes))}"
    return rows_of(cell, episodes) | {"note": np.full(len(episodes), note, object)}


@cell_by_cell
def crashing_while_cached(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Crashes as long as there are cached programs."""
    from warpgrasp.core.cache_file import cache_root

    if (cache_root() / "programs").exists():
        os.kill(os.getpid(), signal.SIGILL)
    return rows_of(cell, episodes)


@cell_by_cell
def measured_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Leaves a line a call in the file FAKE_LOG: of how many episodes it was."""
    with Path(os.environ["FAKE_LOG"]).open("a") as log:
        log.write(f"{len(episodes)}\n")
    return with_contacts(rows_of(cell, episodes), cell, episodes)


@cell_by_cell
def given_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """With the scores of the prior."""
    rows = rows_of(cell, episodes)
    prior = np.array([10 + _uniform(cell, int(e), "prior") for e in episodes])
    return rows | {"prior_chamfer_mm": prior, "prior_iou": 1 / prior}
