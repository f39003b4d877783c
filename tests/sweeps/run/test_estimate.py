"""The time that `check` tells knows the study's arms and hands, and a run's start."""

from pathlib import Path

import pytest
from studies import plan_of

import sweeps
from strategies.ready_made import STRATEGIES
from sweeps.run.estimate import (
    OBJECT_S,
    START_S,
    UNIT_S,
    episode_seconds,
    estimate_cost,
)
from sweeps.run.plan import plan_study
from sweeps.spec import objects
from sweeps.spec.reader import read_spec

HEAD = 'schema = 1\nepisodes_per_cell = 64\nobjects = ["block"]\n'
LEARNING = '[[strategy]]\nname = "any-object"\n'


def seconds(folder: Path, text: str) -> float:
    """The estimate, in seconds."""
    _, number, unit, *_ = dict(estimate_cost(plan_of(folder, text)))["time"].split()
    return float(number) * {"seconds": 1, "minutes": 60, "hours": 3600}[unit]


@pytest.mark.parametrize(("name", "arm", "hand", "measured"), [
    ("any-object", "puma560", "utah_mit", 2.0), ("any-object", "ur5e", "utah_mit", 34.0),
    ("any-object", "none", "allegro", 0.74), ("any-object", "ur5e", "allegro", 5.9),
    ("coverage", "puma560", "utah_mit", 0.28), ("coverage", "ur5e", "utah_mit", 1.16),
    ("expected-error", "panda", "utah_mit", 1.58), ("ring6", "puma560", "allegro", 0.033)])
def test_episodes_cost_about_what_was_measured(
        name: str, arm: str, hand: str, measured: float) -> None:
    """On one core, in units of four episodes of 96 touches, some of them of 24 and times four."""
    told = episode_seconds(STRATEGIES[name], arm, hand)
    assert measured / 3 < told < 3 * measured


def test_the_estimate_knows_arms_and_the_start(tmp_path: Path) -> None:
    usual = seconds(tmp_path, HEAD + LEARNING)
    iterated = seconds(tmp_path, 'arm = "ur5e"\n' + HEAD + LEARNING)
    both = seconds(tmp_path, HEAD + LEARNING + '[sweep.grid]\narm = ["puma560", "ur5e"]\n')
    assert iterated > 10 * usual
    assert both == pytest.approx(usual + iterated, rel=0.1)
    few = HEAD.replace("64", "1") + '[[strategy]]\nname = "ring6"\n'
    assert seconds(tmp_path, few) == pytest.approx(START_S + OBJECT_S + UNIT_S, abs=1.0)


def test_settings_with_free_forms_take_longer_than_those_without(tmp_path: Path) -> None:
    one, other = (seconds(tmp_path, f'{HEAD}{LEARNING}[fit]\nreconstruct = "{word}"\n')
                  for word in ("superquadric", "implicit"))
    both = seconds(tmp_path, HEAD + LEARNING + (
        '[sweep.grid]\n"fit.reconstruct" = ["superquadric", "implicit"]\n'))
    assert other > 2 * one
    assert both == pytest.approx(one + other, rel=0.1)


@pytest.mark.parametrize(("name", "measured"), [("everyday", 2242.0), ("held_out", 1128.0)])
def test_studies_of_few_episodes_a_unit_take_about_what_was_measured(
        monkeypatch: pytest.MonkeyPatch, name: str, measured: float) -> None:
    """Twice the time of two workers, on a machine with other work; 726 and 192 s were told. The
    estimate knows objects by their number: none need be built for it."""
    monkeypatch.setattr(objects, "_build", lambda table, base_dir: None)
    plan = plan_study(read_spec(Path(sweeps.__file__).parent / f"studies/{name}.toml"))
    _, number, unit, *_ = dict(estimate_cost(plan))["time"].split()
    told = float(number) * {"minutes": 60, "hours": 3600}[unit]
    assert measured / 2 < told < measured


def test_the_disk_of_short_units_is_told(tmp_path: Path) -> None:
    """A unit of one episode takes 21 kB, not a 64th of what one of 64 does."""
    def megabytes(episodes: int) -> float:
        text = HEAD.replace("64", str(episodes)) + '[[strategy]]\nname = "ring6"\n'
        axis = '[sweep.grid]\n"sensors.tendon_threshold_N" = [' + ", ".join(
            str(3 + n / 100) for n in range(500)) + "]\n"
        return float(dict(estimate_cost(plan_of(tmp_path, text + axis)))["disk"].split()[1])

    assert 10.0 < megabytes(1) < 12.0  # 750 units of one episode took 16 MB
    assert 17.0 < megabytes(64) < 21.0  # one of 64 takes 31 to 47 kB
