"""One cell of a study: a strategy on an object under one setting, all defaults filled in."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.ready_made import STRATEGIES
from strategies.reconstruct.plug_in_name import BUILT_IN
from strategies.strategy import Strategy
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    FitTable,
    HandTable,
    ObjectTable,
    PadTable,
    RecognitionTable,
    RobotTable,
    ScoreTable,
    SensorTable,
    StereoTable,
    TrueTables,
)

SECTIONS: dict[str, type] = {
    "arm": ArmTable, "hand": HandTable, "sensors": SensorTable, "errors": ErrorTable,
    "contact": ContactTable, "robot": RobotTable,
    "object": ObjectTable, "fit": FitTable, "pads": PadTable, "stereo": StereoTable,
    "planar": PlanarTable, "contour": ContourTable, "decide": DecideTable,
    "recognition": RecognitionTable, "scores": ScoreTable,
}
TABLES = tuple("placement" if name == "object" else name for name in SECTIONS)
"""Names of the sections' fields in a `Cell`."""
APART = ("hand", "sensors", "errors")
"""Sections in which the robot that is may differ from the one that is believed."""
CONTACTS = "contact_rows"
"""The column of rows that holds each episode's contacts, a table of columns, where a cell keeps
them."""
ENDED = "ended"
"""A column of rows that are not written yet, where any is true: episodes that one error of a
strategy ended together."""


@dataclass(frozen=True)
class Cell:
    """Everything the episodes of one cell depend on, picklable.

    `body_table` names the object: `{"name": ...}` for the catalogue, otherwise the spec's table
    with its files made absolute, as `warpgrasp.objects.catalogue.body_from_table` takes it.
    """

    strategy: Strategy
    body_table: Mapping[str, Any]
    object_name: str
    arm: ArmTable = field(default_factory=ArmTable)
    hand: HandTable = field(default_factory=HandTable)
    sensors: SensorTable = field(default_factory=SensorTable)
    errors: ErrorTable = field(default_factory=ErrorTable)
    contact: ContactTable = field(default_factory=ContactTable)
    robot: RobotTable = field(default_factory=RobotTable)
    true: TrueTables | None = None
    """Of the robot that is; None: it has the tables that are believed."""
    placement: ObjectTable = field(default_factory=ObjectTable)
    fit: FitTable = field(default_factory=FitTable)
    pads: PadTable = field(default_factory=PadTable)
    stereo: StereoTable = field(default_factory=StereoTable)
    planar: PlanarTable = field(default_factory=PlanarTable)
    contour: ContourTable = field(default_factory=ContourTable)
    decide: DecideTable = field(default_factory=DecideTable)
    recognition: RecognitionTable = field(default_factory=RecognitionTable)
    scores: ScoreTable = field(default_factory=ScoreTable)
    seed: int = 0
    setting: Mapping[str, Any] = field(default_factory=dict)
    keep: str = "nothing"
    """What is kept beside the rows: nothing, or contacts. No row depends on it."""


def own_code(cell: Cell) -> str:
    """The user's planner and reconstruct function that a cell calls, and for which strategy; empty
    where all comes with the package."""
    strategy, function = cell.strategy, cell.fit.reconstruct
    calls = [*(() if strategy.call in ("", *STRATEGIES) else (strategy.call,)),
             *(() if function in BUILT_IN else (function,))]
    return " ".join((*calls, "for", strategy.name)) if calls else ""


def batch_key(cell: Cell) -> Cell:
    """What cells whose episodes can be run in one call have in common.

    They may differ in their object and, where the order of procedures is given in advance, in where
    their waypoints stand, but not in how many poses those are.
    """
    strategy = cell.strategy
    if not strategy.call:
        strategy = replace(strategy, name="", waypoints=tuple(map(_kind, strategy.waypoints)))
    return replace(cell, strategy=strategy, body_table={}, object_name="", setting={})


def _kind(family: object) -> object:
    """What kind of waypoints a family makes, and how many; of a file's the family itself."""
    count = getattr(family, "count", None)
    return family if count is None else (type(family).__name__, count)
