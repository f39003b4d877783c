"""Axes of a sweep: their settings, what they draw, and which values do not go together."""

from itertools import product
from math import degrees, isclose, radians
from pathlib import Path

import numpy as np
import pytest
from studies import SMALL, read, refusals

from strategies.poses.waypoints import Ring, Top

LOW, HIGH = '"hand.flexion_low_deg" = ', '"hand.flexion_high_deg" = '


def flexions(*first: float) -> str:
    """A list of values of a limit of the three flexions, of which the first differs."""
    return f"[{', '.join(f'[{value}, 40, 40]' for value in first)}]"


@pytest.mark.parametrize("text", [
    f"[sweep.grid]\n{LOW}{flexions(2, 91)}",
    f"[sweep.grid]\n{HIGH}{flexions(100, -20)}",
    f"[sweep.grid]\n{LOW}[[2, 0, 0], [50, 0, 0]]\n{HIGH}{flexions(40, 130)}",
    f"[sweep.zip]\n{LOW}[[2, 0, 0], [50, 0, 0]]\n{HIGH}{flexions(130, 40)}",
    f"[sweep.grid]\n{LOW}[[2, 0, 0], [50, 0, 0]]\n[hand]\nflexion_high_deg = [40, 40, 40]",
    '[sweep.grid]\n"arm.limit_low_deg" = [[160.0, -35.0, -225.0, -266.0, -100.0, -266.0]]',
    '[sweep.grid.hand]\nflexion_low_deg = [[-10.0, 0.0, 0.0], [95.0, 96.0, 96.0]]',
])
def test_lower_limits_above_upper_ones_are_refused_in_sweeps(tmp_path: Path, text: str) -> None:
    found = refusals(tmp_path, SMALL + text + "\n")
    assert len(found) == 1
    assert found[0].startswith("spec.toml:1")
    assert "at every point of the sweep" in found[0]


@pytest.mark.parametrize("text", [
    f"[sweep.zip]\n{LOW}[[2, 0, 0], [50, 0, 0]]\n{HIGH}{flexions(40, 60)}",
    f"[sweep.grid]\n{HIGH}{flexions(95, 99)}\n[hand]\nflexion_low_deg = [20, 0, 0]",
])
def test_lower_limits_below_upper_ones_can_be_swept(tmp_path: Path, text: str) -> None:
    assert read(tmp_path, SMALL + text + "\n").axes


def test_settings_are_the_product_of_the_axes(tmp_path: Path) -> None:
    study = read(tmp_path, SMALL + """
[sweep.grid]
"sensors.tendon_threshold_N" = [3, 6.0]
strategy.count = [4, 5, 6]
[sweep.zip]
"object.x_mm" = [400, 500]
"object.y_mm" = [0, 10]
[sweep.sobol]
n = 5
"object.yaw_deg" = { low = -180, high = 180 }
"sensors.tension_readings" = { low = 1, high = 3 }
""")
    assert study.setting_count == 2 * 3 * 2 * 5
    seen = {repr(study.setting(n)) for n in range(study.setting_count)}
    assert len(seen) == study.setting_count
    edge, si = study.setting(study.setting_count - 1)
    assert (edge["sensors.tendon_threshold_N"], edge["strategy.count"]) == (6.0, 6)
    assert (edge["object.x_mm"], si["object.x_mm"]) == (500, 0.5)
    cell = study.cell(1, 0, study.setting_count - 1)
    assert cell.strategy.waypoints == (Ring(count=6, tilt_rad=radians(70)),)
    assert cell.placement.yaw_rad is not None
    assert isclose(degrees(cell.placement.yaw_rad), edge["object.yaw_deg"])
    assert cell.sensors.tension_readings in (1, 2, 3)
    assert cell.sensors.tendon_threshold_N == 6.0


def test_a_strategy_key_reaches_every_family_that_has_it(tmp_path: Path) -> None:
    text = SMALL.replace('waypoints = { kind = "ring", count = 3, tilt_deg = 70 }',
                         'waypoints = [{ kind = "ring" }, { kind = "top" }]')
    study = read(tmp_path, text + '[sweep.grid]\n"strategy.count" = [4]\n'
                 '"strategy.closings" = [["curl25"], ["curl40", "curl55"]]\n')
    cell = study.cell(1, 0, 1)
    assert cell.strategy.waypoints == (Ring(count=4), Top(count=4))
    assert cell.strategy.closings == ("curl40", "curl55")


