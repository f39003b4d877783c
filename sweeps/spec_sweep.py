"""The `[sweep]` of a spec: grid, zip, Sobol and Latin hypercube axes over dotted keys."""

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from strategies.budget_keys import BUDGET_KEYS
from strategies.strategy import Strategy
from sweeps.cell import SECTIONS
from sweeps.edge import edge_fields
from sweeps.problems import Path, Problem, Problems, SpecError, choose, short
from sweeps.spec_strategies import REFIT, read_names, read_number
from sweeps.study import Axis

KINDS = ("grid", "zip", "sobol", "lhs")
POINT_LIMIT = 10**5  # points of one sampled axis
SETTABLE = ("seed", "episodes_per_cell", "name")
Reader = Callable[[Any, Path, Problems], Any]


def read_axes(sweep: Any, extra_grid: Mapping[str, list[Any]],
              strategies: Sequence[Strategy], seed: int, problems: Problems) -> tuple[Axis, ...]:
    """The axes of a sweep, grid keys first; `extra_grid` replaces or adds grid keys."""
    if not isinstance(sweep, Mapping):
        problems.add(("sweep",), "should be tables such as [sweep.grid]")
        sweep = {}
    for kind, table in sweep.items():
        if kind not in KINDS:
            problems.add(("sweep", kind), f"unknown key; {choose(kind, KINDS)}")
        elif not isinstance(table, Mapping) or not table:
            problems.add(("sweep", kind), "is empty; give it keys such as "
                         '"sensors.tendon_threshold_N" = [3.0, 6.0]')
    parts = {kind: dict(_flat(sweep.get(kind, {}), ("sweep", kind))) for kind in KINDS}
    parts["grid"].update({key: (("sweep", "grid", key), list(values))
                          for key, values in extra_grid.items()})
    readers = _readers(strategies)
    _check_keys(parts, readers, problems)
    axes = [axis for key, (path, value) in parts["grid"].items() if key in readers
            for axis in _listed({key: (path, value)}, readers, problems)]
    axes += _listed({k: v for k, v in parts["zip"].items() if k in readers}, readers, problems)
    for kind in ("sobol", "lhs"):
        axes += _sampled(kind, parts[kind], readers, seed, problems)
    return tuple(axes)


def read_overrides(settings: Sequence[str]) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    """`KEY=V1,V2` texts as grid axes, and single values of keys at the top of a spec."""
    grid: dict[str, list[Any]] = {}
    head: dict[str, Any] = {}
    wrong: list[Problem] = []
    for text in settings:
        key, equals, values = text.partition("=")
        key = key.strip()
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


def _flat(table: Any, path: Path) -> Iterator[tuple[str, tuple[Path, Any]]]:
    """Dotted keys with where they stand; `n` of a sampled axis, lists and ranges are leaves."""
    if not isinstance(table, Mapping):
        return
    for key, value in table.items():
        if isinstance(value, Mapping) and not set(value) & {"low", "high"}:
            for rest, found in _flat(value, (*path, key)):
                yield f"{key}.{rest}", found
        else:
            yield key, ((*path, key), value)


def _readers(strategies: Sequence[Strategy]) -> dict[str, Reader]:
    """How to check and convert one value of every key that can be swept."""
    readers: dict[str, Reader] = {f"{section}.{name}": field.read
                                  for section, table in SECTIONS.items()
                                  for name, field in edge_fields(table).items()}
    for strategy in strategies:
        for family in strategy.waypoints:
            for name, field in edge_fields(type(family)).items():
                if name != "file":
                    readers.setdefault(f"strategy.{name}", field.read)
    for name in ("closings", "order"):
        readers[f"strategy.{name}"] = lambda value, path, problems, name=name: read_names(
            name, value, path, problems) or None
    for name, (kind, low, high, _) in {**BUDGET_KEYS, "refit_every": REFIT}.items():
        readers[f"strategy.{name}"] = (
            lambda value, path, problems, kind=kind, low=low, high=high: read_number(
                value, kind, low, high, path, problems))
    return readers


def _check_keys(parts: Mapping[str, Mapping[str, tuple[Path, Any]]],
                readers: Mapping[str, Reader], problems: Problems) -> None:
    seen: dict[str, str] = {}
    for kind, table in parts.items():
        for key, (path, _) in table.items():
            if key == "n" and kind in ("sobol", "lhs"):
                continue
            if key not in readers:
                problems.add(path, f"unknown key {short(key)}; {choose(key, readers)}")
            elif key in seen:
                problems.add(path, f"{key} is swept already in sweep.{seen[key]}")
            seen.setdefault(key, kind)


def _listed(table: Mapping[str, tuple[Path, Any]], readers: Mapping[str, Reader],
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
        if len(table) == 1 and len({repr(value) for value in si[key]}) < len(values):
            problems.add(path, "holds the same value twice")
    if len({len(values) for values in lists.values()}) > 1:
        lengths = ", ".join(f"{key} has {len(values)}" for key, values in lists.items())
        problems.add(next(iter(table.values()))[0][:2], f"lists should be equally long; {lengths}")
    if not lists or len(problems.found) > before:
        return []
    return [Axis(tuple(lists), tuple(zip(*map(_frozen, lists.values()), strict=True)),
                 tuple(zip(*si.values(), strict=True)))]


def _sampled(kind: str, table: Mapping[str, tuple[Path, Any]], readers: Mapping[str, Reader],
             seed: int, problems: Problems) -> list[Axis]:
    if not table:
        return []
    from scipy.stats import qmc

    before = len(problems.found)
    path: Path = ("sweep", kind)
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
    low, high = np.array([r or (0.0, 1.0) for r in ranges], float).T
    generator = np.random.default_rng([seed, KINDS.index(kind)])
    if kind == "sobol":  # balanced only in powers of two: draw the next one, keep n
        unit = qmc.Sobol(len(keys), rng=generator).random_base2(max(0, (n - 1).bit_length()))[:n]
    else:
        unit = qmc.LatinHypercube(len(keys), rng=generator).random(n)
    whole = [isinstance(table[key][1]["low"], int) and isinstance(table[key][1]["high"], int)
             and _takes_only_whole(readers[key], table[key][1]["low"]) for key in keys]
    points = []
    for row in unit:
        points.append(tuple(
            int(a + np.floor(u * (b - a + 1))) if w else float(a + u * (b - a))
            for u, a, b, w in zip(row, low, high, whole, strict=True)))
    si = [tuple(readers[key](value, table[key][0], problems)
                for key, value in zip(keys, point, strict=True)) for point in points]
    return [Axis(tuple(keys), tuple(points), tuple(si), sampled=True)]


def _takes_only_whole(reader: Reader, value: int) -> bool:
    trial = Problems("", {})
    reader(value + 0.5, (), trial)
    return bool(trial.found)


def _range(value: Any, path: Path, reader: Reader, problems: Problems) -> tuple[float, ...] | None:
    if not isinstance(value, Mapping) or set(value) != {"low", "high"} or not all(
            type(v) in (int, float) for v in value.values()):
        problems.add(path, f"is {short(value)}; should be a range such as {{ low = 0, high = 1 }}")
        return None
    before = len(problems.found)
    for end in ("low", "high"):
        reader(value[end], (*path, end), problems)
    if len(problems.found) == before and not value["low"] < value["high"]:
        problems.add(path, f"low {value['low']} should be below high {value['high']}")
    return (value["low"], value["high"]) if len(problems.found) == before else None


def _frozen(values: list[Any]) -> list[Any]:
    return [tuple(value) if isinstance(value, list) else value for value in values]
