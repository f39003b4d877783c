"""Flips random bits in every kind of file that is kept between runs, and looks for wrong rows.

    python tests/scripts/hostile/flip_bits.py --flips 10000 --sweeps 20

Each flip is undone before the next. A flipped file must read as damaged, or as what was written
before; of the flips some are followed by a whole sweep in fresh processes, whose rows must be those
of the sweep before. Fails with a line for each that was not.
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import warp as wp

from sweeps.run.store import Store, open_study
from sweeps.run.unit_file import DamagedUnit, content_hash, read_unit
from sweeps.spec.errors import StoreError
from warpgrasp.core.cache_file import read_cached
from warpgrasp.core.kernel_cache import check_kernels

SPEC = """\
schema = 1
seed = 5
episodes_per_cell = 6
keep = "contacts"
objects = ["block", {{ mesh = "{mesh}", units = "m", name = "box" }}]
[[strategy]]
name = "ring6"
"""


def make_study(folder: Path) -> Path:
    """A spec with a mesh."""
    import trimesh

    mesh = folder / "box.stl"
    trimesh.creation.box((0.06, 0.05, 0.1)).export(mesh)
    spec = folder / "spec.toml"
    spec.write_text(SPEC.format(mesh=mesh))
    return spec


def sweep(spec: Path, out: Path, caches: Path) -> int:
    """Runs the study in fresh processes, with its own caches."""
    environment = {**os.environ, "WARPGRASP_CACHE": str(caches / "warpgrasp"),
                   "WARP_CACHE_PATH": str(caches / "warp")}
    return subprocess.run([sys.executable, "-m", "sweeps.cli.main", "sweep", str(spec), "-o",
                           str(out), "--quiet"], env=environment, capture_output=True,
                          check=False).returncode


def rows_of(out: Path) -> dict[str, bytes]:
    """The leaderboard, and the hash of each unit's rows, by name.

    Not the bytes of units: a flip that changes no row leaves a unit as it is.
    """
    found = {"leaderboard.csv": (out / "leaderboard.csv").read_bytes()}
    for part, ending in (("units", ""), ("contacts", ".contacts")):
        for file in sorted((out / part).glob("*.parquet")):
            try:
                columns = read_unit(file, file.stem + ending)
            except DamagedUnit:
                found[f"{part}/{file.name}"] = b"damaged"
            else:
                found[f"{part}/{file.name}"] = content_hash(columns).encode()
    return found


def flipped(file: Path, chance: random.Random) -> bytes:
    """A file's content with one random bit turned."""
    content = bytearray(file.read_bytes())
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    return bytes(content)


def checks_of(kind: str, file: Path, out: Path) -> Callable[[], str]:
    """What a reader of this kind of file makes of it now: `damaged`, `whole`, or `WRONG`."""
    before = file.read_bytes()

    def unit() -> str:
        identity = file.stem + (".contacts" if kind == "contacts" else "")
        try:
            found = read_unit(file, identity)
        except DamagedUnit:
            return "damaged"
        right = read_unit_of(before, identity)
        same = found.keys() == right.keys() and all(
            all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(
                found[name], right[name], strict=True)) if found[name].dtype == object
            and len(found[name]) and isinstance(found[name][0], np.ndarray)
            else np.array_equal(found[name], right[name], equal_nan=found[name].dtype.kind == "f")
            for name in right)
        return "whole" if same else "WRONG"

    def cached() -> str:
        return "damaged" if read_cached(file) is None else "WRONG"

    def kernel() -> str:
        folder = file.parent
        copy = {item: item.read_bytes() for item in folder.iterdir()}
        check_kernels(folder.name.removeprefix("wp_").rpartition("_")[0])
        gone = not folder.exists()
        folder.mkdir(exist_ok=True)
        for item, content in copy.items():
            item.write_bytes(content)
        return "damaged" if gone else "WRONG"

    def study() -> str:
        try:
            plan, _ = open_study([out])
        except StoreError:
            return "damaged"
        return "whole" if plan.hash == Store(out).resolved()["hash"] else "WRONG"

    return {"units": unit, "contacts": unit, "programs": cached, "grids": cached,
            "kernels": kernel, "resolved": study}[kind]