def test_sampled_axes_depend_on_the_seed_alone(tmp_path: Path) -> None:
    for kind in ("sobol", "lhs"):
        text = SMALL + f'[sweep.{kind}]\nn = 16\n"object.yaw_deg" = {{ low = -180, high = 180 }}\n'
        first, again = read(tmp_path, text), read(tmp_path, text)
        other = read(tmp_path, text.replace("seed = 7", "seed = 8"))
        assert first.axes == again.axes != other.axes
        cells = sorted(int((v[0] + 180) // 22.5) for v in first.axes[0].values)
        assert cells == list(range(16))  # one draw in each sixteenth


def test_whole_numbers_are_drawn_up_to_both_ends(tmp_path: Path) -> None:
    text = '[sweep.sobol]\nn = 16\n"sensors.tension_readings" = { low = 1, high = 4 }\n'
    (axis,) = read(tmp_path, SMALL + text).axes
    assert sorted(values[0] for values in axis.values) == sorted(4 * [1, 2, 3, 4])


def test_the_last_axis_runs_fastest(tmp_path: Path) -> None:
    study = read(tmp_path, SMALL + """
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 6.0]
"object.yaw_deg" = [0, 45, 90]
""")
    given = [tuple(study.setting(n)[0].values()) for n in range(6)]
    assert given == [*product((3.0, 6.0), (0, 45, 90))]


@pytest.mark.parametrize("swept", ["truth", "belief"])
def test_what_is_swept_of_one_robot_alone_leaves_the_other(tmp_path: Path, swept: str) -> None:
    study = read(tmp_path, SMALL + f"""
[robot]
swept = "{swept}"
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 9.0]
""")
    for setting, value in enumerate((3.0, 9.0)):
        cell = study.cell(0, 0, setting)
        assert cell.true is not None
        assert (cell.true.sensors.tendon_threshold_N, cell.sensors.tendon_threshold_N) == (
            (value, 6.0) if swept == "truth" else (6.0, value))


def test_a_range_of_lists_draws_every_number_for_itself(tmp_path: Path) -> None:
    sampled = """[sweep.sobol]
n = 16
"hand.link_length_mm" = { low = [40, 30, 28], high = [48, 38, 28] }
"object.yaw_deg" = { low = -180, high = 180 }
"""
    (axis,) = read(tmp_path, SMALL + sampled).axes
    lengths = np.array([values[0] for values in axis.values])
    assert lengths.shape == (16, 3)
    for column, low in ((0, 40), (1, 30)):  # each balanced in its own eighths
        assert sorted((lengths[:, column] - low) // 1.0) == sorted(2 * list(range(8)))
    assert abs(np.corrcoef(lengths[:, :2].T)[0, 1]) < 0.5
    assert set(lengths[:, 2]) == {28.0}
    np.testing.assert_allclose([si[0] for si in axis.si], lengths * 1e-3)


def test_an_option_of_a_planner_can_be_swept(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "class Mine:\n"
        "    def __init__(self, poses=3):\n"
        "        if poses < 1:\n"
        "            raise ValueError('poses: at least 1')\n"
        "    def __call__(self, belief):\n"
        "        return []\n")
    text = SMALL + """[[strategy]]
name = "planned"
strategy = "mine.py:Mine"
options = { poses = 2 }
[sweep.grid]
"strategy.options.poses" = [4, 8]
"""
    study = read(tmp_path, text)
    assert [study.cell(2, 0, n).strategy.options for n in (0, 1)] == [
        (("poses", 4),), (("poses", 8),)]
    assert study.cell(0, 0, 1).strategy.options == ()
    assert any("poses: at least 1" in line
               for line in refusals(tmp_path, text.replace("[4, 8]", "[4, 0]")))
    for wrong in ("[4]", "nan", "inf"):
        assert any("should be a finite number, a text or a boolean" in line
                   for line in refusals(tmp_path, text.replace("[4, 8]", f"[{wrong}, 8]")))
    assert any("unknown key 'strategy.options.pose'" in line
               for line in refusals(tmp_path, text.replace("options.poses", "options.pose")))
