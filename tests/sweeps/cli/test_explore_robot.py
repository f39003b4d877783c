"""`explore` with another hand and arm."""

import csv
import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from sweeps.cli import main as cli
from sweeps.cli.app import UsageError
from sweeps.cli.explore import _check_apart
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.parameters import ArmTable


@pytest.mark.parametrize(("options", "said"), [
    (["--hand", "alegro"], "--hand: no hand 'alegro'; did you mean allegro"),
    (["--hand", "mine.toml"], "--hand: 'mine.toml' is not a file"),
    (["--arm", "ur5"], "--arm: no arm 'ur5'; did you mean ur5e"),
    (["--hand", "heavy.toml"], "--hand: finger finger1 sags by its own weight"),
])
def test_a_robot_that_is_none_is_refused(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Also a hand that sags by its own weight, as a study refuses it."""
    monkeypatch.chdir(tmp_path)
    text = hand_text(hand_named("barrett"))
    Path("heavy.toml").write_text(
        text.replace("stiffness_Nm_rad = ", "stiffness_Nm_rad = 1e-6 # "))
    assert cli.run(["explore", "block", *options, "-o", "out"]) == 2
    assert said in capsys.readouterr().err
    assert not Path("out").exists()


def test_another_hand_explores(tmp_path: Path) -> None:
    """A copy of one that ships, on no arm: its fingers alone have rows, and touch within reach."""
    hand = tmp_path / "three.toml"
    hand.write_text(hand_text(hand_named("barrett")))
    out = tmp_path / "out"
    assert cli.run(["explore", "block", "--strategy", "ring6", "--hand", str(hand), "--arm", "none",
                    "--seed", "4", "-o", str(out)]) == 0
    with (out / "contacts.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["finger"] for row in rows} == {"0", "1", "2"}
    assert not any(row["q3_rad"] for row in rows)  # three joints a finger, two of them driven
    touched = [row for row in rows if row["true_x_m"]]
    assert touched
    hand_m, point_m = (np.array([[float(row[f"{of}_{axis}_m"]) for axis in "xyz"]
                                 for row in touched]) for of in ("hand", "true"))
    assert np.linalg.norm(hand_m - point_m, axis=1).max() < 0.25
    assert json.loads((out / "shape.json").read_text())["metrics"]


@pytest.mark.parametrize(("arm", "x_m", "stands"), [
    ("puma560", 0.05, True), ("puma560", 0.45, False), ("none", 0.05, False),
    ("panda", 0.05, True)])
def test_an_object_is_kept_out_of_the_column_of_the_arm_that_is_given(
        arm: str, x_m: float, stands: bool) -> None:
    with pytest.raises(UsageError, match="arm itself") if stands else nullcontext():
        _check_apart(ArmTable(kind=arm), x_m, 0.0)
