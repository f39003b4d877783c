"""The commands that read a study: tables, figures, the report, a replay of an episode."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sweeps.cli.app import (
    Folders,
    Json,
    UsageError,
    app,
    count_of,
    device_of,
    folders_and_kind,
    port_of,
    refuse_idle,
)

TableKind = Literal["pairs", "objects", "beside", "confusion", "curves", "reach", "same-time",
                    "pareto", "settings"]
FigureKind = Literal["forest", "curves-touches", "curves-time", "pareto", "confusion", "settings",
                     "levels", "contacts", "faces", "contour", "taxels", "grasp"]
Over = Literal["like-these", "these"]
"""Kinds, repeated here so that help and completion import neither tables nor figures."""
METRIC = "chamfer_mm"
"""What is compared where no other score is named."""


@app.command
def table(words: Annotated[list[TableKind | str], Parameter(name="DIR... KIND")], /, *,
          out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
          metric: str | None = None, against: str | None = None, over: Over | None = None,
          json: Json = False) -> int:
    """Print a table of a study: paired tests, medians, recognition, curves, settings.

    Parameters
    ----------
    words
        The directories of a study, then one of pairs (paired tests), objects
        (medians on each), beside (means on each, settings side by side), confusion
        (recognition), curves (error against touches and robot time), reach (touches and
        seconds to 5 mm and 3 mm), same-time (errors when the strategy of --against ended),
        pareto (error against robot time), settings (what each swept factor does).
    out
        Also write it, as CSV.
    metric
        Of pairs, objects, pareto and settings; chamfer_mm if not given.
    against
        For pairs and same-time: compare with one strategy only; best is the leaderboard's first.
    over
        What intervals are of: like-these (other objects like these, the default where there are
        several) or these (these objects, with other episodes). The table pairs has both; those of
        objects are of each by itself.
    json
        Print JSON.
    """
    from sweeps.analysis import tables

    folders, kind = folders_and_kind(words, tables.KINDS)
    refuse_idle(kind, {
        "--metric": (metric, ("pairs", "objects", "pareto", "settings")),
        "--against": (against, ("pairs", "same-time")),
        "--over": (over, [name for name in tables.KINDS
                          if name not in ("pairs", "objects", "beside", "confusion")])})
    return tables.table(folders, kind, out, metric=metric or METRIC, against=against, over=over,
                        as_json=json)


@app.command
def rows(folders: Folders, /, *,
         out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
         contacts: Annotated[bool, Parameter(negative="")] = False,
         curves: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Write all episodes of a study as one flat table, for pandas, DuckDB, R, a spreadsheet.

    Parameters
    ----------
    folders
        The directory of a study, or several that hold parts (shards) of one.
    out
        The file to write; its ending, .parquet or .csv, names the format.
    contacts
        A row a guarded move of an episode (of pads, each that felt something), instead of a row an
        episode: where the spec has keep = "contacts".
    curves
        A row a fit of an episode: its touches, robot time and scores until then.
    """
    if out is None or out.suffix.lower() not in (".parquet", ".csv"):
        raise UsageError("rows: -o should name a file that ends in .parquet or .csv, such as "
                         "-o rows.parquet")
    if contacts and curves:
        raise UsageError("rows: --contacts and --curves are two tables; ask for one at a time")
    from sweeps.analysis.arrow import write_rows
    from sweeps.output import note
    from sweeps.result_file import check_result
    from sweeps.spec.errors import StoreError

    check_result(out)
    what = "contacts" if contacts else "curves" if curves else "episodes"
    try:
        count, notes = write_rows(folders, out, what)
    except OSError as error:
        raise StoreError(f"{out}: cannot be written: {error.strerror or error}") from None
    for line in (f"{out}: {count} rows", *notes):
        note(line)
    return 0


@app.command
def compare(one: Annotated[Path, Parameter(name="A")], other: Annotated[Path, Parameter(name="B")],
            /, *, metric: str | None = None, over: Over | None = None,
            out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
            json: Json = False) -> int:
    """Compare two studies: what changed in their specs, and what that did to what they share.

    Parameters
    ----------
    one
        The directory of a study, or a spec: then only specs are compared.
    other
        The other one; differences are B minus A.
    metric
        What to compare; chamfer_mm if not given.
    over
        What intervals are of: objects like-these (the default where there are several), or these
        objects with other episodes.
    out
        Also write the table, as CSV.
    json
        Print JSON.
    """
    from sweeps.compare.command import compare as compare_studies

    return compare_studies(one, other, out, metric=metric, over=over, as_json=json)


