"""Running one episode of a study again, with all that was felt: the same bits as before.

There is one exception. What a planner raises ends all episodes of its block, since nobody knows
which of them it was about; run again alone, the others go on.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.analysis.entries import entries_of, entry_axes, setting_index
from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.output import init_warp, note, quiet_stdout
from sweeps.run.inputs import kept_cell
from sweeps.run.local_engine import as_a_worker
from sweeps.run.plan import Plan, Unit, cell_hash, unit_id
from sweeps.run.race_record import race_of, read_race_note, taken_blocks
from sweeps.run.store import Store
from sweeps.spec.cell import Cell
from sweeps.spec.errors import StoreError, choose
from warpgrasp.core.plain_text import first_few

if TYPE_CHECKING:
    from sweeps.episode.episodes import EpisodeBlock


@dataclass(frozen=True)
class Episode:
    """Which episode of a study: indices into its strategies, objects and settings."""

    strategy: int
    body: int
    episode: int
    setting: int = 0


class WorkerDied(StoreError):
    """A worker process ended, and again when what it had was given to another."""

    def __init__(self) -> None:
        super().__init__("a worker process was killed while it ran an episode again; memory may "
                         "have been short: use fewer --workers, or look at the system's log", 1)


def choose_episode(plan: Plan, stores: Sequence[Store], strategy: str | None,
                   body: str | None, episode: int) -> Episode:
    """An episode by name; without a strategy that of the best, without an object the first.

    `strategy` can be an entry's name in the leaderboard, which names the setting too. Where several
    entries are meant it is the leaderboard's first of them. Axes that entries are averaged over
    are at their first point. Of a race's entry there are as many episodes as it took, if these are
    more than the study's. Raises StoreError for what the study does not have, and of a race,
    which has no leaderboard, where several are meant.
    """
    names = [s.name for s in plan.study.strategies]
    bodies = [b.name for b in plan.study.objects]
    entries = entries_of(plan, entry_axes(plan, None)[0])
    either = list(dict.fromkeys([*names, *(entry.label for entry in entries)]))
    for option, value, known in (("--strategy", strategy, either), ("--object", body, bodies)):
        if value is not None and value not in known:
            raise StoreError(f"{option}: the study has no {value!r}; {choose(value, known)}")
    meant = {entry.label: entry for entry in entries
             if strategy in (None, entry.label, names[entry.strategy])}
    count = max([plan.study.head.episodes_per_cell, *(
        stop for race in _races(stores) if race["over"] == "these"
        for told in race["entries"] if told["label"] in meant for stop in told["stops"])])
    if not 0 <= episode < count:
        raise StoreError(f"--episode: is {episode}; should be a whole number from 0 to "
                         f"{count - 1}")
    label = next(iter(meant))
    if len(meant) > 1:
        if any(race_of(plan, store) is not None for store in stores):
            raise StoreError(f"--strategy: should name an entry, for {stores[0].folder} holds a "
                             f"race, which has no leaderboard; there are: {first_few([*meant])}", 3)
        label = next(row[1] for row in make_leaderboard(plan, stores).rows if row[1] in meant)
        note(f"of {len(meant)} entries the leaderboard's first: {label}")
    points = dict.fromkeys(range(len(plan.study.axes)), 0) | meant[label].points
    return Episode(meant[label].strategy, 0 if body is None else bodies.index(body), episode,
                   setting_index(plan, points))


def _races(stores: Sequence[Store]) -> list[dict[str, Any]]:
    """What is noted of the races that were run in these directories."""
    return [race for store in stores if (race := read_race_note(store.logs)) is not None]


def cell_of(plan: Plan, episode: Episode) -> Cell:
    """The episode's cell, with what the study keeps of the files that it was read from.

    Raises StoreError where it keeps no copy.
    """
    cell = plan.study.cell(episode.strategy, episode.body, episode.setting)
    if not plan.folders:  # of a spec just read
        return cell
    return kept_cell(cell, plan.study.objects[episode.body], plan.folders)


def rerun(plan: Plan, episode: Episode) -> "EpisodeBlock":
    """A block of this one episode; raises as `rerun_all`."""
    return next(rerun_all(plan, [episode]))


def rerun_all(plan: Plan, episodes: Sequence[Episode], device: str = "cpu",
              workers: int = 1) -> Iterator["EpisodeBlock"]:
    """A block of each episode, in order; StoreError as `cell_of`.

    What a worker process had that was killed is run once more; raises WorkerDied after that.
    """
    left = [(cell_of(plan, e), e.episode, device) for e in episodes]
    tries = 2
    while left:
        with as_a_worker(), _pool(min(workers, len(left))) as pool:
            try:
                blocks = pool.map(_run, left)
                init_warp()  # their bodies bring it here too
                for block in blocks:
                    left, tries = left[1:], 2
                    yield block
            except BrokenProcessPool:
                tries, workers = tries - 1, 1  # one alone needs least memory
        if left and not tries:
            raise WorkerDied


OTHERWISE = ("exceptions of a planner about many episodes of a unit end others with them; or this "
             "is another machine or version")
"""Why an episode may end otherwise when it is run again."""


def ended_otherwise(plan: Plan, stores: Sequence[Store], episode: Episode, status: str) -> str:
    """What a reader should know if an episode that was run again has another status than its row;
    empty if it has the same, or no row."""
    cell = plan.study.cell(episode.strategy, episode.body, episode.setting)
    name = cell_hash(cell, plan.study.objects[episode.body])
    units = [plan.unit(cell, name, block) for block in range(plan.block_count)]
    blocks = dict.fromkeys(block for race in _races(stores) for told in race["entries"]
                           for block in taken_blocks(plan.study, race, told["stops"]))
    units += [Unit(unit_id(name, first, last), name, cell, first, last)
              for body, first, last in blocks if body == episode.body]
    found = ((rows, episode.episode - unit.start) for unit in units
             if unit.start <= episode.episode < unit.stop
             for store in stores if (rows := store.read(unit)) is not None)
    rows, place = next(found, ({}, 0))
    row = {key: values[place] for key, values in rows.items() if key in ("status", "note")}
    if not row or row["status"] == status:
        return ""
    said = f" ({row['note']})" if row.get("note") else ""
    return f"its row in the study has the status {row['status']}{said}: {OTHERWISE}"


def in_a_worker(function: Callable[[Any], Any], task: Any) -> Any:
    """`function(task)` in a process set up as a sweep's workers are.

    Their environment decides the last bits: XLA sums in another order with more threads. Raises
    WorkerDied where the process is killed.
    """
    with as_a_worker(), _pool(1) as pool:
        try:
            return pool.submit(_quietly, function, task).result()
        except BrokenProcessPool:
            raise WorkerDied from None


def _pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"))


def _quietly(function: Callable[[Any], Any], task: Any) -> Any:
    with quiet_stdout():
        init_warp()
        return function(task)


def _run(task: tuple[Cell, int, str]) -> "EpisodeBlock":
    return _quietly(_run_block, task)


def _run_block(task: tuple[Cell, int, str]) -> "EpisodeBlock":
    from sweeps.episode.episodes import run_block

    cell, episode, device = task
    return run_block(cell, np.array([episode]), device)

