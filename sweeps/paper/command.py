"""The command `paper`: experiments of Allen and Michelman (1990) beside their printed results."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from sweeps.output import init_warp, note, write_atomic
from sweeps.paper.bottles import BOTTLES_HEADER, bottle_rows, follow_bottles
from sweeps.paper.faces import FACES_HEADER, Case, explore_faces, face_rows
from sweeps.paper.page import Run, page
from sweeps.paper.recovery import RECOVERY_HEADER, recover_objects, recovery_rows
from sweeps.paper.stereo import STEREO_HEADER, see_objects, stereo_rows
from sweeps.result_file import make_folder
from sweeps.text_table import TextTable


@dataclass(frozen=True)
class Sizes:
    """Numbers of episodes and worlds; the defaults are those of the documents."""

    episodes: int = 16
    worlds: int = 64
    bottles: int = 24
    views: int = 16
    cases: tuple[Case, ...] | None = None


def paper(folder: Path, sizes: Sizes | None = None) -> int:
    """Runs the experiments; writes tables, figures and `paper.md` into `folder`."""
    sizes = sizes or Sizes()
    make_folder(folder)
    chosen = list(sizes.cases) if sizes.cases is not None else None
    with ProcessPoolExecutor(2, get_context("spawn"), initializer=_use_one_thread) as pool:
        recovery = pool.submit(recover_objects, sizes.episodes)
        faces = pool.submit(explore_faces, sizes.worlds, chosen)
        stereo = pool.submit(see_objects, sizes.views)
        bottles = pool.submit(follow_bottles, sizes.bottles)
        run = Run(recovery.result(), faces.result(), bottles.result(), stereo.result())
    for name, content in documents(run).items():
        write_atomic(folder / name, content)
        print(folder / name)
    seconds = np.nanmedian([r.seconds_a_fit for g in run.recovered for r in g.ways])
    note(f"time: 20 iterations of one fit took {1e3 * seconds:.1f} ms of one core here "
         "(printed: about 10 s on a Sun-4)")
    return 0


def _use_one_thread() -> None:
    from warpgrasp.core.kernel_launch import set_thread_count

    init_warp()
    set_thread_count(1)


def documents(run: Run) -> dict[str, bytes]:
    """The content of every file, by name."""
    from sweeps.paper.figures import draw_bottles, draw_faces, draw_recovered

    tables = {"recovery": TextTable(RECOVERY_HEADER, tuple(recovery_rows(run.recovered))),
              "faces": TextTable(FACES_HEADER, tuple(face_rows(run.faces))),
              "bottles": TextTable(BOTTLES_HEADER, tuple(bottle_rows(run.bottles))),
              "stereo": TextTable(STEREO_HEADER, tuple(stereo_rows(run.stereo)))}
    files = {f"{name}.csv": table.csv() for name, table in tables.items()}
    files["figure4.png"] = draw_recovered(run.recovered)
    poor = max(run.faces, key=lambda e: (e.case.source.startswith("mount slips"), e.case.number))
    files["figure5.png"] = draw_faces(run.faces[0], poor)
    files["figure6.png"] = draw_bottles(run.bottles)
    files["paper.md"] = page(run).encode()
    return files
