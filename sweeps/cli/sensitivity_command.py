"""The command `sensitivity`: runs the study of `analysis.sensitivity` and prints its table."""

import csv
import io
import sys
from contextlib import redirect_stdout
from pathlib import Path

from sweeps.analysis.sensitivity import (
    EPISODES,
    HEADER,
    check_study,
    sensitivity_spec,
    sensitivity_table,
)
from sweeps.analysis.text_table import print_table
from sweeps.cli import commands
from sweeps.output import write_atomic
from sweeps.run.local_engine import UNIT_TIMEOUT_S
from sweeps.run.plan import plan_study
from sweeps.run.store import Store
from sweeps.spec.errors import StoreError
from sweeps.spec.reader import read_spec


def sensitivity(
    folder: Path, *, episodes: int | None, workers: int, spec: Path | None, as_json: bool
) -> int:
    """Run what is left of the study (or of `spec`, one of its kind), write and print the table.

    `episodes` stand before those of the spec. Raises SpecError for a spec of another kind.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = spec
        if file is None:
            file = folder / "sensitivity.toml"
            write_atomic(file, sensitivity_spec(episodes=episodes or EPISODES).encode())
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror or error}") from None
    settings = [] if episodes is None else [f"episodes_per_cell={episodes}"]
    plan = plan_study(read_spec(file, settings))
    check_study(plan, file)
    with redirect_stdout(io.StringIO()):  # a leaderboard of every setting would drown the table
        code = commands.sweep(file, folder, workers=workers, shard=(1, 1), device="cpu",
                              settings=settings, as_json=False, unit_timeout_s=UNIT_TIMEOUT_S)
    rows, notes = sensitivity_table(plan, Store(folder))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEADER, *rows])
    write_atomic(folder / "sensitivity.csv", text.getvalue().encode())
    table = [HEADER, ("---",) * len(HEADER), *rows]
    lines = ["<!-- written by `warpgrasp sensitivity`; do not edit -->", "",
             "# Each constant over its bracket", "",
             *("| " + " | ".join(row) + " |" for row in table), "", *(f"- {n}" for n in notes), ""]
    write_atomic(folder / "sensitivity.md", "\n".join(lines).encode())
    print_table(HEADER, rows, as_json)
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
    return code
