"""The command `paper`: experiments of Allen and Michelman (1990) beside their printed results."""

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from sweeps.output import init_warp, write_atomic
from sweeps.paper.bottles import BOTTLES_HEADER, Followed, bottle_rows, follow_bottles
from sweeps.paper.faces import (
    FACES_HEADER,
    PRINTED_DEG,
    Case,
    Explored,
    explore_faces,
    face_rows,
    typical_sizes,
)
from sweeps.paper.recovery import RECOVERY_HEADER, Recovered, recover_objects, recovery_rows
from sweeps.spec.errors import StoreError
from sweeps.text_table import TextTable


@dataclass(frozen=True)
class Sizes:
    """Numbers of episodes and worlds; the defaults are those of the documents."""

    episodes: int = 16
    worlds: int = 64
    bottles: int = 24
    cases: tuple[Case, ...] | None = None


def paper(folder: Path, sizes: Sizes | None = None) -> int:
    """Runs the three experiments; writes tables, figures and `paper.md` into `folder`."""
    sizes = sizes or Sizes()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror}") from None
    with ProcessPoolExecutor(2, get_context("spawn"), initializer=_use_one_thread) as pool:
        recovery = pool.submit(recover_objects, sizes.episodes)
        others = pool.submit(_touch_procedures, sizes)
        faces, bottles = others.result()
        recovered = recovery.result()
    files = documents(recovered, faces, bottles)
    for name, content in files.items():
        write_atomic(folder / name, content)
        print(folder / name)
    seconds = np.nanmedian([r.seconds_a_fit for r in recovered])
    print(f"time: 20 iterations of one fit took {1e3 * seconds:.1f} ms of one core here "
          "(printed: about 10 s on a Sun-4)", file=sys.stderr)
    return 0


def _use_one_thread() -> None:
    from warpgrasp.core.kernel_launch import set_thread_count

    init_warp()
    set_thread_count(1)


def _touch_procedures(sizes: Sizes) -> tuple[list[Explored], list[Followed]]:
    chosen = list(sizes.cases) if sizes.cases is not None else None
    return explore_faces(sizes.worlds, chosen), follow_bottles(sizes.bottles)


def documents(
    recovered: Sequence[Recovered], faces: Sequence[Explored], bottles: Sequence[Followed]
) -> dict[str, bytes]:
    """The content of every file, by name."""
    from sweeps.paper.figures import draw_bottles, draw_faces, draw_recovered

    tables = {"recovery": TextTable(RECOVERY_HEADER, tuple(recovery_rows(list(recovered)))),
              "faces": TextTable(FACES_HEADER, tuple(face_rows(list(faces)))),
              "bottles": TextTable(BOTTLES_HEADER, tuple(bottle_rows(list(bottles))))}
    files = {f"{name}.csv": table.csv() for name, table in tables.items()}
    files["figure4.png"] = draw_recovered(recovered)
    poor = max(faces, key=lambda e: (e.case.source.startswith("mount slips"), e.case.number))
    files["figure5.png"] = draw_faces(faces[0], poor)
    files["figure6.png"] = draw_bottles(bottles)
    files["paper.md"] = _text(tables, recovered, faces, bottles).encode()
    return files


def _table(table: TextTable) -> list[str]:
    head, *rows = ("| " + " | ".join(row) + " |" for row in (table.header, *table.rows))
    return [head, "|" + "---|" * len(table.header), *rows]


def _text(tables: dict[str, TextTable], recovered: Sequence[Recovered],
          faces: Sequence[Explored], bottles: Sequence[Followed]) -> str:
    angle = faces[0].angle_deg
    percent = 100.0 * float((angle < PRINTED_DEG).mean())
    spread = float(np.std(angle))
    plain = [r for r in recovered if r.way == "as the paper"]
    iterations = np.concatenate([r.iterations[np.isfinite(r.iterations)] for r in plain])
    contacts = np.concatenate([r.block.exploration.belief.evidence.mask.sum(1) for r in plain])
    ended = np.concatenate([f.ended for f in bottles])
    sized = np.concatenate([f.by_volume[f.ended] == f.name for f in bottles])
    lines = [
        "<!-- written by `warpgrasp paper`; do not edit: `make paper-docs` -->", "",
        "# The paper's experiments, side by side", "",
        "Allen and Michelman, \"Acquisition and interpretation of 3-D sensor data from touch\" "
        "(1990). Its printed values are compared with; nothing is tuned to them.", "",
        "| experiment | printed | here |", "|---|---|---|",
        f"| contacts for a body | 30 to 100 | {np.quantile(contacts, 0.1):.0f} to "
        f"{np.quantile(contacts, 0.9):.0f} (10 to 90 %), median {np.median(contacts):.0f} |",
        f"| iterations to convergence | 10 to 15 | median {np.median(iterations):.0f}, quartiles "
        f"{np.quantile(iterations, 0.25):.0f} to {np.quantile(iterations, 0.75):.0f} |",
        "| time of a fit | about 10 s for 20 iterations of 60 points (Sun-4) | printed by the "
        "command: it differs from machine to machine |",
        f"| angle of two adjacent faces | 96 deg, truth taken as 90 | median "
        f"{np.median(angle):.2f} deg, standard deviation {spread:.2f} |",
        f"| four bottles | told apart by size and volume | {100 * sized.mean():.0f} % right of "
        f"{100 * ended.mean():.0f} % followed to the end |", "",
        "## Six objects from grasps (figure 4)", "", "![Recovered bodies](figure4.png)", "",
        "Both rows use the same grasps: `rim6-ring12`, 18 hand poses. *As the paper*: fingertips "
        "as contacts, Solina's residual, nothing else. *Ours*: contacts placed on the links by "
        "joint torques, table, free space, weights. Iterations are those of a plain fit "
        "(13 parameters) to the respective contacts until its cost is within 1 % of its last.", "",
        *_table(tables["recovery"]), "",
        "Differences. The paper shows its bodies without a score, so recovery cannot be compared "
        "in numbers. The fingertip estimate puts a contact on the wrong link whenever a middle "
        "link touched first; that, not the fit, limits the first rows. No superquadric has the "
        "shape of a funnel or a lightbulb. Our fits take more than 10 to 15 iterations where a "
        "body with edges is approached through rounder ones: the cost still decreases after the "
        "shape looks converged, for a number of iterations that depends on the noise of the "
        "contacts.", "",
        "## Two faces of a block (figure 5)", "", "![Two faces](figure5.png)", "",
        *_table(tables["faces"]), "",
        f"The printed 96 degrees lie at the {percent:.0f}th percentile of our default: "
        f"{(PRINTED_DEG - 90.0) / max(spread, 1e-9):.0f} standard deviations out. What would make "
        "an error of 6 degrees typical (the median), each source alone:", "",
        *_table(TextTable(("source", "size"), tuple(typical_sizes(list(faces))))), "",
        "A turned mount turns both planes alike, which cancels in the angle, and the noise of pads "
        "and of coarser guarded steps averages out over a trace; none of them explains 96. Three "
        "sources make 6 degrees typical, or nearly so: few touches on a face (one step each way "
        "from the first touch), an arm that repeats no better than one to two millimetres "
        "(touches then fall beyond edges, and some planes are not those of the face), or a hand "
        "that shifts in its mount by some 10 degrees between the faces. Short traces are the most "
        "likely source, since they need no faulty sensor.", "",
        "## Four bottles (figure 6)", "", "![Bottles](figure6.png)", "",
        *_table(tables["bottles"]), "",
        "True sizes are those of `warpgrasp/objects/profiles`, which gives their sources.", "",
    ]
    return "\n".join(lines)
