"""The sections of the report, one function each, from numbers to markup."""

import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from sweeps.analysis.bootstrap import Estimate
from sweeps.analysis.confusion import Confusion
from sweeps.analysis.curves import AXES, Curves, grid_of, mean_curve, reach_table
from sweeps.analysis.leaderboard import Leaderboard
from sweeps.analysis.objects import ALSO, objects_table
from sweeps.analysis.paired import Paired
from sweeps.analysis.pairs import pairs_table
from sweeps.analysis.pareto import COST, find_front, pareto_table
from sweeps.figures.curves import BANDS
from sweeps.figures.style import UNITS
from sweeps.report.charts import COLOURED, Chart, interval_bar, legend
from sweeps.report.html import details, drawing, paragraph, preformatted, section, table
from sweeps.report.views import PLACES, Views
from sweeps.run.plan import Plan
from sweeps.run.store import Store

AXIS_LABELS = {"touches": "touches", "time_s": "robot time [s]"}


def leaderboard_section(board: Leaderboard, metric: str) -> str:
    """The leaderboard, sortable, with a picture of each interval."""
    at = [board.header.index(name) for name in (metric, f"{metric}_ci_low", f"{metric}_ci_high")]
    numbers = np.array([[_number(row[n]) for n in at] for row in board.rows])
    good = numbers[np.isfinite(numbers)]
    scale = (0.0, float(good.max(initial=0.0)))
    pictures = [interval_bar(tuple(row), scale) for row in numbers]
    header = (*board.header[:3], "interval", *board.header[3:])
    rows = [(*row[:3], row[at[1]], *row[3:]) for row in board.rows]
    return section("Leaderboard", paragraph(
        "Strategies met the same objects, poses and noise. Intervals of 95 % are from a bootstrap "
        "that draws objects, each with its episodes (of one object its episodes), widened where "
        "they are few; differences are paired. A failed episode counts."),
        table("Ranked by the mean chamfer distance; any column's heading sorts", header, rows,
              row_names=1, pictures={3: pictures}), name="board")


def curves_section(curves: Curves) -> str:
    """Error as it falls, and what a good shape costs."""
    charts = []
    for axis in AXES:
        grid = grid_of(curves, axis)
        found = [mean_curve(curves, axis, n, grid) for n in range(len(curves.labels))]
        last = np.array([f.value[-1] if np.isfinite(f.value[-1]) else np.inf for f in found])
        order = sorted(range(len(found)), key=lambda n: (last[n], curves.labels[n]))
        shown = min(len(order), COLOURED)
        bands = len(order) <= BANDS
        stop = 1.02 * float(grid[-1])
        aside = 0.0 if bands else 0.028 * stop
        chart = Chart(f"Chamfer distance against {AXIS_LABELS[axis]}", AXIS_LABELS[axis],
                      "chamfer distance [mm]", (0.0, stop + (shown + 0.5) * aside),
                      (0.0, 1.05 * _top(*found)))
        for tone, n in reversed(list(enumerate(order))):
            chart.steps(grid, found[n], tone, curves.labels[n], stop, bands)
            if not bands and tone < shown:
                chart.bar(stop + (tone + 1) * aside, (
                    found[n].value[-1], found[n].low[-1], found[n].high[-1]), tone,
                    curves.labels[n])
        charts.append(drawing(chart.svg() + legend(
            [curves.labels[n] for n in order[:COLOURED]], max(0, len(order) - COLOURED)),
            f"Against {AXIS_LABELS[axis]}, with 95 % "
            + ("bands" if bands else "intervals of the last errors on the right")
            + "; from where 95 % of the episodes have a fit."))
    reached = reach_table(curves)
    return section("Error as it falls", f'<div class="charts">{"".join(charts)}</div>', details(
        "Touches and seconds to 5 mm and 3 mm", table(
            "Median touches and robot time until the error is first within a bound (NA: fewer "
            "than half of the episodes ever are)", reached.header, reached.rows)), name="curves")


