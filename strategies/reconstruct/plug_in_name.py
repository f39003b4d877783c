"""What recovers bodies after an episode, by name: a word of ours, or a function of a user's file.

A function is named as `file.py:function`. In a study's `resolved.json`, and in the hash of a cell,
the hash of its content stands for the file's folder, as for planners.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from strategies.planners.planner_file import PlannerError, planner_file

IMPLICIT, CHOSEN, PARTS = "implicit", "chosen", "parts"
POLYHEDRON = "polyhedron"
"""How rows name a body of crossed faces, which is no word of its own: "chosen" may make it."""
BUILT_IN = ("superquadric", IMPLICIT, CHOSEN, PARTS)
"""Words of `[fit] reconstruct`; the first keeps what the episode recovered."""


def plug_in_file(call: str) -> str:
    """The file of `file.py:function`; empty where `call` names none."""
    file, colon, _ = call.rpartition(":")
    return file if colon and file.endswith(".py") else ""


def call_by_content(call: str, content_hash: str) -> str:
    """`file.py:function` with the hash of the file's content in place of its folder."""
    file, _, function = call.rpartition(":")
    return f"sha256:{content_hash}/{Path(file).name}:{function}"


def find_plug_in(call: str) -> Callable[..., Any]:
    """The function that `call` names; its file is run. Raises PlannerError."""
    file = plug_in_file(call)
    name = call.rpartition(":")[2]
    if not file:
        raise PlannerError(f"{call!r}: should be a file and a function in it, as "
                           "\"mine.py:my_network\"")
    module = planner_file(Path(file)).module
    found = getattr(module, name, None)
    if not callable(found):
        functions = [n for n, v in vars(module).items() if callable(v) and not n.startswith("_")]
        raise PlannerError(f"{file}: has no function {name!r}; it has: "
                           f"{', '.join(functions) or 'none'}")
    return found
