"""Meshes and pose files that a spec names and nobody should trust."""

from pathlib import Path

import pytest
from fuzz_files import CORPUS, fuzz, outcome
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from studies import SMALL, write_spec

from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec

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


@settings(max_examples=150,
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


@pytest.mark.parametrize(("part", "says"), [
    ("shape = {}", "shape {}: one of block"),
    ("shape = [1]", "shape [1]: one of block"),
    ('shape = "block", join = []', "join []: one of union"),
    (f'shape = "sphere", radius_mm = 1{"0" * 400}', "sphere: radius_mm = 1000"),
    ('shape = "sphere", radius_mm = nan', "sphere: radius_mm = nan: a number from 1 to 1000"),
])
def test_odd_parts_of_a_compound_are_told(tmp_path: Path, part: str, says: str) -> None:
    said = read_with(tmp_path, '"block"', f'{{ name = "t", compound = [{{ {part} }}] }}')
    assert f"spec.toml:4: objects[0]: compound[0]: {says}" in said


@pytest.mark.parametrize("name", CORPUS)
def test_hostile_meshes_are_refused_in_bounded_time_and_memory(tmp_path: Path, name: str) -> None:
    assert outcome(tmp_path, "mesh", name, CORPUS[name]()) == "refused"
    assert not Path("/tmp/warpgrasp-was-here.stl").exists()


@pytest.mark.parametrize("kind", ["poses", "profile", "points", "mesh"])
@pytest.mark.parametrize("count", [60, pytest.param(10_000, marks=pytest.mark.slow)])
def test_spoiled_files_are_read_or_refused(tmp_path: Path, kind: str, count: int) -> None:
    counts, wrong = fuzz(tmp_path, kind, count, seed=3)
    assert not wrong
    assert sum(counts.values()) == count


@pytest.mark.parametrize(("value", "says"), [
    ("../../../../../../dev/zero", "is not a file"),
    ("/proc/kmsg", "is empty"),  # says so, and would be waited for for ever
    ("\\u0000", "is not a file"),
    ("a/" * 3000, "is not a file"),
    ("large.csv", "is larger than 1 MiB, the limit"),
])
@pytest.mark.parametrize("key", ["profile", "poses"])
def test_files_that_are_no_files_are_told(
        tmp_path: Path, key: str, value: str, says: str) -> None:
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(5 << 30)
    if key == "poses":
        said = read_with(tmp_path, 'kind = "ring", count = 3, tilt_deg = 70',
                         f'kind = "csv", file = "{value}"')
    else:
        said = read_with(tmp_path, '"block"', f'{{ profile = "{value}" }}')
    assert says in said
