"""A resolved study: a spec with all defaults filled in, and its cells."""

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from strategies.ready_made import STRATEGIES, UNGUIDED, run_together
from strategies.strategy import BUDGET_KEYS, Strategy
from sweeps.spec.cell import APART, SECTIONS, TABLES, Cell
from warpgrasp.parameters import TrueTables

HAND_KEY, ARM_KEY = "hand.kind", "arm.kind"
WORDS = {"hand": HAND_KEY, "arm": ARM_KEY}
"""Sections that a spec may name by a word alone, and the key that it is short for."""
FILE_KEYS = ("mesh", "profile")  # of an object's table, however deep: files it is read from

_WHERE_READ = {"planar": {"planar", "decide"}, "contour": {"contour", "decide"},
               "decide": {"decide"}, "pads": {"planar", "contour", "decide"},
               "stereo": {"contour", "decide"}}
"""Procedures of an order, one of which a strategy has that reads a table. A user's planner may
feel with pads, too; cameras may also see the prior, whatever the strategy."""
SEEN = frozenset(("silhouettes", "depth"))
"""Priors that cameras see."""
SHIPPED = frozenset(s.call for s in STRATEGIES.values() if s.call)
"""Planners that ship, which only grasp; those of users may also feel with pads."""
REFITTED = SHIPPED - {*UNGUIDED}
"""Planners whose bodies are fitted after every step, whatever `refit_every` says."""
_OF_ALL = ("closings", "order", "refit_every", *BUDGET_KEYS)
"""Keys of a strategy that each has."""
EPISODE_LIMIT = 10**9
CELL_LIMIT = 10**7
SIDE_BY_SIDE = 256
"""Episodes of one strategy, on several objects if need be, before the next strategy's turn: enough
to be run together at little more than the least cost of each."""


@dataclass(frozen=True)
class StudyTable:
    """The keys at the top of a spec."""

    schema: int = field(default=1, metadata={"low": 1, "high": 1, "doc": "version of the format"})
    name: str = field(default="", metadata={"doc": "a name for the study"})
    seed: int = field(default=0, metadata={"low": 0, "high": 2**63 - 1,
                                           "doc": "names every random number of the study"})
    episodes_per_cell: int = field(default=64, metadata={
        "low": 1, "high": EPISODE_LIMIT, "doc": "episodes of each strategy on each object"})
    keep: str = field(default="nothing", metadata={
        "choices": ("nothing", "contacts"), "doc": "what is kept beside the rows of results"})


@dataclass(frozen=True)
class Axis:
    """One factor of the settings: parallel lists of values for the keys it moves together.

    `sampled` axes (Sobol, Latin hypercube) are draws of a nuisance and are averaged over by
    default; the others (grid, zip) define leaderboard entries.
    """

    keys: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...]  # one tuple a point, an entry a key, spec units
    si: tuple[tuple[Any, ...], ...]  # the same in SI
    sampled: bool = False


@dataclass(frozen=True)
class Body:
    """An object of the study: its name, its table, and the hash of the files that it names."""

    name: str
    table: Mapping[str, Any]
    sha256: str = ""


