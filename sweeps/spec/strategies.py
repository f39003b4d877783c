"""The `[[strategy]]` tables of a spec: waypoint families, closing paths, order of procedures."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from math import isfinite
from pathlib import Path
from typing import Any

from strategies.poses.closing_paths import CLOSING_PATHS
from strategies.poses.waypoints import WAYPOINT_KINDS, WaypointError
from strategies.ready_made import REFERENCE, STRATEGIES
from strategies.strategy import BUDGET_KEYS, PROCEDURES, Strategy
from sweeps.spec.errors import KeyPath, Problems, check_name, choose, short
from sweeps.spec.named_files import CSV_LIMIT, NoFile, named_file
from sweeps.spec.study import REFITTED, Study
from sweeps.spec.units import read_table

NUMBERS = ("refit_every", "noise_stream")
BEST = "best"
KEYS = ("name", "waypoints", "closings", "order", "strategy", "options", "budget", *NUMBERS)


def read_strategies(values: Any, base_dir: Path, problems: Problems) -> tuple[Strategy, ...]:
    """Every strategy of a spec; a name alone is the ready-made strategy of that name."""
    path: KeyPath = ("strategy",)
    if not isinstance(values, list):
        problems.add(path, "should be a list of tables, each under [[strategy]]")
        return ()
    if not values and path in problems.lines:
        problems.add(path, "is empty; name at least one strategy")
    found: list[Strategy] = []
    for n, table in enumerate(values):
        strategy = _read_strategy(table, (*path, n), base_dir, problems)
        if strategy and any(strategy.name == other.name for other in found):
            problems.add((*path, n, "name"), f"is {strategy.name!r} a second time; "
                         "each strategy needs its own name")
        elif strategy:
            found.append(strategy)
    return tuple(found)


def idle_grasp_notes(study: Study) -> Iterator[str]:
    """What to say of a strategy that tells of grasps, where no order that it is run with has one.

    That is no error: a study may sweep the order, or come to it by `--set`.
    """
    for strategy in study.strategies:
        usual = STRATEGIES.get(strategy.name, Strategy(strategy.name))
        given = [key for key in ("waypoints", "closings", "refit_every")
                 if getattr(strategy, key) != getattr(usual, key)]
        if given and not strategy.call and not study.reaches(strategy, "strategy.closings"):
            yield (f"strategy {strategy.name}: {', '.join(given)} count for grasps alone, and its "
                   'order has no "containment"')


def _read_strategy(table: Any, path: KeyPath, base_dir: Path,
                   problems: Problems) -> Strategy | None:
    if not isinstance(table, Mapping):
        problems.add(path, f"is {short(table)}; should be a table with a name")
        return None
    for key in table:
        if key not in KEYS:
            problems.add((*path, key), f"unknown key; {choose(key, KEYS)}")
    name = check_name(table.get("name"), (*path, "name"), problems)
    if name is None:
        return None
    if name == REFERENCE:
        problems.add((*path, "name"), f"is {name!r}, which every leaderboard has as its reference "
                     "row; leave it out, or give the strategy another name")
        return None
    if name == BEST:
        problems.add((*path, "name"), f"is {name!r}, which --against takes for the leaderboard's "
                     "first; give the strategy another name")
        return None
    if set(table) <= {"name"}:
        if name not in STRATEGIES:
            problems.add((*path, "name"), f"no ready-made strategy {name!r}; "
                         f"{choose(name, STRATEGIES)}; or give it waypoints of its own")
        return STRATEGIES.get(name, Strategy(name))
    strategy = replace(STRATEGIES.get(name, Strategy(name)), doc="")
    if "waypoints" in table:
        strategy = replace(strategy, waypoints=_read_waypoints(
            table["waypoints"], (*path, "waypoints"), base_dir, problems))
    for key in ("closings", "order"):
        if key in table and (names := read_names(key, table[key], (*path, key), problems)):
            strategy = replace(strategy, **{key: names})
    numbers = {key: table[key] for key in NUMBERS if key in table}
    strategy = replace(strategy, **read_table(Strategy, numbers, path, problems))
    if "budget" in table:  # in place of the whole budget of a ready-made strategy
        strategy = replace(strategy, **{**dict.fromkeys(BUDGET_KEYS), **_read_budget(
            table["budget"], (*path, "budget"), problems)})
    return _read_call(strategy, table, path, base_dir, problems)


def _read_call(strategy: Strategy, table: Mapping[str, Any], path: KeyPath, base_dir: Path,
               problems: Problems) -> Strategy:
    """The planner that a strategy names, and its options; of one that ships also its budget, where
    the table has none."""
    call, options = table.get("strategy", strategy.call), table.get("options", {})
    if "strategy" in table and (not isinstance(call, str) or not call):
        problems.add((*path, "strategy"), f"is {short(call)}; should be a planner's name, or "
                     'a file and a function in it, as "mine.py:next_best"')
        return strategy
    for key in ("order", "waypoints") if call else ():
        if key in table:
            problems.add((*path, key), f"has no meaning beside a planner ({short(call)}), which "
                         "chooses for itself")
    if call in REFITTED and "refit_every" in table:
        problems.add((*path, "refit_every"), f"has no meaning beside {short(call)}, which looks at "
                     "the body after every step")
    if not isinstance(options, Mapping):
        problems.add((*path, "options"), "should be a table of numbers, texts and booleans")
        options = {}
    options = {key: value for key, value in options.items()
               if is_option(value, (*path, "options", key), problems)}
    if options and not call:
        problems.add((*path, "options"), "has no meaning without a planner (strategy = ...)")
    if not call:
        return strategy
    file, colon, _ = call.rpartition(":")
    if colon and file.endswith(".py"):
        try:
            call = f"{named_file(file, base_dir, CSV_LIMIT)}:{call.rpartition(':')[2]}"
        except (OSError, NoFile, ValueError) as error:
            problems.add((*path, "strategy"), str(error))
            return strategy
    from strategies.planners.planner_file import PlannerError
    from strategies.planners.registry import make_planner  # heavy, and only planners need it

    try:
        make_planner(call, options)
    except PlannerError as error:
        problems.add((*path, "strategy"), str(error))
    known = STRATEGIES.get(call)
    if known is not None and known.call == call and "budget" not in table:
        strategy = replace(strategy, **{key: getattr(known, key) for key in BUDGET_KEYS})
    return replace(strategy, call=call, options=tuple(sorted(options.items())))


def is_option(value: Any, path: KeyPath, problems: Problems) -> bool:
    """Whether a value may be a planner's option; what may not is noted."""
    if isinstance(value, int | str) or (isinstance(value, float) and isfinite(value)):
        return True
    problems.add(path, f"is {short(value)}; should be a finite number, a text or a boolean")
    return False


