"""By what an entry is known in figures: the same in all of a study."""

from pathlib import Path

import numpy as np
import pytest
from curved_episodes import wide_study, wide_text, written
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.figures.kinds import KINDS, Asked
from sweeps.figures.style import COLOURS, looks_of
from sweeps.run.plan import Unit
from sweeps.run.unit_file import Columns


def colours(drawn: Figure) -> dict[str, str]:
    """By an entry's name, as the legend has it."""
    handles, names = drawn.axes[0].get_legend_handles_labels()
    lines = {name: handle.lines[0] if isinstance(handle, ErrorbarContainer) else handle
             for name, handle in zip(names, handles, strict=True) if name.startswith("s")}
    return {name: str(line.get_color()) for name, line in lines.items()
            if isinstance(line, Line2D)}


def dear_and_good(unit: Unit) -> Columns:
    """What takes longer has less error, and less of IoU too, so that the orders differ."""
    good = unit.cell.strategy.name == "sx"
    return {"chamfer_mm": np.linspace(4.0, 5.0, 8) + (0.0 if good else 3.0),
            "iou": np.linspace(0.5, 0.6, 8) + (0.0 if good else 0.2),
            "touches": np.full(8, 30), "robot_time_s": np.full(8, 90.0 if good else 50.0)}


@pytest.mark.parametrize(("kind", "metric"), [
    ("curves-time", "chamfer_mm"), ("pareto", "chamfer_mm"), ("pareto", "iou")])
def test_an_entry_has_the_same_colour_in_every_figure(tmp_path: Path, kind: str, metric: str
                                                      ) -> None:
    plan, store = written(tmp_path, 2, dear_and_good)
    of_curves = colours(KINDS["curves-touches"](Asked(plan, [store])))
    assert of_curves == {"sx": COLOURS[0], "s": COLOURS[1]}
    found = colours(KINDS[kind](Asked(plan, [store], metric)))
    assert found
    assert found == {name: of_curves[name] for name in found}
    assert metric == "iou" or found == of_curves


def test_colours_go_by_the_leaderboard(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(10, 10, 8))
    board = make_leaderboard(plan, [store])
    ranked = [row[board.header.index("strategy")] for row in board.rows]
    found = colours(KINDS["curves-touches"](Asked(plan, [store])))
    assert list(found) == ranked[:len(COLOURS)]
    assert list(found.values()) == list(COLOURS)


def test_ties_by_rounding_have_the_order_of_their_names() -> None:
    errors, labels = np.array([5.0, 3.0 + 1e-13, 3.0, np.nan]), ["d", "a", "b", "c"]
    assert [look.colour for look in looks_of(errors, labels)] == [
        COLOURS[2], COLOURS[0], COLOURS[1], COLOURS[3]]
    many = looks_of(np.arange(64.0), [f"s{n}" for n in range(64)])
    assert len({(look.colour, look.marker) for look in many}) == 64
    assert len({(look.colour, look.dash) for look in many}) == 64


def good_at_one_level(unit: Unit) -> Columns:
    """The strategy that is best in the mean is not the one of the best level."""
    swept = next(iter(unit.cell.setting.values()))
    steady = unit.cell.strategy.name == "sx"
    chamfer = 5.0 if steady else 2.0 if float(swept) > 45.0 else 9.0  # type: ignore[arg-type]
    return {"chamfer_mm": np.full(8, chamfer), "iou": np.full(8, 0.5),
            "robot_time_s": np.full(8, 50.0)}


def test_levels_of_samples_have_the_colours_of_entries(tmp_path: Path) -> None:
    plan, store = written(tmp_path, 2, good_at_one_level, """
[sweep.sobol]
n = 8
"object.yaw_deg" = { low = 0, high = 60 }
""")
    of_curves = colours(KINDS["curves-touches"](Asked(plan, [store])))
    assert of_curves == {"sx": COLOURS[0], "s": COLOURS[1]}
    assert colours(KINDS["levels"](Asked(plan, [store]))) == of_curves
