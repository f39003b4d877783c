"""Meshes and pose files that a spec names and nobody should trust."""

import resource
import struct
import time
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from studies import SMALL, write_spec

from sweeps.problems import SpecError
from sweeps.spec import read_spec

HEADER = "x_m,y_m,z_m,qx,qy,qz,qw\n"
CELL = st.sampled_from(["0.4", "0", "1", "nan", "inf", "-1e400", "x", "", '"', '"0.1"', "1_0", "٣",
                        "\x00", " 1 ", "\r", "#"])
ROW = st.lists(CELL, min_size=5, max_size=8).map(",".join)


def read_with(folder: Path, old: str, new: str) -> str:
    """The problems of a spec with a piece replaced, or nothing."""
    assert old in SMALL
    try:
        read_spec(write_spec(folder, SMALL.replace(old, new)))
    except SpecError as error:
        return str(error)
    return ""


@settings(max_examples=150, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(header=st.sampled_from([HEADER, HEADER.upper(), "\ufeff" + HEADER, "", "a,b\n"]),
       rows=st.lists(ROW, max_size=3), tail=st.binary(max_size=4))
def test_pose_files_are_read_or_refused(
        tmp_path: Path, header: str, rows: list[str], tail: bytes) -> None:
    (tmp_path / "p.csv").write_bytes((header + "\n".join(rows)).encode() + tail)
    said = read_with(tmp_path, 'kind = "ring", count = 3, tilt_deg = 70',
                     'kind = "csv", file = "p.csv"')
    assert said == "" or "spec.toml:9: strategy[1].waypoints.file: " in said


@pytest.mark.parametrize(("row", "says"), [
    ("0.4,0,zero,1,0,0,0", "p.csv:3: z_m: 'zero' is not a number"),
    ("0.4,0,nan,1,0,0,0", "p.csv:3: z_m: nan is not finite"),
])
def test_what_is_wrong_in_a_pose_file_is_told_with_its_line(
        tmp_path: Path, row: str, says: str) -> None:
    (tmp_path / "p.csv").write_text(f"{HEADER}0.4,0,0.3,1,0,0,0\n{row}\n")
    said = read_with(tmp_path, 'kind = "ring", count = 3, tilt_deg = 70',
                     'kind = "csv", file = "p.csv"')
    assert "spec.toml:9: strategy[1].waypoints.file: " in said
    assert says in said


def ply(vertices: str, faces: str, body: bytes = b"", kind: str = "ascii") -> bytes:
    return (f"ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\n"
            "property float y\nproperty float z\n"
            f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
            ).encode() + body


def bomb(folder: Path) -> bytes:
    file = folder / "bomb.zip"
    with (zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
          archive.open("3D/3dmodel.model", "w") as model):
        for _ in range(512):
            model.write(b" " * (1 << 20))
    return file.read_bytes()


HOSTILE = {
    "billion.ply": ply("3", "1000000000", b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    "billion_binary.ply": ply("1000000000", "1000000000", b"\0" * 40, "binary_little_endian"),
    "negative.ply": ply("-3", "-1"),
    "nan.ply": ply("3", "1", b"nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    "index.ply": ply("3", "1", b"0 0 0\n1 0 0\n0 1 0\n3 0 1 999999999\n"),
    "billion.stl": b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 100,
    "text.stl": b"solid x\nfacet normal 0 0 nonsense\n",
    "bytes.stl": bytes(range(256)) * 8,
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999\n",
    "words.obj": b"v a b c\nf x y z\n",
    "no.obj": b"",
    "library.obj": b"mtllib ../../../../etc/passwd\nv 0 0 0\nf 1 1 1\n",
    "bytes.glb": b"glTF\x02\x00\x00\x00\xff\xff\xff\xff",
    "unknown.xyz": b"1 2 3\n",
    "picture.png": b"\x89PNG\r\n\x1a\n",
}


@pytest.mark.parametrize("name", [*HOSTILE, "bomb.3mf"])
def test_hostile_meshes_are_refused_in_bounded_time_and_memory(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(bomb(tmp_path) if name == "bomb.3mf" else HOSTILE[name])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    said = read_with(tmp_path, '"block"', f'{{ mesh = "{name}", units = "cm" }}')
    assert "spec.toml:4: objects[0]" in said
    assert time.process_time() - began < 5.0  # the promise; most take milliseconds
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1 << 20  # KiB: 1 GiB