def _read_budget(value: Any, path: KeyPath, problems: Problems) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        problems.add(path, f"is {short(value)}; should be a table such as {{ touches = 96 }}")
        return {}
    for key in set(value) - set(BUDGET_KEYS):
        problems.add((*path, key), f"unknown key; {choose(key, BUDGET_KEYS)}")
    known = {key: number for key, number in value.items() if key in BUDGET_KEYS}
    return read_table(Strategy, known, path, problems)


def read_names(key: str, value: Any, path: KeyPath, problems: Problems) -> tuple[str, ...]:
    """A list of closing paths or of procedures, by name. Which closing paths there are is the
    hand's (`check_closings`)."""
    valid = {"closings": CLOSING_PATHS, "order": PROCEDURES}[key]
    if not isinstance(value, list) or not value:
        problems.add(path, f"is {short(value)}; should be a list of names; {choose(None, valid)}")
        return ()
    for n, name in enumerate(value):
        if not isinstance(name, str) or (key == "order" and name not in valid):
            problems.add((*path, n), f"is {short(name)}; {choose(name, valid)}")
    return tuple(name for name in value
                 if isinstance(name, str) and (key == "closings" or name in valid))


def _read_waypoints(value: Any, path: KeyPath, base_dir: Path,
                    problems: Problems) -> tuple[object, ...]:
    tables = value if isinstance(value, list) else [value]
    if not tables:
        problems.add(path, "is empty; give at least one table such as { kind = \"ring\" }")
    return tuple(family for n, table in enumerate(tables)
                 if (family := _read_family(table, (*path, n) if tables is value else path,
                                            base_dir, problems)) is not None)


def _read_family(table: Any, path: KeyPath, base_dir: Path, problems: Problems) -> object | None:
    if not isinstance(table, Mapping):
        problems.add(path, f"is {short(table)}; should be a table such as {{ kind = \"ring\" }}")
        return None
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in WAYPOINT_KINDS:
        what = "missing" if kind is None else f"is {short(kind)}"
        problems.add((*path, "kind"), f"{what}; {choose(kind, WAYPOINT_KINDS)}")
        return None
    family = WAYPOINT_KINDS[kind]
    own = {key: value for key, value in table.items() if key != "kind"}
    values = read_table(family, own, path, problems)
    if "file" in {f.name for f in fields(family)}:
        return _read_pose_file(family, values, path, base_dir, problems)
    return family(**values)


def _read_pose_file(family: type, values: dict[str, Any], path: KeyPath, base_dir: Path,
                    problems: Problems) -> object | None:
    if not values.get("file"):
        problems.add((*path, "file"), "missing; should be a CSV file of hand poses")
        return None
    from strategies.poses.hand_poses import poses_from_csv  # heavy, and only files need it

    try:
        file = named_file(values["file"], base_dir, CSV_LIMIT)
        poses_from_csv(file)
    except (WaypointError, NoFile) as error:
        problems.add((*path, "file"), str(error))
    except (OSError, ValueError) as error:
        problems.add((*path, "file"), f"{short(values['file'])} cannot be read: {error}")
    else:
        return family(**{**values, "file": str(file)})
    return None
