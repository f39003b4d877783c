"""Entries of `objects` that stand for several."""

from pathlib import Path

import pytest
import trimesh

from sweeps.spec.errors import Problems
from sweeps.spec.object_sets import pose_name
from sweeps.spec.objects import ObjectError, object_of_argument, read_objects
from warpgrasp.objects.catalogue_names import NAME_LIMIT


def read(values: list, base: Path = Path()) -> tuple[list[str], list[str]]:
    """Names of the objects, and what is wrong."""
    problems = Problems("spec.toml", {})
    found = read_objects(values, base, problems)
    return [body.name for body in found], [problem.what for problem in problems.found]


def test_members_of_families_by_name_and_by_set() -> None:
    assert read(["block", "mug-3", {"family": "box", "count": 2}]) == (
        ["block", "mug-3", "box-0", "box-1"], [])
    assert read([{"family": "box", "set": "held-out", "first": 4, "count": 1}])[0] == ["box-1004"]
    assert "compound" in object_of_argument("mug-3", None)


@pytest.mark.parametrize(("entry", "said"), [
    ({"family": "mugs"}, "mug"), ({"family": "mug", "set": "hidden"}, "held-out"),
    ({"family": "mug", "count": 0}, "whole number"), ({"family": "mug", "seed": 1}, "unknown key"),
    ({"family": "mug", "first": 999, "count": 2}, "there are 1"),
    ("mug-2000", "no object 'mug-2000'; mug-0 to mug-1999 are made by seed"),
    ("drill-1", "no object 'drill-1'; made by seed, such as mug-1, are mug, bowl"),
    ({"meshes": "none/*.ply", "units": "m"}, "no file matches"), ({"meshes": 3}, "pattern"),
    ({"meshes": "*.ply", "unit": "m"}, "unknown key"), ({"object": "blok"}, "block"),
    ({"object": "mug-2000"}, "no object 'mug-2000'; mug-0 to mug-1999 are made by seed"),
    ({"object": "block", "units": "m"}, "unknown key"),
    ({"object": "block", "stable_pose": 0}, "likeliest"),
    ({"object": "block", "stable_pose": "all"}, '"each"'),
    ({"object": "block", "stable_pose": 9}, "there are 6"),
])
def test_what_is_wrong_is_said(entry, said: str, tmp_path: Path) -> None:
    names, wrong = read([entry], tmp_path)
    assert not names
    assert any(said in text for text in wrong)


def test_meshes_by_a_pattern(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    for name, radius in (("one", 0.03), ("two", 0.04)):
        trimesh.creation.icosphere(3, radius).export(tmp_path / "scans" / f"{name}.ply")
    (tmp_path / "scans/._one.ply").write_text("as macOS leaves them")
    assert read([{"meshes": "scans/*.ply", "units": "m"}], tmp_path) == (["one", "two"], [])
    assert read([{"meshes": f"{tmp_path}/scans/o*.ply", "units": "m"}])[0] == ["one"]
    assert any("units" in text for text in read([{"meshes": "scans/*.ply"}], tmp_path)[1])


def test_objects_lie_in_stable_poses() -> None:
    assert read([{"object": "block", "stable_pose": 3}, {"object": "funnel", "name": "cup"}]) == (
        ["block-pose-3", "cup"], [])
    assert read([{"object": "wedge", "stable_pose": "each"}])[0] == [
        f"wedge-pose-{k}" for k in range(1, 6)]
    assert read([{"family": "box", "count": 1, "stable_pose": 1}])[0] == ["box-0-pose-1"]
    assert object_of_argument("block", None, 2) == {
        "object": "block", "name": "block-pose-2", "stable_pose": 2}
    with pytest.raises(ObjectError, match=r"^--stable-pose: of wedge: .* there are 5 stable"):
        object_of_argument("wedge", None, 99)


def test_a_pose_is_no_name() -> None:
    block = {"shape": "block", "size_mm": [60, 60, 60]}
    names, said = read([{"compound": [block], "stable_pose": 1}])
    assert names == []
    assert any("name" in text for text in said)


def test_the_number_of_a_pose_is_not_cut_off_a_long_name() -> None:
    name = "n" * NAME_LIMIT
    assert pose_name(name, 2) == name[:-7] + "-pose-2"
    assert pose_name("block", 11) == "block-pose-11"


def test_a_mesh_file_that_is_not_there_is_named() -> None:
    with pytest.raises(ObjectError, match=r"^scans/mug\.ply: there is no such mesh file$"):
        object_of_argument("scans/mug.ply", "m")
    with pytest.raises(ObjectError, match=r"^no object 'mugg'"):
        object_of_argument("mugg", None)
