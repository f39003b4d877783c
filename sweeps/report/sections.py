"""The sections of the report, one function each, from results to markup."""

import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from sweeps.analysis.confusion import Confusion, confusion_table
from sweeps.analysis.curves import AXES, Curves, reach_table
from sweeps.analysis.leaderboard import Leaderboard
from sweeps.analysis.objects import ALSO, objects_table
from sweeps.analysis.paired import Paired
from sweeps.analysis.pairs import pairs_table
from sweeps.analysis.pareto import pareto_table
from sweeps.analysis.settings import read_settings, settings_table
from sweeps.figures.curves import draw_curves, draw_levels
from sweeps.figures.forest import draw_forest
from sweeps.figures.heat_maps import draw_confusion, draw_settings
from sweeps.figures.pareto import draw_pareto
from sweeps.figures.style import UNITS
from sweeps.report.html import details, drawing, paragraph, preformatted, section, table
from sweeps.report.views import PLACES, Views
from sweeps.run.plan import Plan
from sweeps.run.store import Store

METRIC = "chamfer_mm"
"""The score of the page, which its captions name."""
AXIS_NAMES = {"touches": "touches", "time_s": "robot time"}


def leaderboard_section(board: Leaderboard, paired: Paired) -> str:
    """The leaderboard as a forest plot and as a table that sorts."""
    forest = drawing(draw_forest(paired, METRIC), "forest", "Mean chamfer distance by strategy",
                     "Means, and differences from the best, with 95 % intervals.")
    return section("Leaderboard", paragraph(
        "All strategies meet the same objects, poses and noise. There are two 95 % intervals: "
        'columns "ci" are of objects like these, columns "these" of these objects with other '
        "episodes. Differences to the best are paired, and hold for all strategies at once. Failed "
        "episodes count. given-prior touches nothing: what it scores is what every strategy is "
        "given."),
        forest, table("Ranked by the mean chamfer distance; any column's heading sorts",
                      *_with_intervals(board), row_names=1), name="board")


def _with_intervals(board: Leaderboard) -> tuple[list[str], list[list[str]]]:
    """The leaderboard with both bounds of an interval in one cell, those of a number together.

    Without the numbers of objects and episodes, which are the page's.
    """
    names = list(board.header)
    stems = [name.removesuffix("_low") for name in names if name.endswith("_low")]
    wide = [name for name in names
            if not name.endswith(("_low", "_high")) and name not in ("n_objects", "n_episodes")]
    header: list[str] = []
    for name in wide:
        of = "delta" if name.startswith("delta") else name
        header += [name, *(f"{of}_{over}" for over in ("ci", "these") if f"{of}_{over}" in stems)]
    rows = []
    for row in board.rows:
        cells = dict(zip(names, row, strict=True))
        for stem in stems:
            low, high = cells[f"{stem}_low"], cells[f"{stem}_high"]
            cells[stem] = "NA" if "NA" in (low, high) else f"{low} to {high}"
        rows.append([cells[name] for name in header])
    return header, rows


def curves_section(curves: Curves) -> str:
    """Error during the episodes, and the cost of reaching a given error."""
    charts = [drawing(draw_curves(curves, axis), f"curves-{axis}",
                      f"Chamfer distance against {AXIS_NAMES[axis]}",
                      f"Against {AXIS_NAMES[axis]}, with 95 % intervals; from where 95 % of the "
                      "episodes have a fit.") for axis in AXES]
    reached = reach_table(curves)
    return section("Error during an episode", f'<div class="charts">{"".join(charts)}</div>',
                   details("Touches and seconds to 5 mm and 3 mm", table(
                       "Median touches and robot time until the error is first within a bound (NA: "
                       "fewer than half of the episodes ever are)", reached.header,
                       reached.rows)), name="curves")


def pareto_section(paired: Paired) -> str:
    """Error against robot time."""
    found = pareto_table(paired, METRIC)
    return section("Error and robot time", drawing(
        draw_pareto(paired, METRIC), "pareto-plot", "Error against robot time",
        "Coloured: on the front, no other strategy is better in both."), details(
        "As a table", table("Error against robot time", found.header, found.rows)),
        *(paragraph(note) for note in found.notes if note not in paired.notes), name="pareto")


def objects_section(paired: Paired) -> str:
    """Medians by object, and a closed part with the whole table."""
    medians = np.array([[np.median(values[:, n]) for values in paired.values[METRIC]]
                        for n in range(len(paired.labels))])
    tints = _heat(medians)
    rows = [(label, *(f"{v:.2f}" if np.isfinite(v) else "NA" for v in row))
            for label, row in zip(paired.labels, medians, strict=True)]
    full = objects_table(paired, METRIC)
    return section("Object by object", table(
        f"Median {UNITS[METRIC]} over episodes; a stronger tint is worse",
        ("strategy", *paired.objects), rows, heat=[("", *row) for row in tints]),
        details("With intervals and costs", table(
            f"Medians with 95 % intervals; {', '.join(ALSO)} are means", full.header, full.rows,
            row_names=1)), name="objects")


def pairs_section(paired: Paired) -> str:
    """Tests of each entry against the best; nothing where no entry has a value."""
    if len(paired.labels) < 2 or not np.isfinite(paired.means[METRIC][0]).any():
        return ""
    made = pairs_table(paired, METRIC, "best")
    return section("Is the difference real?", paragraph(
        "p_objects (Wilcoxon's signed-rank test over objects) generalizes to other objects, "
        "p_episodes (a t-test within objects) to other episodes with these; _holm is corrected "
        "for the number of all pairs, since the best is chosen after the fact. Intervals are of "
        "each pair alone."),
        table("Each strategy against the best", made.header, made.rows),
        *(paragraph(note) for note in made.notes if note not in paired.notes), name="pairs")


