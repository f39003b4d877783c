"""What an environment is made with: objects and tables, in the words of a spec."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from strategies.ready_made import STRATEGIES
from strategies.reconstruct.plug_in_name import BUILT_IN
from sweeps.episode.episodes import cell_body
from sweeps.spec.cell import SECTIONS, Cell
from sweeps.spec.errors import Problems, choose, short
from sweeps.spec.hands import read_hand
from sweeps.spec.named_files import read_arm, with_models
from sweeps.spec.objects import read_objects
from sweeps.spec.units import read_table
from warpgrasp.arms.arm_column import in_column
from warpgrasp.geometry.body import Body


@dataclass(frozen=True)
class Settings:
    """Checked settings of an environment."""

    bodies: tuple[Body, ...]
    names: tuple[str, ...]
    cell: Cell
    """Its tables are those of every world."""


def read_settings(objects: Any, tables: Mapping[str, Any] | None) -> Settings:
    """Settings from what a spec's `objects` takes, one or a list, and a spec's tables.

    Files are relative to the working directory. Raises ValueError with a line for each problem.
    """
    problems = Problems("settings", {})
    listed = list(objects) if isinstance(objects, Sequence) and not isinstance(objects, str) else [
        objects]
    if not listed:
        problems.add(("objects",), "is empty; name at least one object")
    found = read_objects(listed, Path.cwd(), problems)
    if not isinstance(tables, Mapping | None):
        raise ValueError(f"settings: are {short(tables)}; should be tables such as "
                         '{"sensors": {"tendon_threshold_N": 4}}')
    given = dict(tables or {})
    for name in {"hand", "arm"} & set(given):  # as a spec may have it: hand = "allegro"
        if not isinstance(given[name], Mapping):
            given[name] = {"kind": given[name]}
    for name in given:
        if name not in SECTIONS:
            problems.add(("settings", name), f"unknown table; {choose(name, SECTIONS)}")
    read = {name: table(**read_table(table, given.get(name, {}), ("settings", name), problems))
            for name, table in SECTIONS.items()}
    for name, read_kind in (("hand", read_hand), ("arm", read_arm)):
        read[name] = replace(read[name], kind=read_kind(
            read[name].kind, Path.cwd(), problems, ("settings", name, "kind")))
    if read["fit"].reconstruct != BUILT_IN[0]:
        problems.add(("settings", "fit", "reconstruct"), "is applied after an episode, which "
                     f"an environment does not do; should be {BUILT_IN[0]}")
    read["recognition"] = with_models(read["recognition"], Path.cwd(), problems)
    if not problems.found and (wrong := in_column(
            read["arm"].kind, read["object"].x_m, read["object"].y_m)):
        problems.add(("settings", "object"), wrong)
    if problems.found:
        raise ValueError("\n".join(f"{p.key}: {p.what}" for p in problems.found))
    read["placement"] = read.pop("object")
    cells = [Cell(STRATEGIES["ring6"], one.table, one.name, **read) for one in found]
    return Settings(tuple(cell_body(cell) for cell in cells), tuple(one.name for one in found),
                    cells[0])
