"""The `[search]` of a spec: factors whose values are proposed, not listed.

    [search]
    trials = 60
    "strategy.count" = { low = 3, high = 6, step = 1 }
    "strategy.tilt_deg" = { low = 30, high = 70 }
    "strategy.closings" = [["together"], ["curl40", "base_then_curl"]]
    "strategy.aim" = { low = 0.3, high = 0.7, when = { "strategy.closings" = [["together"]] } }

A factor with `when` is only proposed where another one, above it, has one of the values named.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from strategies.strategy import Strategy
from sweeps.spec.errors import (
    KeyPath,
    Problem,
    Problems,
    Reader,
    SpecError,
    StoreError,
    choose,
    is_refused,
    short,
)
from sweeps.spec.study import WORDS, Axis, Study

COUNTS = {"trials": (60, 2, 100_000), "round": (20, 2, 10_000), "finalists": (10, 2, 1000),
          "episodes": (16, 2, 100_000)}
"""Keys beside the factors: default, least and most."""
LARGEST = 2.0**53
"""Of the numbers of a range: up to it all whole ones differ."""
ENDS_LIMIT = 20_000
"""Points that are checked before a search: some seconds' worth."""


@dataclass(frozen=True)
class Factor:
    """A key and the values that may be proposed for it, in units of the spec."""

    key: str
    low: float = 0.0
    high: float = 0.0
    step: float | None = None
    choices: tuple[Any, ...] = ()
    """Of a factor without a range."""
    when: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    """Keys of earlier factors, and the values that they must have."""

    @property
    def whole(self) -> bool:
        """Whether its values are whole numbers."""
        return not self.choices and all(type(v) is int for v in (self.low, self.high, self.step))

    @property
    def steps(self) -> int:
        """How many steps above `low` it goes; without steps, as far as one knows, 1."""
        return 1 if self.step is None else int((self.high - self.low) / self.step + 1e-9)

    @property
    def is_fixed(self) -> bool:
        """Whether it has one value only."""
        return len(set(map(repr, self.choices))) == 1 if self.choices else self.steps == 0

    @property
    def extremes(self) -> tuple[Any, ...]:
        """Its ends and the value nearest to zero; of choices, all."""
        if self.choices:
            return self.choices
        ends = self.low, self.high if self.step is None else _after(self, self.steps)
        if self.step is None:
            return (*ends, 0.0) if self.low < 0.0 < self.high else ends
        nearest = round(-self.low / self.step)
        return (*ends, _after(self, nearest)) if 0 < nearest < self.steps else ends

    def may_be(self, value: Any) -> bool:
        """Whether a value may be proposed; of a range without steps any is by chance alone."""
        if self.choices:
            return value in self.choices
        if not isinstance(value, int | float) or self.step is None:
            return False
        number = (value - self.low) / self.step
        return 0 <= round(number) <= self.steps and abs(number - round(number)) < 1e-6

    def is_open(self, values: Mapping[str, Any], known: Collection[str] | None = None) -> bool:
        """Whether it is proposed beside these values of earlier factors; of all of them, or as far
        as one can tell of those that are `known`."""
        return all(values.get(key) in wanted for key, wanted in self.when
                   if known is None or key in known)


@dataclass(frozen=True)
class Search:
    """A space of entries, and how it is searched."""

    factors: tuple[Factor, ...]
    trials: int
    """How often an entry is proposed in all; the same one twice counts twice."""
    round: int
    """So many at a time."""
    finalists: int
    """The best of them, which race again."""
    episodes: int
    """Of each object that a proposal is given, at most."""