@app.command
def figure(words: Annotated[list[FigureKind | str], Parameter(name="DIR... KIND")], /, *,
           out: Annotated[Path, Parameter(name=["--out", "-o"])],
           metric: str | None = None, strategy: str | None = None,
           object_: Annotated[str | None, Parameter(name="--object")] = None,
           episode: int | None = None, over: Over | None = None) -> int:
    """Draw a figure of a study, one column wide: SVG, PDF or PNG. Contacts also as CSV.

    Parameters
    ----------
    words
        The directories of a study, then one of forest (the leaderboard),
        curves-touches, curves-time (error as it falls), pareto (error and robot time),
        confusion (recognition), settings (swept factors, as a heat map), levels (error against
        each swept factor, with intervals); of one episode, run again: contacts (over the recovered
        body; with -o FILE.csv as numbers, beside the true places), faces (traces and planes),
        contour (the solid of revolution), taxels (images of pads, with their moments), grasp (the
        hand on the object).
    out
        The file; its ending, .svg, .pdf or .png (for contacts also .csv), names the format.
    metric
        Of forest, pareto, settings and levels; chamfer_mm if not given.
    strategy
        For confusion and the figures of one episode; by default the best. An entry's name in
        the leaderboard names the setting too ("ring6 [sensors.tendon_threshold_N=3]").
    object_
        For those of one episode; by default the first.
    episode
        For those: which episode of that strategy and object; 0 if not given.
    over
        For curves, pareto and levels: intervals of objects like-these, or of these with other
        episodes. The forest has both.
    """
    from sweeps.figures import kinds as figures

    folders, kind = folders_and_kind(words, figures.KINDS)
    refuse_idle(kind, {
        "--metric": (metric, ("forest", "pareto", "settings", "levels")),
        "--strategy": (strategy, ("confusion", *figures.OF_EPISODE)),
        "--object": (object_, figures.OF_EPISODE), "--episode": (episode, figures.OF_EPISODE),
        "--over": (over, ("forest", "curves-touches", "curves-time", "pareto", "levels"))})
    return figures.figure(folders, kind, out, metric=metric or METRIC, strategy=strategy,
                          object_=object_, episode=episode or 0, over=over)


@app.command
def report(folders: Folders, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
           views: bool = True, workers: int | None = None, device: str | None = None) -> int:
    """Write a study as one HTML file that needs no network.

    Parameters
    ----------
    folders
        The directory of a study, or several that hold parts (shards) of one.
    out
        The HTML file.
    views
        Run the best, median and worst episode of each strategy again, for their 3-D views.
    workers
        Cores to use for that, one process each; 1 if not given.
    device
        For that: cpu, if not given, or cuda:0.
    """
    from sweeps.report import page as report

    for name, value in (("--workers", workers), ("--device", device)):
        if value is not None and not views:
            raise UsageError(f"{name}: is for views; leave it or --no-views out")
    return report.report(folders, out, views=views, device=device_of(device or "cpu"),
                         workers=count_of(1 if workers is None else workers, "--workers"))


@app.command
def show(folders: Folders, /, *, episode: int = 0, strategy: str | None = None,
         object_: Annotated[str | None, Parameter(name="--object")] = None,
         out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
         live: Annotated[bool, Parameter(negative="")] = False, port: int | None = None,
         device: str = "cpu") -> int:
    """Replay an episode: arm, hand, object, contacts, and the recovered shape.

    Parameters
    ----------
    folders
        The directory of a study, or several that hold parts (shards) of one.
    episode
        Which episode of the strategy and object, from 0.
    strategy
        Whose; by default the leaderboard's first. An entry's name there includes the setting
        ("ring6 [sensors.tendon_threshold_N=3]").
    object_
        On what; by default the study's first.
    out
        An HTML file to write, which needs no network.
    live
        Serve it on this machine alone (127.0.0.1) until Ctrl-C.
    port
        For --live; 8080 if not given.
    device
        cpu, or cuda:0.
    """
    from sweeps.report import replay

    if out is None and not live:
        raise UsageError("show: no output given; use -o FILE.html or --live")
    if port is not None and not live:
        raise UsageError("--port: is for --live")
    return replay.show(folders, out, strategy=strategy, body=object_, episode=episode,
                       live=live, port=port_of(8080 if port is None else port),
                       device=device_of(device))
