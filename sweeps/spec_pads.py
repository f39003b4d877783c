"""Whether pads fit their links, which no key tells by itself: under every setting of a study."""

from dataclasses import replace
from itertools import product

from sweeps.cell import SECTIONS
from sweeps.edge import edge_fields
from sweeps.problems import Problems
from sweeps.study import Study

PROCEDURES = {"planar", "contour", "decide"}
"""What feels with pads; planners that do so find out by themselves."""
KEYS = ("pads.length_mm", "pads.wrap_deg", "pads.thickness_mm", "pads.distal", "pads.middle",
        "pads.proximal", "hand.link_length_mm", "hand.link_radius_mm")


def check_pads(study: Study, problems: Problems) -> None:
    """Notes the first setting under which a pad does not fit its link, if any strategy feels."""
    if not any(PROCEDURES & set(order) for order in _orders(study)):
        return
    points = [dict.fromkeys(
        tuple(entry for entry in zip(axis.keys, values, si, strict=True) if entry[0] in KEYS)
        for values, si in zip(axis.values, axis.si, strict=True)) for axis in study.axes]
    for chosen in product(*points):
        tables = {section: study.tables[section] for section in ("pads", "hand")}
        swept = [entry for point in chosen for entry in point]
        for key, _, si in swept:
            section, name = key.split(".")
            field = edge_fields(SECTIONS[section])[name]
            tables[section] = replace(tables[section], **{field.name: si})
        if wrong := tables["pads"].misfit(tables["hand"]):
            given = [path for key in KEYS if (path := tuple(key.split("."))) in problems.lines]
            at = [("sweep",)] if swept else [*given, ("pads",)]
            told = ", ".join(f"{key} = {value}" for key, value, _ in swept)
            problems.add(at[0], f"with {told}: {wrong}" if told else wrong)
            return


def _orders(study: Study) -> list[tuple[str, ...]]:
    """The orders of procedures that strategies are run with."""
    given = [strategy.order for strategy in study.strategies if not strategy.call]
    swept = [point[axis.keys.index("strategy.order")] for axis in study.axes
             if "strategy.order" in axis.keys for point in axis.si]
    return swept if given and swept else given
