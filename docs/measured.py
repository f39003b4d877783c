"""Every measured figure of README and docs, from the files that commands write.

    python docs/measured.py          # or `make figures`

collects those files into `docs/figures.json`, one value a key, and fills the pages from it. In a
page a figure stands between comments that neither a code host nor Sphinx shows,

    <!--=bench.fits.plane.512.2.per_s ,.0f-->4,451<!--=-->

with the key and a format of Python's. A `*` in the key stands for any part: the page then says
from the least to the greatest value. A whole table stands between

    <!--table studies.waypoints chamfer_mm:.2f iou:.2f-->
    <!--end-->

with a row for each entry of a study, and the columns named; between `<!--scores-->` and
`<!--end-->` stand the largest differences of scores from a dense computation. Sources:

| keys | file | written by |
|---|---|---|
| `bench.ROW.OF.BATCH.THREADS.COLUMN` | `bench.jsonl` | `warpgrasp bench --peers` |
| `gpu.ROW.OF.BATCH.CORES.DEVICE.COLUMN` | `bench_gpu.jsonl` | `warpgrasp bench --device cuda:0` |
| `paper.TABLE.ROW.COLUMN` | `paper/TABLE.csv` | `warpgrasp paper` |
| `validate.CHECK.WHAT.COLUMN` | `fidelity/validate.csv` | `warpgrasp validate` |
| `studies.NAME.ENTRY.COLUMN` | `studies/NAME.csv` | `make studies-docs` |
"""

import csv
import json
import re
import sys
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from sweeps.bench import bench_table

DOCS = Path(__file__).parent
FIGURES = DOCS / "figures.json"
ERRORS = DOCS / "fidelity" / "errors.md"
FIGURE = re.compile(r"<!--=(\S+) (\S+?)-->(.*?)<!--=-->", re.DOTALL)
TABLE = re.compile(r"(<!--table studies\.(\S+) ([^>]*?)-->\n)(.*?)(<!--end-->)", re.DOTALL)
SCORES = re.compile(r"(<!--scores-->\n)(.*?)(<!--end-->)", re.DOTALL)
SCORE_ROW = re.compile(r"(.+?)( as scanned)?: (.+), (standard|dense) samples, worst of")
NAMED_BY = {"recovery": ("object", "contacts", "fit"), "faces": ("source", "size"),
            "bottles": ("bottle", "contour"), "stereo": ("switched_on",)}
"""Columns that name a row of the paper's tables."""


def pages() -> list[Path]:
    """README and the pages that are written by hand."""
    generated = {"paper", "fidelity", "api"}
    return [DOCS.parent / "README.md", *sorted(
        page for page in DOCS.rglob("*.md") if page.name != "speed_table.md"
        and not generated & set(page.relative_to(DOCS).parts[:-1]))]


def collect() -> dict[str, float]:
    """The value of every key."""
    return dict(sorted((key, value) for source in (_bench, _gpu, _paper, _validate, _studies)
                       for key, value in source()))


def _numbers(prefix: str, row: dict[str, str]) -> Iterator[tuple[str, float]]:
    for column, text in row.items():
        try:
            yield f"{prefix}.{column}".replace(" ", "_"), float(text)
        except (TypeError, ValueError):
            continue  # a word, or a missing value