def read_search(table: Any, strategies: Sequence[Strategy], axes: Iterable[Axis],
                problems: Problems) -> Search | None:
    """The search of a spec; None where there is none, or it is wrong (see `problems`)."""
    if table is None:
        return None
    path: KeyPath = ("search",)
    if not isinstance(table, Mapping):
        problems.add(path, "should be a table of factors such as "
                     '"strategy.tilt_deg" = { low = 30, high = 70 }')
        return None
    before = len(problems.found)
    counts = {name: _count(table, name, problems) for name in COUNTS}
    swept = {key for axis in axes for key in axis.keys}
    readers = _readers(strategies)
    factors: list[Factor] = []
    for name, value in _flat(table):
        key, place = WORDS.get(name, name), (*path, name)
        if key not in readers:
            problems.add(place, f"unknown key {short(key)}; {choose(key, readers)}")
        elif key in swept:
            problems.add(place, f"{key} is swept already in [sweep]")
        elif any(key == factor.key for factor in factors):
            problems.add(place, f"{key} is a factor already")
        elif factor := _factor(key, value, factors, readers, place, problems):
            factors.append(factor)
    if not factors and len(problems.found) == before:
        problems.add(path, 'names no factor; write one such as "strategy.tilt_deg" = '
                     "{ low = 30, high = 70 }")
    if factors and all(factor.is_fixed for factor in factors):
        problems.add(path, "is a space of one point; a race needs two entries or more")
    if len(strategies) > 1 or not all(axis.sampled for axis in axes):
        problems.add(path, "proposes entries of one strategy; should stand beside one [[strategy]] "
                     "alone, and no [sweep.grid], [sweep.zip] or --set of such keys")
    if counts["finalists"] > counts["trials"]:
        problems.add((*path, "finalists"), f"is {counts['finalists']}; should be at most trials, "
                     f"{counts['trials']}")
    return Search(tuple(factors), **counts) if len(problems.found) == before else None


def _count(table: Mapping[str, Any], name: str, problems: Problems) -> int:
    usual, least, most = COUNTS[name]
    value = table.get(name, usual)
    if type(value) is not int or not least <= value <= most:
        problems.add(("search", name), f"is {short(value)}; should be a whole number from {least} "
                     f"to {most:,}")
        return usual
    return value


def _flat(table: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, Any]]:
    """Dotted keys, whether quoted or as tables, with what stands there."""
    for name, value in table.items():
        key = f"{before}{name}"
        if isinstance(value, Mapping) and not {"low", "high", "choices", "when"} & set(value):
            yield from _flat(value, f"{key}.")
        elif before or name not in COUNTS:
            yield key, value


def _factor(key: str, value: Any, earlier: Sequence[Factor], readers: Mapping[str, Any],
            path: KeyPath, problems: Problems) -> Factor | None:
    """A factor from `{ low, high, step, when }`, `{ choices, when }` or a list of choices."""
    before = len(problems.found)
    given: Any = {"choices": value} if isinstance(value, list) else value
    kinds = ({"low", "high"}, {"low", "high", "step"}, {"choices"})
    if not isinstance(given, Mapping) or set(given) - {"when"} not in kinds:
        problems.add(path, f"is {short(value)}; should be a range such as {{ low = 0, high = 1 }} "
                     "with or without step, or a list of choices")
        return None
    when = _when(given.get("when", {}), earlier, path, problems)
    if "choices" in given:
        choices = given["choices"]
        if not isinstance(choices, list) or not choices:
            problems.add(path, f"is {short(choices)}; should be a list of at least one value")
            return None
        found = Factor(key, choices=tuple(map(_frozen, choices)), when=when)
        tried = choices
    else:
        low, high, step = given["low"], given["high"], given.get("step")
        numbers = (low, high) if step is None else (low, high, step)
        if not all(type(v) in (int, float) and abs(v) < LARGEST for v in numbers) or (
                not low < high or (step is not None and step <= 0)):
            problems.add(path, f"is {short(given)}; should have numbers low < high, and step > 0")
            return None
        whole = _is_whole(readers[key], low, high)
        step = 1 if whole and step is None else step
        found = Factor(key, low, high, step, when=when)
        # The end of a whole number is one, too; others may end beyond their last step.
        tried = [low, high if whole or step is None else _after(found, found.steps)]
        tried += [] if step is None else [_after(found, min(1, found.steps))]
    si = [readers[key](value, path, problems) for value in tried]
    if found.choices and not found.is_fixed and len(set(map(repr, si))) < len(si):
        problems.add(path, "holds the same value twice")
    return found if len(problems.found) == before else None


def _is_whole(reader: Reader, low: float, high: float) -> bool:
    """Whether a key takes the whole number `low`, and no fraction above it."""
    between = low + 0.5 * min(1, high - low)
    return low == int(low) and not is_refused(reader, int(low)) and is_refused(reader, between)


