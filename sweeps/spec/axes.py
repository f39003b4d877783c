"""The `[sweep]` of a spec: grid, zip, Sobol and Latin hypercube axes over dotted keys."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from strategies.strategy import BUDGET_KEYS, Strategy
from sweeps.spec.cell import SECTIONS
from sweeps.spec.checks import check_swept_order
from sweeps.spec.errors import (
    KeyPath,
    Problem,
    Problems,
    Reader,
    SpecError,
    choose,
    is_refused,
    short,
)
from sweeps.spec.named_files import UNSWEPT
from sweeps.spec.strategies import is_option, read_names
from sweeps.spec.study import WORDS, Axis
from sweeps.spec.units import spec_fields

KINDS = ("grid", "zip", "sobol", "lhs")
POINT_LIMIT = 10**5  # points of one sampled axis
SETTABLE = ("seed", "episodes_per_cell", "keep", "name")


def read_axes(sweep: Any, extra_grid: Mapping[str, list[Any]],
              strategies: Sequence[Strategy], tables: Mapping[str, Any], seed: int,
              problems: Problems) -> tuple[Axis, ...]:
    """The axes of a sweep, grid keys first; `extra_grid` replaces or adds grid keys.

    `tables` has the sections' values, which stand beside those that are swept.
    """
    before = len(problems.found)
    if not isinstance(sweep, Mapping):
        problems.add(("sweep",), "should be tables such as [sweep.grid]")
        sweep = {}
    for kind, table in sweep.items():
        if kind not in KINDS:
            problems.add(("sweep", kind), f"unknown key; {choose(kind, KINDS)}")
        elif not isinstance(table, Mapping) or not table:
            problems.add(("sweep", kind), "is empty; give it keys such as "
                         '"sensors.tendon_threshold_N" = [3.0, 6.0]')
    parts = {kind: _keys(sweep.get(kind, {}), ("sweep", kind), problems) for kind in KINDS}
    parts["grid"].update({key: (("sweep", "grid", key), list(values))
                          for key, values in extra_grid.items()})
    readers = readers_of(strategies)
    _check_keys(parts, readers, problems)
    axes = [axis for key, (path, value) in parts["grid"].items() if key in readers
            for axis in _listed({key: (path, value)}, readers, problems)]
    axes += _listed({k: v for k, v in parts["zip"].items() if k in readers}, readers, problems)
    for kind in ("sobol", "lhs"):
        axes += _sampled(kind, parts[kind], readers, seed, problems)
    if len(problems.found) == before:
        check_swept_order(tables, parts, readers, problems)
    return tuple(axes)


def read_overrides(settings: Sequence[str]) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    """`KEY=V1,V2` texts as grid axes, and single values of keys at the top of a spec."""
    grid: dict[str, list[Any]] = {}
    head: dict[str, Any] = {}
    wrong: list[Problem] = []
    for text in settings:
        key, equals, values = text.partition("=")
        key = WORDS.get(key.strip(), key.strip())
        if not equals or not values.strip():
            wrong.append(Problem("--set", text, "should be KEY=VALUE or KEY=V1,V2"))
            continue
        try:
            parsed = tomllib.loads(f"x = [{values}]")["x"]
        except (tomllib.TOMLDecodeError, RecursionError):
            parsed = [value.strip() for value in values.split(",")]
        if key in grid or key in head:
            wrong.append(Problem("--set", key, "is given twice"))
        elif "." in key:
            grid[key] = parsed
        elif key in SETTABLE and len(parsed) == 1:
            head[key] = parsed[0]
        else:
            wrong.append(Problem("--set", key, "should be one value for one of "
                                 f"{', '.join(SETTABLE)}, or a dotted key such as "
                                 "sensors.tendon_threshold_N"))
    if wrong:
        raise SpecError(wrong)
    return grid, head


def _keys(table: Any, path: KeyPath, problems: Problems) -> dict[str, tuple[KeyPath, Any]]:
    """The keys of a part of a sweep, each by its full name, with where it stands."""
    found: dict[str, tuple[KeyPath, Any]] = {}
    for key, leaf in _flat(table, path):
        name = WORDS.get(key, key)
        if name in found:
            problems.add(leaf[0], f"is {name} a second time; should be given once")
        found.setdefault(name, leaf)
    return found


def _flat(table: Any, path: KeyPath) -> Iterator[tuple[str, tuple[KeyPath, Any]]]:
    """Dotted keys with where they stand; `n` of a sampled axis, lists and ranges are leaves."""
    if not isinstance(table, Mapping):
        return
    for key, value in table.items():
        if isinstance(value, Mapping) and not set(value) & {"low", "high"}:
            for rest, found in _flat(value, (*path, key)):
                yield f"{key}.{rest}", found
        else:
            yield key, ((*path, key), value)


def readers_of(strategies: Sequence[Strategy]) -> dict[str, Reader]:
    """How to check and convert one value of every key that can be swept.

    Planners choose for themselves: of them neither waypoints nor an order can be.
    """
    readers: dict[str, Reader] = {f"{section}.{name}": field.read
                                  for section, table in SECTIONS.items()
                                  for name, field in spec_fields(table).items()
                                  if f"{section}.{name}" != UNSWEPT}
    ordered = [strategy for strategy in strategies if not strategy.call]
    for strategy in ordered:
        for family in strategy.waypoints:
            for name, field in spec_fields(type(family)).items():
                if name != "file":
                    readers.setdefault(f"strategy.{name}", field.read)
    for name in {name for strategy in strategies for name, _ in strategy.options}:
        readers[f"strategy.options.{name}"] = (
            lambda value, path, problems, name=name: _read_option(
                name, value, strategies, path, problems))
    for name in ("closings", "order") if ordered or not strategies else ("closings",):
        readers[f"strategy.{name}"] = lambda value, path, problems, name=name: read_names(
            name, value, path, problems) or None
    for name in (*BUDGET_KEYS, "refit_every"):
        readers[f"strategy.{name}"] = spec_fields(Strategy)[name].read
    return readers


def _read_option(name: str, value: Any, strategies: Sequence[Strategy], path: KeyPath,
                 problems: Problems) -> Any:
    """A value of a planner's option, tried on every planner of the spec that has it."""
    from strategies.planners.planner_file import PlannerError
    from strategies.planners.registry import make_planner  # heavy, and only planners need it

    if not is_option(value, path, problems):
        return value
    for strategy in strategies:
        options = dict(strategy.options)
        if name in options:
            try:
                make_planner(strategy.call, {**options, name: value})
            except PlannerError as error:
                problems.add(path, str(error))
    return value


