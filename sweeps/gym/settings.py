"""What an environment is made with: objects and tables, in the words of a spec."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from strategies.procedures.possible import check_possible
from strategies.reconstruct.plug_in_name import BUILT_IN
from sweeps.episode.episodes import cell_body
from sweeps.spec.cell import SECTIONS, Cell
from sweeps.spec.checks import changed
from sweeps.spec.errors import Problems, choose, short
from sweeps.spec.reader import resolve
from warpgrasp.geometry.body import Body

NAME = "environment"
IDLE = {
    "fit": ("reconstruct",
            f"is applied after an episode, which an environment does not do; should be "
            f"{BUILT_IN[0]}"),
    "robot": ("swept", "is of a sweep, which an environment has not; should be both"),
    "recognition": ("", "is for the rows of a sweep: an environment does not recognize what it "
                    "feels; should be left out"),
    "decide": ("", "is for orders of procedures, which an environment has not: actions decide; "
               "should be left out"),
}
"""Tables that say nothing of an environment, or one key of them does, and what to say of it."""


@dataclass(frozen=True)
class Settings:
    """Checked settings of an environment."""

    bodies: tuple[Body, ...]
    names: tuple[str, ...]
    cell: Cell
    """Its tables are those of every world."""


def read_settings(objects: Any, tables: Mapping[str, Any] | None, procedures: Sequence[str],
                  closings: Sequence[str]) -> Settings:
    """Settings from what a spec's `objects` takes, one or a list, and a spec's tables, for
    procedures and closing paths by name: what a spec refuses of these is refused here, too.

    Files are relative to the working directory. Raises ValueError with a line for each problem.
    """
    given = dict(tables or {}) if isinstance(tables, Mapping | None) else {}
    problems = Problems("settings", {(name, key): 1 for name, table in given.items()
                                     if isinstance(table, Mapping) for key in table})
    listed = list(objects) if isinstance(objects, Sequence) and not isinstance(objects, str) else [
        objects]
    if not listed:
        problems.add(("objects",), "is empty; name at least one object")
    if not isinstance(tables, Mapping | None):
        raise ValueError(f"settings: are {short(tables)}; should be tables such as "
                         '{"sensors": {"tendon_threshold_N": 4}}')
    for name in given:
        if name not in SECTIONS:
            problems.add((name,), f"unknown table; {choose(name, SECTIONS)}")
    study = resolve({
        "schema": 1, "name": NAME, "objects": listed, "strategy": [
            {"name": NAME, "order": list(procedures), "closings": list(closings)}],
        **{name: table for name, table in given.items() if name in SECTIONS}},
        Path.cwd(), problems)
    for section, (key, what) in IDLE.items():
        for name in sorted(changed(study, section)):
            if key in ("", name):
                problems.add((section, name), what)
    if problems.found:
        raise ValueError("\n".join(f"{_place(p.key)}: {p.what}" for p in problems.found))
    cells = [study.cell(0, n, 0) for n in range(len(study.objects))]
    for procedure in procedures:
        check_possible(procedure, cells[0].hand, cells[0].pads)
    return Settings(tuple(map(cell_body, cells)), tuple(one.name for one in study.objects),
                    cells[0])


def _place(key: str) -> str:
    """Where a key of a spec stands among an environment's arguments."""
    key = key.removeprefix("strategy[0].")
    return key if key.startswith(("objects", "closings")) else f"settings.{key}"
