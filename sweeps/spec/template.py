"""The commented template of a spec, generated from the same tables that check one."""

from collections.abc import Iterator, Mapping
from typing import Any

from strategies.poses.closing_paths import CLOSING_PATHS
from strategies.poses.waypoints import WAYPOINT_KINDS
from strategies.ready_made import DEFAULT, STRATEGIES
from strategies.strategy import PROCEDURES, Strategy
from sweeps.spec.cell import SECTIONS
from sweeps.spec.strategies import NUMBERS
from sweeps.spec.units import SpecField, spec_fields

HEAD = """\
# A study: strategies compared on objects. `warpgrasp check` explains what is wrong in it.
schema = 1
name = "my-study"
seed = 7
episodes_per_cell = 16                 # of each strategy on each object
# keep = "contacts"                    # of every episode, for `warpgrasp rows --contacts`
# Names (`warpgrasp objects`), meshes, compounds, superquadrics (half their extents):
#   { mesh = "mug.stl", units = "cm" }
#   { object = "wine_bottle", stable_pose = 1 }   # lying, as it likeliest comes to rest
#   { name = "egg", superquadric = { size_mm = [30, 30, 45], exponents = [1.0, 1.0] } }
#   { name = "tee", compound = [{ shape = "block", size_mm = [20, 60, 80] }] }
objects = ["block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel"]

[[strategy]]                           # ready-made, by name (`warpgrasp strategies`)
name = "DEFAULT"                      # for objects of any shape; slower than rings of grasps
# options = { poses = 4 }              # of a planner: docs/strategies.md

[[strategy]]
name = "my-ring"
waypoints = { kind = "ring", count = 8, tilt_deg = 70 }   # or a list of such tables
"""
_OF_STRATEGY = spec_fields(Strategy)
SET = {"fit": {"reconstruct": "chosen"}}
"""Keys that the template sets, as `explore` does: what suits objects of any shape."""
SWEEP = """\
# [sweep.grid]                         # every combination; entries of the leaderboard
# "sensors.tendon_threshold_N" = [3.0, 6.0, 12.0]
# "strategy.tilt_deg" = [35, 55]       # every waypoint family that has it
# "strategy.options.poses" = [4, 8]    # every planner whose [[strategy]] names this option
# [sweep.zip]                          # lists of equal length that advance together
# [sweep.sobol]                        # draws of a nuisance, averaged over; [sweep.lhs] likewise
# n = 32
# "object.yaw_deg" = { low = -180, high = 180 }
# "hand.link_length_mm" = { low = [39, 30, 25], high = [47, 36, 31] }   # each for itself
# [search]                             # of one strategy, `warpgrasp race` proposes: docs/race.md
# "strategy.count" = { low = 4, high = 8, step = 1 }
"""


def spec_template() -> str:
    """A spec that runs as it is, with every other key in a comment, its default and meaning."""
    lines = [HEAD.replace("DEFAULT", DEFAULT),
             f"# closings = {_toml(tuple(CLOSING_PATHS))}  # choose among these",
             f"# order = {_toml(tuple(PROCEDURES))}",
             *_keys((_OF_STRATEGY[name] for name in NUMBERS), {}),
             "# budget = { touches = 96, robot_time_s = 120, volume_ratio = 3 }  # whichever is "
             "spent first; if not given none, and touches = 96 of planners that ship",
             '# strategy = "mine.py:next_best"  # a planner, in place of waypoints and order',
             f"# Ready-made: {', '.join(STRATEGIES)}", "# Keys of each kind of waypoints:"]
    for kind, table in WAYPOINT_KINDS.items():
        keys = ", ".join(f"{name} = {_toml(field.spec_default)}"
                         for name, field in spec_fields(table).items())
        lines.append(f"#   {{ kind = \"{kind}\", {keys} }}")
    for section, table in SECTIONS.items():
        lines += ["", f"[{section}]", *_keys(spec_fields(table).values(), SET.get(section, {}))]
    return "\n".join([*lines, "", SWEEP])


def _keys(fields: Any, given: Mapping[str, Any]) -> Iterator[str]:
    for field in fields:
        if field.key in given:
            yield f"{field.key} = {_toml(given[field.key])}  # {_meaning(field)}"
        else:
            yield f"# {field.key} = {_value(field)}  # {_meaning(field)}".rstrip(" #")


def _value(field: SpecField) -> str:
    return "..." if field.default is None else _toml(field.spec_default)


def _meaning(field: SpecField) -> str:
    choices = f" (one of {', '.join(field.choices)})" if field.choices else ""
    return f"{field.doc}{choices}"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