def pareto_section(paired: Paired, metric: str) -> str:
    """Error against robot time."""
    found = find_front(paired, metric)
    good = [n for n in range(len(paired.labels)) if np.isfinite(found.error.value[n])
            and np.isfinite(found.cost.value[n])]
    front = sorted((n for n in good if found.dominated_by[n] is None),
                   key=lambda n: found.cost.value[n])
    rest = [n for n in good if n not in front]
    parts = []
    if good:
        chart = Chart("Error against robot time", "robot time [s]", UNITS[metric],
                      (0.0, 1.05 * _top(found.cost)), (0.0, 1.05 * _top(found.error)))
        for tone, n in [*((COLOURED, n) for n in rest), *enumerate(front)]:
            chart.point((found.cost.value[n], found.cost.low[n], found.cost.high[n]),
                        (found.error.value[n], found.error.low[n], found.error.high[n]),
                        tone, paired.labels[n])
        parts.append(drawing(chart.svg() + legend(
            [paired.labels[n] for n in front[:COLOURED]],
            len(rest) + max(0, len(front) - COLOURED), marks=True),
            "Coloured: on the front, no other strategy is better in both."))
    made = pareto_table(paired, metric)
    return section(f"Error and {COST.split('_')[1]}", *parts, details(
        "As a table", table("Error against robot time", made.header, made.rows)), name="pareto")


def objects_section(paired: Paired, metric: str) -> str:
    """Medians by object, and the whole table folded away."""
    medians = np.array([[np.median(values[:, n]) for values in paired.values[metric]]
                        for n in range(len(paired.labels))])
    tints = _heat(medians)
    rows = [(label, *(f"{v:.2f}" if np.isfinite(v) else "NA" for v in row))
            for label, row in zip(paired.labels, medians, strict=True)]
    full = objects_table(paired, metric)
    return section("Object by object", table(
        f"Median {UNITS[metric]} over episodes; darker is worse",
        ("strategy", *paired.objects), rows, heat=[("", *row) for row in tints]),
        details("With intervals and costs", table(
            f"Medians with 95 % intervals; {', '.join(ALSO)} are means", full.header, full.rows,
            row_names=1)), name="objects")


def pairs_section(paired: Paired, metric: str) -> str:
    """Each entry against the best, if there is one."""
    if len(paired.labels) < 2 or not np.isfinite(paired.means[metric][0]).any():
        return ""
    made = pairs_table(paired, metric, "best")
    return section("Is the difference real?", paragraph(
        "p_objects (Wilcoxon's signed-rank test over objects) speaks of other objects, p_episodes "
        "(a t-test within objects) of these; _holm is corrected for the number of comparisons."),
        table("Each strategy against the best", made.header, made.rows),
        *(paragraph(note) for note in made.notes if note not in paired.notes), name="pairs")


def confusion_section(found: Confusion) -> str:
    """A matrix for each entry that names what it felt."""
    if not found.labels:
        return ""
    parts = []
    for n, label in enumerate(found.labels):
        counts = np.array([[found.counts[label, body][answer] for answer in found.answers]
                           for body in found.objects], float)
        share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        rows = [(body, *(f"{100 * v:.0f}" if v else "" for v in row))
                for body, row in zip(found.objects, share, strict=True)]
        tints = [("", *(f"heat{min(4, int(5 * v))}" if v else "" for v in row)) for row in share]
        right = np.mean([row[found.answers.index(body)]
                         for body, row in zip(found.objects, share, strict=True)])
        parts.append(details(f"{label}: {100 * right:.1f} % right", table(
            "Rows: the object felt; columns: what it was taken for [% of episodes]",
            ("object", *found.answers), rows, heat=tints, sortable=False), opened=n == 0))
    return section("Recognition", *parts, name="recognition")


