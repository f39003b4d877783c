"""Small specs for tests."""

from pathlib import Path

from sweeps.plan import Plan, plan_study
from sweeps.spec import read_spec

SMALL = """\
schema = 1
seed = 7
episodes_per_cell = 70
objects = ["block", "wedge"]
[[strategy]]
name = "ring6"
[[strategy]]
name = "mine"
waypoints = { kind = "ring", count = 3, tilt_deg = 70 }
"""


def write_spec(folder: Path, text: str = SMALL) -> Path:
    file = folder / "spec.toml"
    file.write_text(text)
    return file


def plan_of(folder: Path, text: str = SMALL) -> Plan:
    folder.mkdir(exist_ok=True)
    return plan_study(read_spec(write_spec(folder, text)))
