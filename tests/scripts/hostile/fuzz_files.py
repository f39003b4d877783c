"""Files that nobody should trust: poses, profiles, points and meshes, spoiled at random.

    python tests/scripts/hostile/fuzz_files.py --count 10000 --seed 1

Poses, profiles and meshes go through `warpgrasp check`, points through the reader of `warpgrasp
fit`. Each must be read (exit code 0) or refused (2, with the spec's line), never with a traceback,
within five seconds of processor time and a gigabyte of memory. What once went wrong is kept in
CORPUS. A readable mesh takes half a second to bake: of those, one in --bake is baked, the others
end after every check of the intake.
"""

import argparse
import io
import os
import random
import resource
import struct
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import trimesh

from fit.points_csv import PointsError, read_points
from sweeps.cli import main as cli
from warpgrasp.objects import mesh_import as mesh_intake

LIMIT_S = 5.0
LIMIT_KIB = 1 << 20
HEAD = "schema = 1\nepisodes_per_cell = 2\n"
SPECS = {
    "poses": HEAD + 'objects = ["block"]\n[[strategy]]\nname = "a"\n'
                    'waypoints = {{ kind = "csv", file = "{}" }}\n',
    "profile": HEAD + 'objects = [{{ profile = "{}" }}]\n[[strategy]]\nname = "ring6"\n',
    "mesh": HEAD + 'objects = [{{ mesh = "{}", units = "mm" }}]\n[[strategy]]\nname = "ring6"\n',
}
CSV = {
    "poses": "x_m,y_m,z_m,qx,qy,qz,qw\n0.4,0,0.3,1,0,0,0\n0.5,-0.1,0.2,0,1,0,0\n",
    "profile": "# a vase\nz_mm,r_mm\n0,20\n30,25.5\n60,10\n",
    "points": "set,x_m,y_m,z_m,nx,ny,nz\na,0.1,0,0.2,1,0,0\nb,0.1,0.02,0.2,NA,,0\na,0,0,0,0,0,1\n",
}
CELLS = ("nan", "inf", "-inf", "1e400", "-1e-400", "x", "", '"', '"0.1"', "1_0", "٣", "\x00", " 1 ",
         "\r", "#", "0x10", "9" * 400, "9" * 200_000, "-0.0", "1e9", "a,b", "'", "\ufeff", "\x1a",
         "None", "0,0", "\n\n", "=1+1", "1,2,3,4,5,6,7,8,9", "é", "\U0010ffff", "１")
MESH_WORDS = (b"nan", b"inf", b"-1", b"0", b"999999999", b"1e400", b"1e-400", b"", b"4294967295",
              b"-9223372036854775809", b"1" * 400, b"\x00", b"1/1/1", b"1//1", b"//", b"x", b"\xff",
              b"f", b"v", b"end_header\n", b"element face 1000000000\n", b"endsolid\n", b"list",
              b"property list uchar int vertex_indices\n", b"mtllib ../../../../etc/passwd\n")


def ply(vertices: str, faces: str, body: bytes = b"", kind: str = "ascii") -> bytes:
    return (f"ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\n"
            "property float y\nproperty float z\n"
            f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
            ).encode() + body


def bomb(megabytes: int, member: str = "3D/3dmodel.model") -> bytes:
    """A small archive that unfolds to many megabytes."""
    content = io.BytesIO()
    with (zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
          archive.open(member, "w") as model):
        for _ in range(megabytes):
            model.write(b" " * (1 << 20))
    return content.getvalue()


