"""The comparisons with other engines: small ones here, the whole by `make validate`."""

import importlib
import importlib.util
import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from sweeps.cli.main import run
from sweeps.validate.bodies.scores import compare_metrics
from sweeps.validate.command import CHECKS
from sweeps.validate.comparison import HEADER, Comparison, MissingEngine, engine
from sweeps.validate.signed_distances import compare_distances

NO_MUJOCO = importlib.util.find_spec("mujoco") is None
NO_TOOLBOX = importlib.util.find_spec("roboticstoolbox") is None


def broken(rows: list[Comparison]) -> list[Comparison]:
    return [row for row in rows if not row.ok]


def test_a_row_keeps_or_breaks_its_bound() -> None:
    row = Comparison("c", "what", "m", 1.0, 1.1, 0.1, 0.2)
    assert row.ok
    assert len(row.cells()) == len(HEADER)
    assert not Comparison("c", "what", "m", 1.0, 1.3, 0.3, 0.2).ok
    assert not Comparison("c", "what", "m", 1.0, np.nan, np.nan, 0.2).ok
    assert Comparison("c", "no promise", "m", 1.0, 1.3, 0.3).ok


def test_a_missing_engine_is_named() -> None:
    with pytest.raises(MissingEngine, match="an_engine_that_is_not_there is not installed"):
        engine("an_engine_that_is_not_there")


@pytest.mark.skipif(NO_MUJOCO, reason="MuJoCo is not installed: make validate")
@pytest.mark.parametrize("name", CHECKS)
def test_every_check_is_where_the_command_looks(name: str) -> None:
    module = importlib.import_module(f"sweeps.validate.{CHECKS[name]}")
    assert callable(getattr(module, f"compare_{name}"))


def test_an_unknown_check_is_refused(capsys) -> None:
    assert run(["validate", "--only", "pumas"]) == 2
    assert "puma" in capsys.readouterr().err


@pytest.mark.skipif(NO_MUJOCO, reason="MuJoCo is not installed: make validate")
def test_pads_against_integral_and_mujoco() -> None:
    from sweeps.validate.pads import compare_pads

    assert not broken(compare_pads())


@pytest.mark.skipif(NO_MUJOCO, reason="MuJoCo is not installed: make validate")
@pytest.mark.slow
@pytest.mark.parametrize("rubs", [False, True])
def test_a_few_closings_of_another_hand_against_mujoco(rubs: bool) -> None:
    from sweeps.validate.any_hand import ALONE, BOUNDS, RUBBING, rows_of_tally, tally_of

    contact = RUBBING if rubs else ALONE
    tally = tally_of("barrett", "cylinder", 2, contact)
    assert min(tally.stops) > 5
    assert not broken(list(rows_of_tally("barrett", tally, BOUNDS[contact])))


def coupled(folder: Path) -> str:
    """A file of the Barrett hand as it is built, outer joints following inner ones by a third; the
    second finger's all follow the first one's."""
    text = (files("warpgrasp.hands") / "data" / "barrett.toml").read_text()
    led = {f"finger_{n}_dist_joint": (f"finger_{leader}_med_joint", 0.32)
           for n, leader in ((1, 1), (2, 1), (3, 3))}
    led["finger_2_med_joint"] = "finger_1_med_joint", 1.0
    for name, (leader, factor) in led.items():
        text = re.sub(f'^"{name}" = .*\n|, "{name}"', "", text, flags=re.MULTILINE)
        text = text.replace(f'name = "{name}"', f'name = "{name}"\nfollows = '
                            f'{{ joint = "{leader}", factor = {factor}, offset_deg = 0.0 }}')
    # What it feels does not count: all are compared by torques.
    text = text.replace('senses = "joint_torques"', 'senses = "tip_switches"')
    file = folder / "coupled.toml"
    file.write_text(text)
    return str(file)


@pytest.mark.skipif(NO_MUJOCO, reason="MuJoCo is not installed: make validate")
@pytest.mark.parametrize("rubs", [False, True])
def test_closings_of_joints_that_follow_against_mujoco(rubs: bool, tmp_path: Path) -> None:
    from sweeps.validate.any_hand import ALONE, BOUNDS, RUBBING, rows_of_tally, tally_of

    contact = RUBBING if rubs else ALONE
    tally = tally_of(coupled(tmp_path), "cylinder", 2, contact)
    assert min(tally.stops) > 5
    assert not broken(list(rows_of_tally("coupled", tally, BOUNDS[contact])))


@pytest.mark.skipif(NO_MUJOCO, reason="MuJoCo is not installed: make validate")
def test_a_hand_with_closings_of_its_own_is_no_hand_of_a_file(capsys) -> None:
    assert run(["validate", "--only", "hands", "--hand", "utah_mit"]) == 2
    assert "which the check `closing` compares" in capsys.readouterr().err
    assert run(["validate", "--only", "hands", "--hand", "nowhere.toml"]) == 2
    assert "nowhere.toml" in capsys.readouterr().err


@pytest.mark.skipif(NO_MUJOCO, reason="MuJoCo is not installed: make validate")
@pytest.mark.parametrize(("name", "rubs"), [
    pytest.param("box", False, marks=pytest.mark.slow), ("cylinder", True)])
def test_a_few_closings_against_mujoco(name: str, rubs: bool) -> None:
    from sweeps.validate.guarded_closing import FREE, RUBBING, compare_body

    rows = compare_body(name, 2, RUBBING if rubs else FREE)
    assert rows
    assert not broken(rows)


@pytest.mark.skipif(NO_TOOLBOX, reason="roboticstoolbox is not installed: make validate")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.slow
def test_puma_against_the_toolbox() -> None:
    from sweeps.validate.puma import compare_puma

    assert not broken(compare_puma(200))


@pytest.mark.slow
def test_distances_and_metrics() -> None:
    pytest.importorskip("rtree", reason="rtree is not installed: make validate")
    assert not broken([*compare_distances(), *compare_metrics(4, objects=4)])


@pytest.mark.skipif(NO_TOOLBOX, reason="roboticstoolbox is not installed: make validate")
@pytest.mark.filterwarnings("ignore")
def test_arms_against_the_toolbox_and_mujoco() -> None:
    from sweeps.validate.serial_arms import compare_arms

    assert not broken(compare_arms(50))
