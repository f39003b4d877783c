"""The studies that ship are specs without a fault, and each has its paragraph."""

from pathlib import Path

import pytest
from places import ROOT
from studies import SMALL, write_spec

from sweeps.analysis.entries import entries_of
from sweeps.run.plan import plan_study, study_of
from sweeps.spec.reader import read_spec

STUDIES = sorted((ROOT / "sweeps" / "studies").glob("*.toml"))


MANY_BODIES = ("everyday", "held_out")


@pytest.mark.parametrize("file", [
    pytest.param(file, id=file.stem, marks=pytest.mark.slow if file.stem in MANY_BODIES else ())
    for file in STUDIES])
def test_a_study_is_a_plan_and_is_explained(file: Path) -> None:
    plan = plan_study(read_spec(file))
    assert plan.unit_count > 0
    again = plan_study(study_of(plan.resolved, plan.study.head.name))
    assert again.hash == plan.hash
    assert f"## {file.stem}" in (ROOT / "docs" / "studies.md").read_text()


def test_the_example_in_the_docs_is_the_file() -> None:
    code = (ROOT / "examples" / "mine" / "mine.py").read_text().split("\n\n", 1)[1].strip()
    assert code in (ROOT / "docs" / "strategies.md").read_text()


def test_a_key_that_says_nothing_of_a_strategy_makes_no_settings_of_it(tmp_path: Path) -> None:
    """Equal entries were ranked beside each other, and shared the chance to be best."""
    text = """\
schema = 1
objects = ["block", "wedge"]
episodes_per_cell = 4
[[strategy]]
name = "planned"
strategy = "any-object"
options = { poses = 6 }
[[strategy]]
name = "ringed"
waypoints = { kind = "ring", count = 6 }
[[strategy]]
name = "crossed"
order = ["planar"]
waypoints = { kind = "ring", count = 6 }
[sweep.grid]
"strategy.options.poses" = [4, 6, 8]
"planar.step_mm" = [6, 9]
"strategy.tilt_deg" = [30, 40, 50, 60]
"sensors.tendon_threshold_N" = [4, 6]
"""
    study = read_spec(write_spec(tmp_path, text))
    assert [study.settings_of(n) for n in range(3)] == [3 * 2, 4 * 2, 2 * 2]
    assert study.cell_count == 2 * (6 + 8 + 4) == len({*study.cells()})
    cells = {(strategy, body, *sorted(study.cell(strategy, body, setting).setting.items()))
             for strategy, body, setting in study.cells()}
    assert len(cells) == study.cell_count
    entries = entries_of(plan_study(study), range(4))
    assert len({entry.label for entry in entries}) == len(entries) == 18
    assert entries[0].label == "planned [strategy.options.poses=4, sensors.tendon_threshold_N=4]"
    assert entries[6].label == "ringed [strategy.tilt_deg=30, sensors.tendon_threshold_N=4]"


GUIDED, ORDERED, CROSSING, TURNING = (
    'strategy = "coverage"', 'waypoints = { kind = "ring" }', 'order = ["planar"]',
    'order = ["contour", "containment"]')


@pytest.mark.parametrize(("axis", "told", "untold"), [
    ('"strategy.refit_every" = [1, 4]', (ORDERED, 'strategy = "even"', TURNING),
     (GUIDED, CROSSING)),
    ('"strategy.closings" = [["curl40"], ["base_then_curl"]]', (ORDERED, GUIDED), (CROSSING,)),
    ('"stereo.clutter" = [4, 8]\n[contour]\naxis = "stereo"', (TURNING,),
     (ORDERED, CROSSING, GUIDED)),
    ('"stereo.clutter" = [4, 8]\n[object]\nprior = "silhouettes"', (ORDERED, CROSSING, GUIDED), ()),
    ('"strategy.count" = [3, 4]', (ORDERED, TURNING), (CROSSING, GUIDED))])
def test_a_key_that_only_some_read_makes_settings_of_these(
        axis: str, told: tuple[str, ...], untold: tuple[str, ...], tmp_path: Path) -> None:
    """Of the others it made entries that did the same."""
    text = 'schema = 1\nobjects = ["block"]\n' + "".join(
        f'[[strategy]]\nname = "s{n}"\n{line}\n' for n, line in enumerate((*told, *untold)))
    study = read_spec(write_spec(tmp_path, f"{text}[sweep.grid]\n{axis}\n"))
    assert [study.settings_of(n) for n in range(len(study.strategies))] == [
        *[2] * len(told), *[1] * len(untold)]


def test_settings_of_draws_are_those_of_all_strategies(tmp_path: Path) -> None:
    """What entries are averaged over is the same of all."""
    study = read_spec(write_spec(tmp_path, SMALL + """
[sweep.sobol]
n = 4
"strategy.tilt_deg" = { low = 30, high = 60 }
"""))
    assert study.cell_count == len({*study.cells()}) == 2 * 4 * len(study.objects)