def _check_keys(parts: Mapping[str, Mapping[str, tuple[KeyPath, Any]]],
                readers: Mapping[str, Reader], problems: Problems) -> None:
    seen: dict[str, str] = {}
    for kind, table in parts.items():
        for key, (path, _) in table.items():
            if key == "n" and kind in ("sobol", "lhs"):
                continue
            if key not in readers:
                problems.add(path, f"unknown key {short(key)}; {_instead(key, readers)}")
            elif key in seen:
                problems.add(path, f"{key} is swept already in sweep.{seen[key]}")
            seen.setdefault(key, kind)


def _instead(key: str, readers: Mapping[str, Reader]) -> str:
    if not key.startswith("strategy."):
        return choose(key, readers)
    own = [known for known in readers if known.startswith("strategy.")]
    return f"no strategy of this study has it; {choose(key, own)}"


def _listed(table: Mapping[str, tuple[KeyPath, Any]], readers: Mapping[str, Reader],
            problems: Problems) -> list[Axis]:
    """One axis of lists that advance together; a grid key is such an axis of its own."""
    before = len(problems.found)
    lists: dict[str, list[Any]] = {}
    si: dict[str, list[Any]] = {}
    for key, (path, values) in table.items():
        if not isinstance(values, list) or not values:
            problems.add(path, f"is {short(values)}; should be a list of at least one value")
            continue
        lists[key] = values
        si[key] = [readers[key](value, (*path, n), problems) for n, value in enumerate(values)]
    if len({len(values) for values in lists.values()}) > 1:
        lengths = ", ".join(f"{key} has {len(values)}" for key, values in lists.items())
        problems.add(next(iter(table.values()))[0][:2], f"lists should be equally long; {lengths}")
    if not lists or len(problems.found) > before:
        return []
    if len(set(map(repr, zip(*si.values(), strict=True)))) < len(next(iter(lists.values()))):
        path = next(iter(table.values()))[0]
        problems.add(*((path, "holds the same value twice") if len(table) == 1 else
                       (path[:2], "holds the same values twice, all keys at once; each point "
                        "should differ in one key at least")))
        return []
    return [Axis(tuple(lists), tuple(zip(*map(_frozen, lists.values()), strict=True)),
                 tuple(zip(*si.values(), strict=True)))]