def confusion_section(found: Confusion) -> str:
    """A confusion matrix for each entry that names the object."""
    if not found.labels:
        return ""
    parts = [details(label, drawing(
        draw_confusion(found, label), f"confusion-{n}", f"Confusion matrix of {label}",
        "Rows: the object felt; columns: what it was taken for [% of episodes]."), opened=n == 0)
        for n, label in enumerate(found.labels)]
    counts = confusion_table(found)
    return section("Recognition", *parts, details(
        "As a table", table("Answers of each strategy on each object", counts.header,
                            counts.rows)), name="recognition")


def settings_section(plan: Plan, stores: Sequence[Store]) -> str:
    """The effect of each swept factor."""
    if not plan.study.axes:
        return ""
    paired = read_settings(plan, stores, METRIC)
    found = settings_table(plan, paired, METRIC)
    return section("Swept factors", drawing(
        draw_levels(plan, paired, METRIC), "levels-plot", "Error against each swept factor",
        "Means over the other factors, with 95 % intervals."), drawing(
        draw_settings(plan, paired, METRIC), "settings-plot", "Means by level of each factor",
        "Means; the tint is the difference from the strategy's mean."), paragraph(
        "spread is the largest level mean minus the smallest, with the interval of that "
        "difference, which holds for all levels together; share is the factor's part "
        "of the variance between settings."),
        *(paragraph(note) for note in found.notes if note not in paired.notes),
        table("Means by level", found.header, found.rows), name="settings")


def views_section(plan: Plan, shown: Views) -> str:
    """One canvas for the 3-D view, and a button for each episode."""
    if not shown.episodes:
        return ""
    boxes = "".join(
        f'<label><input type="checkbox" id="show-{name}" checked> {text}</label>'
        for name, text in (("recovered", "recovered body"), ("true", "true body, as wires"),
                           ("contacts", "contacts")))
    numbers: dict[tuple[str, str], int] = {}
    for n, e in enumerate(shown.episodes):  # an object's own come after those of strategies
        numbers.setdefault((e["strategy"], e["place"]), n)
    gallery = "".join(_button(shown, n) for n, e in enumerate(shown.episodes)
                      if numbers[(e["strategy"], e["place"])] != n)
    rows = []
    for strategy in plan.study.strategies:
        cells = "".join(f"<td>{_button(shown, numbers.get((strategy.name, place)))}</td>"
                        for place in PLACES)
        rows.append(f'<tr><th scope="row">{escape(strategy.name)}</th>{cells}</tr>')
    head = "".join(f'<th scope="col">{name}</th>' for name in ("strategy", *PLACES))
    return section(
        "Best, median and worst episodes", paragraph(
            "Drag, or the arrow keys, turn the view; plus and minus zoom. Colours tell how sure "
            "the robot is of its surface: one standard deviation is 0 where it is violet, 10 mm "
            "or more where it is yellow."),
        f'<div class="stage"><div><canvas id="stage" tabindex="0" role="img"></canvas>'
        f'<p id="about" class="soft" aria-live="polite"></p><div class="controls">{boxes}</div>'
        f'</div><div class="episodes"><table><thead><tr>{head}</tr></thead><tbody>'
        f'{"".join(rows)}</tbody></table>{_gallery(gallery)}</div></div>', name="episodes-shown")


def _gallery(buttons: str) -> str:
    """Every object, by the median episode of the strategy that is best on it."""
    return (f'<h3>Every object, as the best strategy on it recovers it</h3><p class="gallery">'
            f"{buttons}</p>") if buttons else ""


def _button(shown: Views, number: int | None) -> str:
    """The button that shows an episode; nothing for one that could not be run again."""
    if number is None:
        return ""
    episode = shown.episodes[number]
    return (f'<button type="button" data-episode="{number}" '
            f'aria-pressed="{"true" if number == 0 else "false"}">'
            f'{escape(episode["object"])} {episode["chamfer_mm"]:.1f} mm</button>')


def spec_section(spec: str, plan: Plan) -> str:
    """The spec as given and as resolved."""
    given = preformatted(spec) if spec else paragraph("spec.toml is missing.")
    filled = preformatted(json.dumps(plan.resolved, indent=1, ensure_ascii=False))
    return section("Spec", details("The spec, as given", given, opened=True),
                   details(f"With every default filled in (hash {plan.hash})", filled),
                   name="spec")


def reproduce_section(plan: Plan, environment: Mapping[str, Any]) -> str:
    """The environment of the sweep, and the commands that reproduce it."""
    rows = [(str(key), str(value)) for key, value in environment.items()]
    commands = ("warpgrasp sweep spec.toml -o DIR\nwarpgrasp leaderboard DIR -o leaderboard.csv\n"
                "warpgrasp report DIR -o report.html")
    return section("Environment and reproduction", paragraph(
        f"The spec above gives study {plan.hash}, in the same environment bit-identical."),
        preformatted(commands), table("Environment", ("what", "value"), rows, sortable=False),
        name="reproduce")


def _heat(values: np.ndarray) -> list[list[str]]:
    """Classes of five tints, from the best to the worst of each column."""
    low, high = np.fmin.reduce(values, axis=0), np.fmax.reduce(values, axis=0)
    share = (values - low) / np.where(high > low, high - low, 1.0)
    return [[f"heat{min(4, int(5 * v))}" if np.isfinite(v) else "" for v in row] for row in share]