def read_unit_of(content: bytes, identity: str) -> dict[str, np.ndarray]:
    """The columns of a unit's bytes."""
    with tempfile.NamedTemporaryFile(suffix=".parquet") as file:
        file.write(content)
        file.flush()
        return read_unit(Path(file.name), identity)


def files_by_kind(out: Path, caches: Path) -> dict[str, list[Path]]:
    """Every file that a later run reads."""
    kernels = [file for folder in (caches / "warp").rglob("wp_*") if folder.is_dir()
               for file in folder.iterdir() if file.suffix in (".o", ".meta", ".sha256")]
    return {"units": sorted((out / "units").glob("*.parquet")),
            "contacts": sorted((out / "contacts").glob("*.parquet")),
            "programs": sorted((caches / "warpgrasp").rglob("*.xla")),
            "grids": sorted((caches / "warpgrasp").rglob("*.grid")),
            "kernels": sorted(kernels), "resolved": [out / "resolved.json"]}


def flip_and_read(out: Path, caches: Path, flips: int, chance: random.Random) -> list[str]:
    """Single flips, each read in this process."""
    wp.init()
    found = next((caches / "warp").rglob("wp_*"), None)
    if found is not None:
        wp.config.kernel_cache_dir = str(found.parent)
    kinds = files_by_kind(out, caches)
    seen: Counter[tuple[str, str]] = Counter()
    wrong = []
    for number in range(flips):
        kind = list(kinds)[number % len(kinds)]
        file = chance.choice(kinds[kind])
        before, check = file.read_bytes(), checks_of(kind, file, out)
        file.write_bytes(flipped(file, chance))
        answer = check()
        file.write_bytes(before)
        seen[kind, answer] += 1
        if answer == "WRONG":
            wrong.append(f"{kind}: {file.name}: a flip in it went unseen")
    for (kind, answer), count in sorted(seen.items()):
        print(f"{kind:10} {answer:8} {count}")
    return wrong


def flip_and_sweep(spec: Path, out: Path, caches: Path, sweeps: int, chance: random.Random
                   ) -> list[str]:
    """Flips in all kinds at once, each followed by two sweeps: rows as before, and no crash that
    the second repeats."""
    right, wrong = rows_of(out), []
    for number in range(sweeps):
        with tempfile.TemporaryDirectory() as folder:
            study, kept = Path(folder) / "out", Path(folder) / "caches"
            shutil.copytree(out, study)
            shutil.copytree(caches, kept)
            for kind, files in files_by_kind(study, kept).items():
                if kind != "resolved":
                    for file in chance.sample(files, min(3, len(files))):
                        file.write_bytes(flipped(file, chance))
            chance.choice(sorted((study / "units").iterdir())).unlink()  # so that something is run
            codes = [sweep(spec, study, kept) for _ in range(2)]
            found = rows_of(study)
            others = [name for name in right if found.get(name) != right[name] and not (
                name.startswith("contacts/") and found.get(name) == b"damaged")]
            if codes[1] or others:
                wrong.append(f"sweep {number}: exit codes {codes}, other rows in {others}")
            print(f"sweep {number}: exit codes {codes}", file=sys.stderr)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flips", type=int, default=10_000)
    parser.add_argument("--sweeps", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    chance = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spec, out, caches = make_study(folder), folder / "out", folder / "caches"
        if code := sweep(spec, out, caches):
            print(f"the sweep to begin with ended with {code}")
            return 1
        wrong = flip_and_sweep(spec, out, caches, given.sweeps, chance)
        wrong += flip_and_read(out, caches, given.flips, chance)
    print("\n".join(wrong) if wrong else
          f"{given.flips} flips, {given.sweeps} sweeps after flips: no wrong row, no crash twice")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