def _after(factor: Factor, steps: int) -> float:
    """A value of a factor with steps, without what is added by rounding."""
    value = factor.low + steps * (factor.step or 0)
    return value if type(value) is int else float(f"{value:.12g}")


def _when(given: Any, earlier: Sequence[Factor], path: KeyPath, problems: Problems
          ) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    known = {factor.key for factor in earlier}
    if not isinstance(given, Mapping) or not all(isinstance(v, list) for v in given.values()):
        problems.add((*path, "when"), f"is {short(given)}; should name values of factors above, "
                     'such as { "strategy.count" = [4, 5] }')
        return ()
    given = {WORDS.get(key, key): values for key, values in given.items()}
    for key in given:
        if key not in known:
            problems.add((*path, "when"), f"{short(key)} is no factor above this one; "
                         f"{choose(key, known)}")
    for factor in earlier:
        if never := [v for v in given.get(factor.key, []) if not factor.may_be(_frozen(v))]:
            problems.add((*path, "when"), f"{factor.key} is never {short(never[0])}; should be one "
                         "of the choices of the factor above, or of its steps")
    return tuple((key, tuple(map(_frozen, values))) for key, values in given.items())


def with_points(study: Study, search: Search, points: Sequence[Mapping[str, Any]],
                seed: int | None = None) -> Study:
    """The study of these points of the space, a setting each; a factor that was not proposed has
    the value of the strategy or the tables. `seed` replaces the study's. SpecError for values that
    its keys do not take."""
    readers, wrong = _readers(study.strategies), Problems("", {})
    keys = tuple(factor.key for factor in search.factors)
    values = tuple(tuple(point.get(key) for key in keys) for point in points)
    si = tuple(tuple(
        None if value is None else readers[key](_plain(value), tuple(key.split(".")), wrong)
        for key, value in zip(keys, row, strict=True)) for row in values)
    if wrong.found:
        raise SpecError(Problem("[search]", found.key, found.what) for found in wrong.found)
    head = study.head if seed is None else replace(study.head, seed=seed)
    return replace(study, head=head, axes=(*study.axes, Axis(keys, values, si)), search=None)


def with_ends(study: Study, keys: Collection[str]) -> Study:
    """The study with the ends of what is searched of `keys`, and their values nearest to zero, as
    settings; itself where nothing of them is searched. SpecError where these are too many."""
    factors = [f for f in (study.search.factors if study.search else ()) if f.key in keys]
    points: list[dict[str, Any]] = [{}]
    for n, factor in enumerate(factors, 1):
        if len(points) * len(factor.extremes) > ENDS_LIMIT:
            raise SpecError([Problem("[search]", ", ".join(f.key for f in factors[:n]), (
                f"has {len(points) * len(factor.extremes):,} combinations of choices and ends of "
                f"ranges, which are checked together; should be {ENDS_LIMIT:,} at most, with fewer "
                "choices, or ranges in their place"))])
        points = [{**point, factor.key: value} for point in points for value in (
            factor.extremes if factor.is_open(point, keys) else (None,))]
    if study.search is None or points == [{}]:
        return study
    return replace(with_points(study, study.search, points), search=study.search)


def refuse_search(study: Study, spec: Path) -> None:
    """Refuses to sweep a space: StoreError."""
    if study.search is not None:
        raise StoreError(f"{spec}: [search] is for `warpgrasp race`, which proposes the entries; a "
                         "sweep has a list of them, in [sweep.grid]")


def canonical_search(search: Search) -> dict[str, Any]:
    """A search as plain data."""
    return asdict(search)


def search_of(values: Mapping[str, Any]) -> Search:
    """The search that `canonical_search` wrote."""
    factors = tuple(Factor(**{name: _frozen(value) for name, value in factor.items()})
                    for factor in values["factors"])
    return Search(factors, **{name: values[name] for name in COUNTS})


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _plain(value: Any) -> Any:
    return list(map(_plain, value)) if isinstance(value, tuple) else value


def _readers(strategies: Sequence[Strategy]) -> Any:
    from sweeps.spec.axes import readers_of  # and with it pydantic, which reading rows needs not

    return readers_of(strategies)