def settings_section(plan: Plan, stores: Sequence[Store], metric: str) -> str:
    """What each swept factor does."""
    if not plan.study.axes:
        return ""
    from sweeps.analysis.settings import read_settings, settings_table

    made = settings_table(plan, read_settings(plan, stores, metric), metric)
    return section("Swept factors", paragraph(
        "spread is the largest level mean minus the smallest, with the interval of that "
        "difference; share is the factor's part of the "
        "variance between settings."), table("Means by level", made.header, made.rows),
        name="settings")


def views_section(plan: Plan, shown: Views) -> str:
    """One canvas, and a button for each episode."""
    if not shown.episodes:
        return ""
    boxes = "".join(
        f'<label><input type="checkbox" id="show-{name}" checked> {text}</label>'
        for name, text in (("recovered", "recovered body"), ("true", "true body, as wires"),
                           ("contacts", "contacts")))
    rows = []
    for strategy in plan.study.strategies:
        cells = []
        for place in PLACES:
            number = next((n for n, episode in enumerate(shown.episodes)
                           if (episode["strategy"], episode["place"]) == (strategy.name, place)),
                          None)
            if number is None:
                cells.append("<td></td>")
                continue
            episode = shown.episodes[number]
            cells.append(
                f'<td><button type="button" data-episode="{number}" '
                f'aria-pressed="{"true" if number == 0 else "false"}">'
                f'{escape(episode["object"])} {episode["chamfer_mm"]:.1f} mm</button></td>')
        rows.append(f'<tr><th scope="row">{escape(strategy.name)}</th>{"".join(cells)}</tr>')
    head = "".join(f'<th scope="col">{name}</th>' for name in ("strategy", *PLACES))
    return section(
        "Best, median and worst episodes", paragraph(
            "Drag, or the arrow keys, turn the view; plus and minus zoom."),
        f'<div class="stage"><div><canvas id="stage" tabindex="0" role="img"></canvas>'
        f'<p id="about" class="soft" aria-live="polite"></p><div class="controls">{boxes}</div>'
        f'</div><div class="episodes"><table><thead><tr>{head}</tr></thead><tbody>'
        f'{"".join(rows)}</tbody></table></div></div>', name="episodes-shown")


def spec_section(spec: str, plan: Plan) -> str:
    """What was asked."""
    given = preformatted(spec) if spec else paragraph("spec.toml is not there.")
    filled = preformatted(json.dumps(plan.resolved, indent=1, ensure_ascii=False))
    return section("What was asked", details("The spec, as given", given, opened=True),
                   details(f"With every default filled in (hash {plan.hash})", filled),
                   name="spec")


def reproduce_section(plan: Plan, environment: Mapping[str, Any]) -> str:
    """Where it was made, and how to make it again."""
    rows = [(str(key), str(value)) for key, value in environment.items()]
    commands = ("warpgrasp sweep spec.toml -o DIR\nwarpgrasp leaderboard DIR -o leaderboard.csv\n"
                "warpgrasp report DIR -o report.html")
    return section("Environment, and how to reproduce", paragraph(
        f"The spec above gives study {plan.hash}; in the same environment the same bytes."),
        preformatted(commands), table("Environment", ("what", "value"), rows, sortable=False),
        name="reproduce")


def _top(*found: Estimate) -> float:
    """The largest number of all, with its interval if it has one; 1 where there is none."""
    numbers = np.concatenate([part for f in found for part in (f.value, f.high)])
    return float(numbers[np.isfinite(numbers)].max(initial=0.0)) or 1.0


def _heat(values: np.ndarray) -> list[list[str]]:
    """Five tints from the best to the worst of each column."""
    low, high = np.fmin.reduce(values, axis=0), np.fmax.reduce(values, axis=0)
    share = (values - low) / np.where(high > low, high - low, 1.0)
    return [[f"heat{min(4, int(5 * v))}" if np.isfinite(v) else "" for v in row] for row in share]


def _number(text: str) -> float:
    return float("nan") if text == "NA" else float(text)
