"""A study's directory that was given away: its spec finds every file among the copies."""

import shutil
from pathlib import Path

import pytest
import trimesh

from strategies.recognition.known_models import SHIPPED
from sweeps.run.plan import Plan, plan_study
from sweeps.run.store import Store
from sweeps.spec.named_files import NoFile, named_file
from sweeps.spec.reader import read_spec

SPEC = """\
schema = 1
objects = [{{ mesh = "m1/mesh.stl", units = "m", name = "one" }},
           {{ mesh = "./m2/mesh.stl", units = "m", name = "two" }},
           {{ mesh = "other/mesh.stl", units = "m", name = "three" }},
           {{ meshes = "**/*.ply", units = "m" }}]
[recognition]
models = "models.json"
[[strategy]]
name = "beside"
waypoints = {{ kind = "csv", file = "../far/poses.csv" }}
[[strategy]]
name = "by-its-whole-path"
waypoints = {{ kind = "csv", file = "{far}/poses.csv" }}
[[strategy]]
name = "own"
strategy = "mine.py:choose"
"""


def make_study(folder: Path) -> Path:
    """A folder with a spec and files of every kind, two of one name; another holds one, too."""
    given, far = folder / "given", folder / "far"
    for name, size in (("m1/mesh.stl", 0.06), ("m2/mesh.stl", 0.05), ("scans/a.ply", 0.07),
                       ("scans/more/b.ply", 0.08)):
        (given / name).parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box((size, 0.05, 0.1)).export(given / name)
    far.mkdir()
    (far / "poses.csv").write_text("x_m,y_m,z_m,qx,qy,qz,qw\n0.4,0,0.2,0,1,0,0\n")
    (given / "mine.py").write_text(
        "import helper\n\n\ndef choose(belief):\n    return helper.nothing()\n")
    (given / "helper.py").write_text("def nothing():\n    return []\n")
    shutil.copy(SHIPPED, given / "models.json")
    (given / "named.toml").write_text(SPEC.format(far=far))
    (given / "other").symlink_to(given / "m1")
    return given / "named.toml"


def opened(spec: Path, folder: Path) -> Plan:
    plan = plan_study(read_spec(spec))
    Store(folder).open_for(plan, spec.read_bytes(), "cpu")
    return plan


def test_a_study_is_read_where_none_of_its_files_are(tmp_path: Path) -> None:
    """Files of poses and models, two of one name, and patterns had to be put beside it again."""
    plan = opened(make_study(tmp_path), tmp_path / "out")
    assert len(plan.study.objects) == 5
    shutil.move(tmp_path / "out", tmp_path / "moved")
    shutil.rmtree(tmp_path / "given")
    shutil.rmtree(tmp_path / "far")
    (tmp_path / "moved/m1").mkdir()  # another file of that name is not the study's
    trimesh.creation.box((0.09, 0.05, 0.1)).export(tmp_path / "moved/m1/mesh.stl")
    again = opened(tmp_path / "moved/spec.toml", tmp_path / "moved")
    assert again.hash == plan.hash
    assert again.study.head.name == "named"  # and not that of the file it is kept in
    opened(tmp_path / "moved/spec.toml", tmp_path / "third")
    shutil.rmtree(tmp_path / "moved")
    assert plan_study(read_spec(tmp_path / "third/spec.toml")).hash == plan.hash


def test_a_folder_of_inputs_is_a_studys_alone(tmp_path: Path) -> None:
    """Beside a spec of the user's it is no place where a file that is not there is looked for."""
    (tmp_path / "inputs" / "abc").mkdir(parents=True)
    (tmp_path / "inputs" / "abc" / "poses.csv").write_text("x\n1\n")
    with pytest.raises(NoFile):
        named_file("poses.csv", tmp_path, 1 << 20)
    (tmp_path / "inputs/files.json").write_text('{"poses.csv": "inputs/abc/poses.csv"}')
    assert named_file("./poses.csv", tmp_path, 1 << 20).parent.name == "abc"
    with pytest.raises(NoFile):
        named_file("other.csv", tmp_path, 1 << 20)