def _sampled(kind: str, table: Mapping[str, tuple[KeyPath, Any]], readers: Mapping[str, Reader],
             seed: int, problems: Problems) -> list[Axis]:
    if not table:
        return []
    from scipy.stats import qmc

    before = len(problems.found)
    path: KeyPath = ("sweep", kind)
    n_path, n = table.get("n", ((*path, "n"), None))
    if type(n) is not int or not 1 <= n <= POINT_LIMIT:
        what = "missing" if n is None else f"is {short(n)}"
        problems.add(n_path, f"{what}; should be a whole number from 1 to {POINT_LIMIT:,}")
    keys = [key for key in table if key != "n" and key in readers]
    if not keys and len(problems.found) == before:
        problems.add(path, 'is empty; give it ranges such as "object.yaw_deg" = '
                     "{ low = -180, high = 180 }")
    ranges = [_range(table[key][1], table[key][0], readers[key], problems) for key in keys]
    if len(problems.found) > before or type(n) is not int:
        return []
    known = [found for found in ranges if found is not None]
    ends = np.cumsum([len(found.low) for found in known])
    generator = np.random.default_rng([seed, KINDS.index(kind)])
    if kind == "sobol":  # balanced only in powers of two: draw the next one, keep n
        unit = qmc.Sobol(ends[-1], rng=generator).random_base2(max(0, (n - 1).bit_length()))[:n]
    else:
        unit = qmc.LatinHypercube(ends[-1], rng=generator).random(n)
    points = [tuple(found.at(part) for found, part in zip(known, np.split(row, ends[:-1]),
                                                          strict=True)) for row in unit]
    si = [tuple(readers[key](value, table[key][0], problems)
                for key, value in zip(keys, point, strict=True)) for point in points]
    if len(problems.found) > before:
        return []
    return [Axis(tuple(keys), tuple(tuple(_frozen(list(point))) for point in points), tuple(si),
                 sampled=True)]


@dataclass(frozen=True)
class _Range:
    """Where a key's value is drawn from; of a list every number for itself."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    whole: bool
    listed: bool

    def at(self, unit: np.ndarray) -> Any:
        """The value at a point of the unit cube, shape (number,)."""
        values = [int(a + np.floor(u * (b - a + 1))) if self.whole else float(a + u * (b - a))
                  for u, a, b in zip(unit, self.low, self.high, strict=True)]
        return values if self.listed else values[0]


def _range(value: Any, path: KeyPath, reader: Reader, problems: Problems) -> _Range | None:
    if not isinstance(value, Mapping) or set(value) != {"low", "high"} or not all(
            _numbers(v) for v in value.values()):
        problems.add(path, f"is {short(value)}; should be a range such as {{ low = 0, high = 1 }}, "
                     "of lists where the value is a list")
        return None
    before = len(problems.found)
    for end in ("low", "high"):
        reader(value[end], (*path, end), problems)
    if len(problems.found) > before:
        return None
    low, high = value["low"], value["high"]
    listed = isinstance(low, list)
    lows, highs = (tuple(v) if isinstance(v, list) else (v,) for v in (low, high))
    if listed != isinstance(high, list) or len(lows) != len(highs):
        problems.add(path, "low and high should be equally long lists, or both numbers")
    elif not all(a <= b for a, b in zip(lows, highs, strict=True)) or lows == highs:
        problems.add(path, f"low {short(low)} should be below high {short(high)}")
    if len(problems.found) > before:
        return None
    between = [v + 0.5 for v in lows]
    whole = all(isinstance(v, int) for v in (*lows, *highs)) and is_refused(
        reader, between if listed else between[0])
    return _Range(lows, highs, whole, listed)


def _numbers(value: Any) -> bool:
    """Whether it is a number, or a list of some."""
    if isinstance(value, list):
        return bool(value) and all(type(v) in (int, float) for v in value)
    return type(value) in (int, float)


def _frozen(values: list[Any]) -> list[Any]:
    return [tuple(value) if isinstance(value, list) else value for value in values]