CORPUS: dict[str, Callable[[], bytes]] = {name: (lambda content=content: content)
                                          for name, content in {
    "billion.ply": ply("3", "1000000000", b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    "billion_binary.ply": ply("1000000000", "1000000000", b"\0" * 40, "binary_little_endian"),
    "million_binary.ply": ply("1999999", "1999999", b"\0" * 40, "binary_little_endian"),
    "other_element.ply": ply("3", "1").replace(b"end_h", b"element x 99999999999\nend_h"),
    "negative.ply": ply("-3", "-1"),
    "nan.ply": ply("3", "1", b"nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    "index.ply": ply("3", "1", b"0 0 0\n1 0 0\n0 1 0\n3 0 1 999999999\n"),
    "billion.stl": b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 100,
    "million.stl": b"\0" * 80 + struct.pack("<I", 1_999_999) + b"\0" * 100,
    "text.stl": b"solid x\nfacet normal 0 0 nonsense\n",
    "normal.stl": b"solid\nfacet normal 0 0 1e\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
                  b"vertex 0 1 0\nendloop\nendfacet\nendsolid\n",
    "bytes.stl": bytes(range(256)) * 8,
    "billion.off": b"OFF\n1000000000 1000000000 0\n0 0 0\n",
    "million.off": b"OFF\n1999999 1999999 0\n0 0 0\n",
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999\n",
    "words.obj": b"v a b c\nf x y z\n",
    "no.obj": b"",
    "flat.obj": b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\nf 3 2 1\n",
    "library.obj": b"mtllib ../../../../dev/zero\nv 0 0 0\nf 1 1 1\n",
    "bytes.glb": b"glTF\x02\x00\x00\x00\xff\xff\xff\xff",
    "outside.gltf": b'{"buffers": [{"uri": "../../../../etc/passwd", "byteLength": 9}]}',
    "unknown.xyz": b"1 2 3\n",
    "picture.png": b"\x89PNG\r\n\x1a\n",
    "laughs.dae": b'<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;&b;&b;">]><a>&c;</a>',
}.items()}
CORPUS |= {"bomb.3mf": lambda: bomb(128), "bomb.zip": lambda: bomb(128, "a.stl"),
           "outside.zip": lambda: bomb(1, "../../../../tmp/warpgrasp-was-here.stl"),
           "faces.obj": lambda: b"v 0 0 0\n" + b"f 1 1 1\n" * 2_000_001}


def spoiled_csv(chance: random.Random, text: str) -> bytes:
    """A CSV with one to four things wrong with it, perhaps."""
    rows = [line.split(",") for line in text.splitlines()]
    for _ in range(chance.randint(0, 4)):
        row = chance.choice(rows)
        action = chance.random()
        if action < 0.5 and row:
            row[chance.randrange(len(row))] = chance.choice(CELLS)
        elif action < 0.6 and row:
            row.pop(chance.randrange(len(row)))
        elif action < 0.7:
            row.insert(chance.randrange(len(row) + 1), chance.choice(CELLS))
        elif action < 0.8:
            rows.insert(chance.randrange(len(rows) + 1), list(row))
        elif action < 0.85 and max(map(len, row), default=0) < 1000:
            rows.extend([list(row) for _ in range(chance.choice((3, 300, 3000)))])
        elif len(rows) > 1:
            rows.remove(row)
    end = chance.choice(("\n", "\n", "\r\n", "\r"))
    content = end.join(map(",".join, rows)).encode("utf-8", "surrogatepass")
    if chance.random() < 0.1:
        content = content.decode().encode(chance.choice(("utf-16", "utf-8-sig", "utf-32")))
    return spoiled_bytes(chance, content) if chance.random() < 0.4 else content


def spoiled_bytes(chance: random.Random, content: bytes, words: tuple[bytes, ...] = (b"\x00",),
                  ) -> bytes:
    """Bytes with flips, cuts, repeats and foreign words."""
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(content) + 1)
        action = chance.random()
        if action < 0.35 and at < len(content):
            content = content[:at] + bytes([chance.randrange(256)]) + content[at + 1:]
        elif action < 0.5:
            content = content[:at]
        elif action < 0.6:
            content = content[:at] + content[at + chance.randint(1, 40):]
        elif action < 0.7:
            content = content[:at] + content[at // 2:]
        else:
            content = content[:at] + chance.choice(words) + content[at + chance.choice((0, 1, 4)):]
    return content


def meshes() -> dict[str, bytes]:
    """Small sound meshes of every kind, to be spoiled."""
    found: dict[str, bytes] = {}
    for name, mesh in (("box", trimesh.creation.box((80, 60, 70))),
                       ("ball", trimesh.creation.icosphere(1, 40))):
        for kind, options in (("stl", {}), ("stl_ascii", {}), ("obj", {}), ("off", {}),
                              ("ply", {}), ("ply", {"encoding": "ascii"})):
            content: Any = mesh.export(file_type=kind, **options)
            found[f"{name}{len(found)}.{kind[:3]}"] = (
                content.encode() if isinstance(content, str) else content)
    return found


def spoiled_mesh(chance: random.Random, sound: dict[str, bytes]) -> tuple[str, bytes]:
    name = chance.choice(sorted(sound))
    content = sound[name]
    if chance.random() < 0.4 and not name.endswith("stl"):  # numbers in the text or the header
        words = content.split(b" ")
        for _ in range(chance.randint(1, 3)):
            words[chance.randrange(min(len(words), 60))] = chance.choice(MESH_WORDS)
        content = b" ".join(words)
    else:
        content = spoiled_bytes(chance, content, MESH_WORDS)
    if chance.random() < 0.05:
        name = name[:-3] + chance.choice(("stl", "obj", "off", "ply", "3mf", "OBJ", "zip"))
    return name, content


def outcome(folder: Path, kind: str, name: str, content: bytes) -> str:
    """`read`, `refused`, or what went wrong."""
    (folder / name).write_bytes(content)
    before = _forget_peak()
    began = time.process_time()
    try:
        found = _read_points(folder / name) if kind == "points" else _check(folder, kind, name)
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
    seconds = time.process_time() - began
    grown = _peak_kib() - before
    (folder / name).unlink()
    if seconds >= LIMIT_S:
        return f"took {seconds:.1f} s"
    return found if grown < LIMIT_KIB else f"took {grown >> 10} MiB"


def _forget_peak() -> int:
    """Starts the record of the most memory anew; what is used now comes back, in KiB."""
    Path("/proc/self/clear_refs").write_text("5")
    return _peak_kib()


def _peak_kib() -> int:
    line = next(line for line in Path("/proc/self/status").read_text().splitlines()
                if line.startswith("VmHWM"))
    return int(line.split()[1])


def _check(folder: Path, kind: str, name: str) -> str:
    spec = folder / "spec.toml"
    spec.write_text(SPECS[kind].format(name))
    out, said = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(said):
        code = cli.run(["check", str(spec)])
    first = said.getvalue().partition("\n")[0]
    if code == 0 and out.getvalue():
        return "read"
    if code == 2 and first.startswith(f"{spec}:") and not out.getvalue():
        return "refused"
    return f"exit code {code}: {said.getvalue()[:300]}"


def _read_points(file: Path) -> str:
    try:
        sets = read_points(file)
    except PointsError as error:
        right = all(problem.startswith(f"{file}") for problem in error.problems)
        return "refused" if right and error.problems else f"a problem without its place: {error}"
    return "read" if sets.count.any() else "sets without points"


def case(kind: str, n: int, seed: int, sound: dict[str, bytes]) -> tuple[str, bytes]:
    """Spoiled file `n` of a kind: its name and content."""
    chance = random.Random(f"{kind} {seed} {n}")
    if kind != "mesh":
        return f"{kind}.csv", spoiled_csv(chance, CSV[kind])
    return spoiled_mesh(chance, sound)


def fuzz(folder: Path, kind: str, count: int, seed: int, bake: int = 100,
         ) -> tuple[dict[str, int], list[tuple[str, bytes]]]:
    """How often each outcome came, and the files that something went wrong with."""
    sound = meshes()
    counts: dict[str, int] = {}
    wrong: list[tuple[str, bytes]] = []
    with (patch.dict(os.environ, {"WARPGRASP_CACHE": str(folder / "cache")}),
          patch.object(mesh_intake, "_bake", _Bake(bake))):
        if kind == "mesh":  # compiles the kernels, which no file is to blame for
            name = min(sound)
            (folder / name).write_bytes(sound[name])
            _check(folder, kind, name)
        for n in range(count):
            name, content = case(kind, n, seed, sound)
            found = outcome(folder, kind, name, content)
            if found not in ("read", "refused"):
                wrong.append((f"{kind} {n} {name}: {found}", content))
                found = "wrong"
            counts[found] = counts.get(found, 0) + 1
    return counts, wrong


class _Bake:
    """Bakes one mesh in `every`; the others get a grid of nothing."""

    def __init__(self, every: int) -> None:
        self.every, self.count, self.real = every, 0, mesh_intake._bake

    def __call__(self, vertices: np.ndarray, faces: np.ndarray) -> dict[str, np.ndarray]:
        self.count += 1
        if self.count % self.every == 1 % self.every:
            return self.real(vertices, faces)
        values: tuple[Any, ...] = (np.ones((2, 2, 2), np.float32), np.zeros(3), np.float64(0.1),
                                   vertices.min(0), vertices.max(0), np.float64(0))
        return dict(zip(("grid", "origin", "cell", "low", "high", "error"), values, strict=True))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="of each kind")
    parser.add_argument("--kinds", nargs="+", default=["poses", "profile", "points", "mesh"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bake", type=int, default=100)
    given = parser.parse_args()
    failed = False
    if "mesh" in given.kinds:
        with tempfile.TemporaryDirectory() as folder:
            for name, content in CORPUS.items():
                found = outcome(Path(folder), "mesh", name, content())
                if found != "refused":
                    print(f"--- {name}: {found}")
                    failed = True
    for kind in given.kinds:
        began = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            counts, wrong = fuzz(Path(folder), kind, given.count, given.seed, given.bake)
        for found, content in wrong[:10]:
            print(f"--- {found[:500]}\n{content[:400]!r}")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
        print(f"{kind}: {counts}, {time.process_time() - began:.0f} s of processor time, "
              f"peak {peak} MiB", flush=True)
        failed |= bool(wrong)
    return failed


if __name__ == "__main__":
    sys.exit(main())
