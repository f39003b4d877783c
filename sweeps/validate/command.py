"""The command `validate`: the simulator beside independent engines, as one table."""

import csv
import io
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path

from sweeps.output import extra_hint, init_warp, note, quiet_stdout, say
from sweeps.result_file import make_folder, write_result
from sweeps.spec.errors import StoreError, choose
from sweeps.text_table import print_table
from sweeps.validate.comparison import HEADER, Comparison, MissingEngine

CHECKS = {"puma": "puma", "arms": "serial_arms", "distances": "signed_distances", "pads": "pads",
          "metrics": "bodies.scores", "fits": "fits", "free_forms": "bodies.free_forms",
          "hands": "any_hand", "closing": "guarded_closing"}
"""Names and their files here, each with a function `compare_NAME`; the longest check is last."""


def validate(only: Sequence[str], out: Path | None, *, poses: int, workers: int,
             hands: Sequence[str], as_json: bool) -> int:
    """Run the checks, print the table, write it to `out`; 1 where a difference breaks its bound."""
    for name in only:
        if name not in CHECKS:
            raise StoreError(f"--only: no check {name!r}; {choose(name, CHECKS)}")
    if out is not None:
        make_folder(out)
    rows: list[Comparison] = []
    missing = False
    with quiet_stdout():
        init_warp()
        for name in only or CHECKS:
            note(f"{name} ...")
            try:
                rows += _compare(name, poses, workers, hands)()
            except (MissingEngine, ModuleNotFoundError) as error:
                missing = True
                say(f"{name}: left out: {error}; `make validate` installs what it needs, "
                    f"or {extra_hint('validate')}")
    if out is not None:
        write_result(out / "validate.csv", csv_of(rows))
        write_result(out / "validate.md", markdown_of(rows))
    print_table(HEADER, [row.cells() for row in rows], as_json)
    broken = [row for row in rows if not row.ok]
    (say if broken else note)(
        f"{len(rows)} comparisons, {len(broken)} beyond their bound")
    return 1 if broken or missing else 0


def _compare(name: str, poses: int, workers: int, hands: Sequence[str]
             ) -> Callable[[], list[Comparison]]:
    module = import_module(f"sweeps.validate.{CHECKS[name]}")
    function = getattr(module, f"compare_{name}")
    if name == "hands":
        return partial(function, poses, workers, hands or module.HANDS)
    return partial(function, poses, workers) if name == "closing" else function


def csv_of(rows: Sequence[Comparison]) -> bytes:
    """The table as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEADER, *(row.cells() for row in rows)])
    return text.getvalue().encode()


def markdown_of(rows: Sequence[Comparison]) -> bytes:
    """The table as Markdown, a section a check."""
    lines = ["<!-- written by `warpgrasp validate -o docs/fidelity`; do not edit -->", "",
             "# Every comparison"]
    for check in dict.fromkeys(row.check for row in rows):
        lines += ["", f"## {check}", "",
                  "| what | unit | ours | theirs | difference | bound | ok | note |",
                  "|---|---|---|---|---|---|---|---|"]
        lines += ["| " + " | ".join(row.cells()[1:]) + " |" for row in rows if row.check == check]
    return ("\n".join(lines) + "\n").encode()