@dataclass(frozen=True)
class Study:
    """A spec with all defaults filled in."""

    head: StudyTable
    objects: tuple[Body, ...]
    strategies: tuple[Strategy, ...]
    tables: Mapping[str, Any]  # section name -> its parameter table
    axes: tuple[Axis, ...] = ()
    search: Any = None
    """A `sweeps.spec.search.Search`: entries that are proposed, beside those of the axes."""
    base_dir: Path | None = None
    """Of the spec, by which its files are named; none of a study as `resolved.json` has it."""

    @property
    def setting_count(self) -> int:
        """How many settings the axes span (1 without a sweep)."""
        return prod(len(axis.values) for axis in self.axes)

    @property
    def cell_count(self) -> int:
        """Objects times the settings of each strategy."""
        return len(self.objects) * sum(map(self.settings_of, range(len(self.strategies))))

    @cached_property
    def idle(self) -> tuple[frozenset[int], ...]:
        """Of each strategy the axes that say nothing of it, such as options of another planner: it
        has their first point alone, without their keys. Axes that are averaged over are not
        counted, so that all entries have the same cases."""
        return tuple(frozenset(n for n, axis in enumerate(self.axes) if not axis.sampled
                               and not any(self.reaches(strategy, key) for key in axis.keys))
                     for strategy in self.strategies)

    def reaches(self, strategy: Strategy, key: str) -> bool:
        """Whether a key that is swept says anything of a strategy. Planners choose for themselves:
        of them neither waypoints nor an order do."""
        section, name = key.split(".", 1)
        if section != "strategy":
            return section not in _WHERE_READ or self._is_read(strategy, section)
        if name.startswith("options."):
            return name.removeprefix("options.") in dict(strategy.options)
        if strategy.call and (name == "order" or name not in _OF_ALL):
            return False
        if name == "refit_every" and strategy.call:
            return strategy.call not in REFITTED
        own = name in _OF_ALL or any(_has_field(family, name) for family in strategy.waypoints)
        if name == "order" or name in BUDGET_KEYS or strategy.call:
            return own
        return own and (self.searches("strategy.order")
                        or "containment" in self._procedures(strategy))

    @property
    def sees_silhouettes(self) -> bool:
        """Whether silhouettes are cut out of images: for the prior, or for a contour's axis."""
        return self.may_be("object.prior", {"silhouettes"}) or (
            self.may_be("contour.axis", {"stereo"})
            and any(_WHERE_READ["stereo"] & self._procedures(strategy)
                    for strategy in self.strategies if not strategy.call))

    def _is_read(self, strategy: Strategy, section: str) -> bool:
        """Whether a strategy reads a table of `_WHERE_READ`."""
        if section == "stereo":
            if self.may_be("object.prior", SEEN):
                return True
            if not self.may_be("contour.axis", {"stereo"}):
                return False
        if strategy.call:
            return section == "pads" and strategy.call not in SHIPPED
        return self.searches("strategy.order") or bool(
            _WHERE_READ[section] & self._procedures(strategy))

    def searches(self, key: str) -> bool:
        """Whether a race proposes the values of a key."""
        return self.search is not None and any(f.key == key for f in self.search.factors)

    def may_be(self, key: str, values: Set[Any]) -> bool:
        """Whether a key has one of these values anywhere in the study, or is searched."""
        return self.searches(key) or bool(values & self.values_of(key))

    def _procedures(self, strategy: Strategy) -> set[str]:
        """Of all orders that a strategy which is no planner is run with."""
        if any("strategy.order" in axis.keys for axis in self.axes):
            return {name for order in self.values_of("strategy.order")
                    for name in order or strategy.order}
        return {*strategy.order}

    def values_of(self, key: str) -> set[Any]:
        """What a key is in the study, in SI: at all points of a sweep, else in its table."""
        swept = {point[axis.keys.index(key)] for axis in self.axes if key in axis.keys
                 for point in axis.si}
        section, name = key.split(".", 1)
        return swept or {getattr(self.tables[section], _si_name(section, name))}

    @property
    def settings_each(self) -> str:
        """How many settings a strategy has, such as "4", or "2 to 4"."""
        counts = [self.settings_of(n) for n in range(len(self.strategies))]
        least, most = min(counts), max(counts)
        return f"{most}" if least == most else f"{least} to {most}"

    def settings_of(self, strategy: int) -> int:
        """How many settings a strategy has."""
        return prod(len(axis.values) for n, axis in enumerate(self.axes)
                    if n not in self.idle[strategy])

    @property
    def group_size(self) -> int:
        """Objects whose episodes are run together, at most."""
        return max(1, min(len(self.objects), SIDE_BY_SIDE // self.head.episodes_per_cell))

    def setting(self, index: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Setting `index` in spec units and in SI; the last axis runs fastest."""
        given: dict[str, Any] = {}
        si: dict[str, Any] = {}
        for axis in reversed(self.axes):
            index, point = divmod(index, len(axis.values))
            given.update(zip(axis.keys, axis.values[point], strict=True))
            si.update(zip(axis.keys, axis.si[point], strict=True))
        # None: a factor of a search that was not proposed here, which stays as it is
        order = [key for axis in self.axes for key in axis.keys if given[key] is not None]
        return {key: given[key] for key in order}, {key: si[key] for key in order}

    def cell(self, strategy: int, body: int, setting: int) -> Cell:
        """The cell of these three indices."""
        given, si = self.setting(setting)
        for key in [key for n in self.idle[strategy] for key in self.axes[n].keys]:
            given.pop(key, None)
            si.pop(key, None)
        tables = dict(self.tables)
        chosen = self.strategies[strategy]
        for key, value in si.items():
            section, name = key.split(".", 1)
            if section == "strategy":
                chosen = with_strategy_value(chosen, name, value)
            else:
                tables[section] = replace(tables[section], **{_si_name(section, name): value})
        side = tables["robot"].swept
        true = None
        if side != "both":
            swept = {name: tables[name] for name in APART}
            base = {name: self.tables[name] for name in APART}
            true = TrueTables(**(swept if side == "truth" else base))
            tables |= base if side == "truth" else swept
        return Cell(chosen, self.objects[body].table, self.objects[body].name,
                    **dict(zip(TABLES, (tables[name] for name in SECTIONS), strict=True)),
                    true=true, seed=self.head.seed, setting=given, keep=self.head.keep)

    def holds(self, strategy: int, key: str, si: Any) -> bool:
        """Whether a strategy, or the study's tables, have this value of a key without a sweep."""
        section, name = key.split(".", 1)
        if section == "strategy":
            chosen = self.strategies[strategy]
            return with_strategy_value(chosen, name, si) == chosen
        return getattr(self.tables[section], _si_name(section, name)) == si

    def cells(self) -> Iterator[tuple[int, int, int]]:
        """Index triples (strategy, object, setting), the entries of one case side by side.

        Objects of few episodes come in groups, so that their episodes can be run in one call; one
        by one of the strategies that no call runs together.
        """
        has = []
        for idle in self.idle:
            own = np.zeros([len(axis.values) for axis in self.axes], bool)
            own[tuple(0 if n in idle else slice(None) for n in range(len(self.axes)))] = True
            has.append(own.ravel())
        free = self.tables["fit"].free_forms
        alone = [n for n, s in enumerate(self.strategies) if not run_together(s.call, free)]
        together = [n for n in range(len(self.strategies)) if n not in alone]
        groups = -(-len(self.objects) // self.group_size)
        for group in range(groups):
            bodies = range(*(len(self.objects) * n // groups for n in (group, group + 1)))
            for settings in self._cases():
                for setting, strategy, body in product(settings, together, bodies):
                    if has[strategy][setting]:
                        yield strategy, body, setting
                for body, setting, strategy in product(bodies, settings, alone):
                    if has[strategy][setting]:
                        yield strategy, body, setting

    def _cases(self) -> Iterator[list[int]]:
        """The settings of each point of the sampled axes: of entries that are compared there."""
        axes = sorted(range(len(self.axes)), key=lambda n: not self.axes[n].sampled)
        cases = prod(len(axis.values) for axis in self.axes if axis.sampled)
        settings = np.arange(self.setting_count).reshape([len(axis.values) for axis in self.axes])
        for case in settings.transpose(axes).reshape(cases, -1):
            yield case.tolist()


def _has_field(family: Any, key: str) -> bool:
    from sweeps.spec.units import spec_fields

    return key in spec_fields(type(family))


def _si_name(section: str, key: str) -> str:
    from sweeps.spec.units import spec_fields

    return spec_fields(SECTIONS[section])[key].name


def with_strategy_value(strategy: Strategy, key: str, value: Any) -> Strategy:
    """The strategy with a field or an option of its own, or of every waypoint family that has it,
    replaced."""
    from sweeps.spec.units import spec_fields

    if key in _OF_ALL:
        return replace(strategy, **{key: value})
    if key.startswith("options."):
        option = key.removeprefix("options.")
        return replace(strategy, options=tuple(
            (name, value if name == option else given) for name, given in strategy.options))
    return replace(strategy, waypoints=tuple(
        replace(family, **{spec_fields(type(family))[key].name: value})  # type: ignore
        if _has_field(family, key) else family
        for family in strategy.waypoints))
