"""`warpgrasp sweep --until`: all entries take more episodes until the best is known well enough.

It is a race in which nobody is eliminated. Rungs end at whole units, and before each the study
grows to as many episodes a cell: its directory is that of a sweep with so many episodes, and every
command reads it as such.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sweeps.analysis.leaderboard import Leaderboard, make_leaderboard
from sweeps.output import note, say, write_atomic
from sweeps.race.course import Course, check_entries, rules_of, run_course
from sweeps.race.elimination import Race
from sweeps.race.race_note import end_race_note
from sweeps.race.race_units import RaceUnits
from sweeps.race.verdict import summary, verdict_of
from sweeps.run.local_engine import Options, terminated_as_interrupted
from sweeps.run.plan import BLOCK, Plan, Unit, plan_study
from sweeps.run.store import Store, plan_of
from sweeps.spec.errors import StoreError
from sweeps.spec.reader import read_spec, spec_text
from sweeps.spec.search import refuse_search
from sweeps.spec.toml_reader import read_content
from warpgrasp.core.plain_text import counted

METRIC = "chamfer_mm"
SAID = ("best", "claim", "tied", "paired", "episodes")
"""What is said of a race that holds here, too."""


@dataclass
class Growth(Course):
    """A sweep that grows: what the engine asks for the next units."""

    content: bytes = b""
    """Of the spec."""
    settings: Sequence[str] = ()
    device: str = "cpu"

    def further(self) -> Sequence[Unit]:
        """Takes in the rung that has been run; grows the study to the next, and gives its units."""
        units = super().further()
        if self.asked:
            self.grow(self.asked[0][2])
        return units

    def looked(self) -> None:
        """Leaves no note: whoever watches reads the sweep's units."""

    def grow(self, episodes: int) -> None:
        """Makes the study's directory one of so many episodes a cell, unless it has more."""
        store = self.units.store
        try:
            there = int(store.resolved()["study"]["episodes_per_cell"])
        except StoreError:
            there = 0
        episodes = max(episodes, there)
        settings = [text for text in self.settings
                    if text.partition("=")[0].strip() != "episodes_per_cell"]
        text = spec_text(self.content, [*settings, f"episodes_per_cell={episodes}"])
        for line in store.open_for(grown(self.units.plan, episodes), text, self.device):
            note(line)


def grown(plan: Plan, episodes: int) -> Plan:
    """The plan of the same study with so many episodes a cell."""
    head = replace(plan.study.head, episodes_per_cell=episodes)
    return plan_study(replace(plan.study, head=head))


@dataclass(frozen=True)
class Known:
    """The end of such a sweep."""

    lines: dict[str, str]
    """What is known of its entries, by what it is of."""
    within: float
    """The first is so near to the best."""
    board: Leaderboard
    failed: bool
    """Units failed or were lost."""


def sweep_until(spec: Path, folder: Path, *, within: float, options: Options,
                settings: Sequence[str], engine: str = "local", address: str | None = None
                ) -> Known:
    """Runs what is left of a sweep that ends by what is known, and writes its leaderboard.

    Raises LeaderboardError for one entry, SpecError and StoreError as a sweep does.
    """
    content = read_content(spec)
    plan = plan_study(read_spec(spec, settings, content))
    refuse_search(plan.study, spec)
    store = Store(folder)
    units = RaceUnits(plan, store, METRIC, "these")
    rules = replace(rules_of(within, 95.0, _whole(plan.study.head.episodes_per_cell), None, METRIC),
                    everyone=True, whole=BLOCK)
    course = Growth(Race(len(units.entries), rules), units, content=content,
                    settings=settings, device=options.device)
    check_entries(units, spec)
    with terminated_as_interrupted(), store.lock(options.shard):
        course.grow(rules.start)
        end_race_note(store.logs)
        outcome = run_course(units.plan, store, options, course.further, engine, address)
        found = verdict_of(course.race, units)
        board = make_leaderboard(plan_of(store), [store])
        write_atomic(folder / "leaderboard.csv", board.csv())
    if outcome.failed:
        say(f"{counted(outcome.failed, 'unit')} failed, counted as the worst; see "
            f"{store.logs}/*.failed.log")
    return Known({name: text for name, text in summary(found).items() if name in SAID},
                 found.within, board, bool(outcome.failed or outcome.lost))


def _whole(episodes: int) -> int:
    """Episodes of the first rung: those of the spec, in whole units."""
    return -(-episodes // BLOCK) * BLOCK
