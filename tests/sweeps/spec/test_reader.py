"""A spec as a study: defaults, overrides, the template, the text that a study keeps."""

import re
from dataclasses import fields, replace
from math import radians
from pathlib import Path
from typing import Any

import pytest
from studies import SMALL, read, refusals, write_spec

from strategies.poses.waypoints import WAYPOINT_KINDS, Ring
from strategies.strategy import Strategy
from sweeps.spec.cell import SECTIONS
from sweeps.spec.reader import TOP, read_spec, spec_text
from sweeps.spec.strategies import KEYS
from sweeps.spec.template import spec_template
from sweeps.spec.units import spec_fields


def test_defaults_are_filled_in(tmp_path: Path) -> None:
    study = read(tmp_path, SMALL)
    assert study.head.name == "spec"
    assert study.tables == {name: table() for name, table in SECTIONS.items()}
    assert [s.name for s in study.strategies] == ["ring6", "mine"]
    assert study.strategies[1].waypoints == (Ring(count=3, tilt_rad=radians(70)),)
    assert study.cell_count == 4


def test_overrides_add_and_replace(tmp_path: Path) -> None:
    text = SMALL + '[sweep.grid]\n"sensors.tendon_threshold_N" = [3.0, 6.0]\n'
    study = read(tmp_path, text, "sensors.tendon_threshold_N=1,2,4", "seed=9",
                 "fit.loss=none,cauchy", "episodes_per_cell=2")
    assert [axis.values for axis in study.axes] == [((1,), (2,), (4,)), (("none",), ("cauchy",))]
    assert replace(study.head, name="") == type(study.head)(seed=9, episodes_per_cell=2)
    for wrong in ("fit.loss", "fit.los=none", "seed=1,2", "fit.loss=", "seed=x"):
        assert refusals(tmp_path, text, wrong)


@pytest.mark.parametrize(("setting", "says"), [
    ("sensors.tendon_threshold_N=-4", "--set: sensors.tendon_threshold_N[0]: is -4; should be"),
    ("fit.los=none", "--set: fit.los: unknown key 'fit.los'"),
    ("seed=x", "--set: seed: is 'x'; should be"),
    ("hand=bogus", "--set: hand.kind: no hand 'bogus'"),
    ("arm=bogus", "--set: arm.kind: no arm 'bogus'"),
    ("fit.reconstruct=bogus", "--set: fit.reconstruct: fit.reconstruct: is 'bogus'"),
    ("planar.step_mm=3,4", "--set: planar.step_mm: changes nothing"),
])
def test_a_bad_override_is_told_as_such(tmp_path: Path, setting: str, says: str) -> None:
    text = SMALL + '[sweep.grid]\n"sensors.tendon_threshold_N" = [3.0, 6.0]\n'
    found = refusals(tmp_path, text, setting)
    assert len(found) == 1
    assert found[0].startswith(says)


def test_the_template_is_a_spec_that_names_every_key(tmp_path: Path) -> None:
    text = spec_template()
    assert read(tmp_path, text).cell_count == 12
    for table in (*SECTIONS.values(), *WAYPOINT_KINDS.values()):
        for name in spec_fields(table):
            assert f"{name} = " in text
    for name in {*TOP, *KEYS, *spec_fields(Strategy)}:
        assert re.search(rf"\b{name} = |\[{name}[].]", text), name
    uncommented = "\n".join(line.removeprefix("# ") if "_" in line.split("=")[0] and "..." not in
                            line and "{" not in line and "[object]" not in line and "=" in line
                            and line.startswith("# ") and '"' not in line.split("=")[0]
                            and not line.startswith("# closings") else line
                            for line in text.splitlines())
    study = read(tmp_path, uncommented)
    for name, table in SECTIONS.items():
        for f in fields(table):
            value: Any = getattr(study.tables[name], f.name)
            if isinstance(f.default, float | tuple):
                assert value == f.default, f.name  # bit-identical, so that it is the same study


def test_a_planner_of_the_template_can_be_swept(tmp_path: Path) -> None:
    lines = spec_template().splitlines()
    for start in ("# options = ", "# [sweep.grid]", '# "strategy.options.'):
        assert sum(line.startswith(start) for line in lines) == 1
        lines = [line.removeprefix("# ") if line.startswith(start) else line for line in lines]
    assert read(tmp_path, "\n".join(lines)).setting_count == 2


@pytest.mark.parametrize("own", ["", 'set = ["seed=8"]\n', 'set = [\n  "seed=8",\n]\n',
                                 '"set"=["seed=8"]  # as it was\n'])
def test_a_kept_spec_says_once_what_was_set(tmp_path: Path, own: str) -> None:
    """Whatever way its own key is written in."""
    text = own + SMALL + '[[strategy]]\nname = "q"\n[strategy.waypoints]\nkind = "ring"\n'
    file = write_spec(tmp_path, text)
    kept = spec_text(file.read_bytes(), ["episodes_per_cell=2"]).decode()
    assert kept.count("episodes_per_cell=2") == 1
    (tmp_path / "kept.toml").write_text(kept)
    again = read_spec(tmp_path / "kept.toml")
    assert again.head.episodes_per_cell == 2
    assert again.head.seed == (8 if own else read_spec(file).head.seed)
    assert again.strategies == read_spec(file).strategies