def _rows(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def _lines(name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (DOCS / name).read_text().splitlines()]


def _bench() -> Iterator[tuple[str, float]]:
    for line in _lines("bench.jsonl"):
        name = ".".join(str(line[key]) for key in ("row", "of", "batch", "threads") if key in line)
        yield from _numbers(f"bench.{name}", {
            key: value for key, value in line.items() if key not in ("batch", "threads")})


def _gpu() -> Iterator[tuple[str, float]]:
    for line in _lines("bench_gpu.jsonl"):
        parts = ("row", "of", "batch", "threads", "device")
        name = ".".join(str(line[key]) for key in parts if key in line)
        yield from _numbers(f"gpu.{name}", {
            key: value for key, value in line.items() if key not in parts})


def _paper() -> Iterator[tuple[str, float]]:
    for table, columns in NAMED_BY.items():
        for row in _rows(DOCS / "paper" / f"{table}.csv"):
            yield from _numbers(f"paper.{table}." + ".".join(row[c] or "-" for c in columns), row)


def _validate() -> Iterator[tuple[str, float]]:
    for row in _rows(DOCS / "fidelity" / "validate.csv"):
        yield from _numbers(f"validate.{row['check']}.{row['what']}", row)


def _studies() -> Iterator[tuple[str, float]]:
    for file in sorted((DOCS / "studies").glob("*.csv")):
        for row in _rows(file):
            yield from _numbers(f"studies.{file.stem}.{row['strategy']}", row)


def filled(text: str, figures: dict[str, float]) -> str:
    """A page with every marked figure and table as it is in `figures`. Raises KeyError."""
    text = FIGURE.sub(lambda found: (f"<!--={found[1]} {found[2]}-->"
                                     f"{_written(found[1], found[2], figures)}<!--=-->"), text)
    text = SCORES.sub(lambda found: f"{found[1]}{_scores()}{found[3]}", text)
    return TABLE.sub(lambda found: f"{found[1]}{_table(found[2], found[3].split())}{found[5]}",
                     text)


def _scores() -> str:
    """By how much scores of single bodies differ from a dense computation, at most."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for row in _rows(DOCS / "fidelity" / "validate.csv"):
        if match := SCORE_ROW.match(row["what"]):
            body, scan, score, samples = match.groups()
            worst = re.match(r"worst ([\d.]+)%", row["note"])
            if worst:
                found.setdefault((f"{body}{', the scan itself' if scan else ''}", samples), {})[
                    score] = f"{worst[1]} %" if float(worst[1]) else "< 0.1 %"
    scores = ("chamfer", "iou", "volume ratio", "hausdorff95")
    lines = ["| object | samples | `chamfer_mm` | `iou` | `volume_ratio` | `hausdorff95_mm` |",
             "|---" * 6 + "|"]
    lines += [f"| {body.replace('_', ' ')} | {samples} | "
              + " | ".join(cells.get(score, "") for score in scores) + " |"
              for (body, samples), cells in found.items()]
    return "\n".join(lines) + "\n"


def _written(key: str, form: str, figures: dict[str, float]) -> str:
    if "*" not in key:
        return format(figures[key], form)
    values = [value for name, value in figures.items() if fnmatchcase(name, key)]
    if not values:
        raise KeyError(key)
    least, most = format(min(values), form), format(max(values), form)
    return least if least == most else f"{least} to {most}"


def _table(study: str, columns: list[str]) -> str:
    """Rows of a study's leaderboard in its order; NAME:FORMAT, or NAME alone as it is."""
    names = [column.partition(":")[::2] for column in columns]
    lines = ["| strategy | " + " | ".join(name for name, _ in names) + " |",
             "|---" * (len(names) + 1) + "|"]
    for row in _rows(DOCS / "studies" / f"{study}.csv"):
        cells = [format(float(row[name]), form) if form and row[name] != "NA" else row[name]
                 for name, form in names]
        lines.append(f"| {row['strategy']} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def errors_page(rows: list[dict[str, str]]) -> str:
    """The table of `errors.csv` as a page."""
    header = list(rows[0])
    lines = ["| " + " | ".join(header) + " |", "|---" * len(header) + "|",
             *("| " + " | ".join(row.values()) + " |" for row in rows)]
    return ("<!-- written by `make errors-docs`; do not edit -->\n\n"
            "# Every strategy with errors of calibration, and without\n\n" + "\n".join(lines)
            + "\n")


def main() -> int:
    """Writes `figures.json` and the pages."""
    figures = collect()
    FIGURES.write_text(json.dumps(figures, indent=0) + "\n")
    (DOCS / "speed_table.md").write_text(
        "<!-- written by `make figures` from bench.jsonl and bench_gpu.jsonl; do not edit -->\n\n"
        "# Every row of the benchmark\n\n" + bench_table.markdown(_lines("bench.jsonl"))
        + "\n## On a GPU\n\n" + bench_table.markdown(_lines("bench_gpu.jsonl")))
    if ERRORS.with_suffix(".csv").exists():
        ERRORS.write_text(errors_page(_rows(ERRORS.with_suffix(".csv"))))
    for page in pages():
        text = page.read_text()
        try:
            new = filled(text, figures)
        except KeyError as error:
            print(f"{page}: no figure {error}", file=sys.stderr)
            return 1
        if new != text:
            page.write_text(new)
            print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
