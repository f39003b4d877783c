import re
from dataclasses import fields, replace
from math import copysign, degrees, isclose, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from fuzz_spec import fuzz
from hypothesis import given
from hypothesis import strategies as st
from studies import SMALL, write_spec

from strategies.poses.waypoints import WAYPOINT_KINDS, Ring, Top
from strategies.strategy import Strategy
from sweeps.run.plan import canonical_body
from sweeps.spec.cell import SECTIONS
from sweeps.spec.errors import Problems, SpecError
from sweeps.spec.reader import TOP, read_spec, spec_text
from sweeps.spec.strategies import KEYS
from sweeps.spec.study import Study
from sweeps.spec.template import spec_template
from sweeps.spec.units import spec_fields
from warpgrasp.objects.catalogue import body_from_table


def read(folder: Path, text: str, *overrides: str) -> Study:
    return read_spec(write_spec(folder, text), overrides)


def refusals(folder: Path, text: str, *overrides: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        read(folder, text, *overrides)
    return [str(problem).removeprefix(f"{folder}/") for problem in caught.value.problems]


def test_defaults_are_filled_in(tmp_path: Path) -> None:
    study = read(tmp_path, SMALL)
    assert study.head.name == "spec"
    assert study.tables == {name: table() for name, table in SECTIONS.items()}
    assert [s.name for s in study.strategies] == ["ring6", "mine"]
    assert study.strategies[1].waypoints == (Ring(count=3, tilt_rad=radians(70)),)
    assert study.cell_count == 4


def test_units_at_the_edge_become_si(tmp_path: Path) -> None:
    study = read(tmp_path, SMALL + "[hand]\nlink_radius_mm = 9\nflexion_low_deg = [-5, 0, 0]\n"
                 "[object]\nyaw_deg = 90\nx_mm = 500\n[arm]\nfinger_speed_deg_s = 180\n")
    assert study.tables["hand"].link_radius_m == 0.009
    assert study.tables["hand"].flexion_low_rad == (radians(-5), 0.0, 0.0)
    assert study.tables["object"].yaw_rad == radians(90)
    assert study.tables["object"].x_m == 0.5
    assert study.tables["arm"].finger_speed_rad_s == radians(180)


def test_compound_units_keep_their_names() -> None:
    hand = spec_fields(SECTIONS["hand"])
    assert {"joint_stiffness_Nm_rad", "skin_stiffness_N_m"} <= set(hand)
    assert hand["skin_stiffness_N_m"].to_si(5.0) == 5.0


@pytest.mark.parametrize("table", [*SECTIONS.values(), *WAYPOINT_KINDS.values()])
def test_every_default_passes_its_own_check(table: type) -> None:
    for field in spec_fields(table).values():
        if field.default in (None, ""):
            continue
        problems = Problems("x", {})
        given_value = field.spec_default
        value = field.read(list(given_value) if isinstance(given_value, tuple) else given_value,
                           (), problems)
        assert not problems.found
        if isinstance(field.default, str | bool):
            assert value == field.default
        else:
            assert np.allclose(value, field.default, rtol=1e-9)


@given(st.floats(0.011, 50.0))
def test_lengths_round_trip(value: float) -> None:
    field = spec_fields(SECTIONS["hand"])["link_radius_mm"]
    problems = Problems("x", {})
    read_back = field.read(value, (), problems)
    if 1.0 <= value <= 50.0:
        assert isclose(read_back * 1000, value, rel_tol=1e-15)
    else:
        assert problems.found


BAD_KEYS = [
    ("seed = 7", "seed = -1", "spec.toml:2: seed: is -1; should be a whole number from 0 to "),
    ("seed = 7", "seed = 1.5", "spec.toml:2: seed: is 1.5; should be a whole number from 0 to "),
    ("= 70\no", "= -70\no", "spec.toml:3: episodes_per_cell: is -70; should be a whole "
     "number from 1 to "),
    ("schema = 1", "schema = 2", "spec.toml:1: schema: is 2"),
    ("schema = 1\n", "", "spec.toml:1: schema: missing; write schema = 1"),
    ("seed", "sed", "spec.toml:2: sed: unknown key; did you mean seed?"),
    ('"block"', '"blok"', "spec.toml:4: objects[0]: no object 'blok'; did you mean block?"),
    ('"block"', '"wedge"', "spec.toml:4: objects[1]: is 'wedge' a second time"),
    ('["block", "wedge"]', "[]", "spec.toml:4: objects: is empty"),
    ('["block", "wedge"]', '"block"', "spec.toml:4: objects: is 'block'; should be a list"),
    ('"block"', '{ mesh = "no.stl", units = "m" }', "objects[0].mesh: 'no.stl' is not a file"),
    ('"block"', '{ units = "m" }', "objects[0]: should hold exactly one of mesh"),
    ("ring6", "rign6", "spec.toml:6: strategy[0].name: no ready-made strategy 'rign6'; did you "
     "mean ring6? there are: ring6, "),
    ('"mine"', '"ring6"', "spec.toml:8: strategy[1].name: is 'ring6' a second time"),
    ('"mine"', '"a\\nb"', "spec.toml:8: strategy[1].name: is 'a\\nb'; should be a name"),
    ('kind = "ring"', 'kind = "rnig"', "spec.toml:9: strategy[1].waypoints.kind: is 'rnig'; did "
     "you mean ring? there are: ring, column"),
    ("seed = 7", "seed = 9223372036900000000", "spec.toml:2: seed: is 9223372036900000000; should "
     "be a whole number from 0 to 9223372036854775807"),
    ("count = 3", "count = -3", "spec.toml:9: strategy[1].waypoints.count: is -3; should be"),
    ("count = 3", "cuont = 3", "strategy[1].waypoints.cuont: unknown key; did you mean count?"),
    ("tilt_deg = 70", "tilt_deg = nan", "waypoints.tilt_deg: is nan; should be a number "
     "from 0 to 180"),
    ("tilt_deg = 70", "tilt_deg = true", "waypoints.tilt_deg: is True; should be a number "
     "from 0 to 180"),
    ("tilt_deg = 70", f"tilt_deg = {10**400}", "waypoints.tilt_deg: "),
    ("tilt_deg = 70 }", "tilt_rad = 1 }", "waypoints.tilt_rad: unknown key; did you mean "
     "tilt_deg?"),
]


@pytest.mark.parametrize(("old", "new", "says"), BAD_KEYS)
def test_bad_keys_are_refused_with_line_and_remedy(
        tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in SMALL
    found = refusals(tmp_path, SMALL.replace(old, new, 1))
    assert any(says in line for line in found), found


BAD_TABLES = [
    ("[sensors]\ntendon_threshold = 3", "spec.toml:11: sensors.tendon_threshold: unknown key; did "
     "you mean tendon_threshold_N?"),
    ('[sensors]\ncontact_estimator = "tip"', "is 'tip'; there are: fingertip, intrinsic"),
    ("[hand]\nlink_radius_m = 0.008", "did you mean link_radius_mm?"),
    ("[hand]\nlink_length_mm = [40, 30]", "hand.link_length_mm: is [40, 30]; "
     "should be a list of 3 numbers, each from 5 to 200"),
    ("[arm]\nspeed_deg_s = 82", "arm.speed_deg_s: is 82; should be a list of 6 numbers, each from "
     "0.05729577951 to "),
    ("[hand]\nflexion_low_deg = [95, 0, 0]", "spec.toml:11: hand.flexion_low_deg: "
     "flexion_low_deg should be below flexion_high_deg"),
    ("[fit]\ntaper = 1", "fit.taper: is 1; should be true or false"),
    ("[sweep]\ngrd = 1", "sweep.grd: unknown key; did you mean grid?"),
    ("[sweep.grid]", "spec.toml:10: sweep.grid: is empty"),
    ('[sweep.grid]\n"sensors.tendon_threshold_N" = []', "should be a list of at least one value"),
    ('[sweep.grid]\n"sensors.tendon_threshold_N" = [1, 1]', "holds the same value twice"),
    ('[sweep.zip]\n"object.x_mm" = [450, 430, 450]\n"object.y_mm" = [0, 0, 0.0]',
     "spec.toml:10: sweep.zip: holds the same values twice, all keys at once"),
    ('[sweep.grid]\n"sensors.tendon_threshold" = [1]', "spec.toml:11: sweep.grid.'sensors."
     "tendon_threshold': unknown key 'sensors.tendon_threshold'; did you mean "
     "sensors.tendon_threshold_N?"),
    ('[sweep.grid]\n"sensors.tension_readings" = [1, -2]', "spec.toml:11: "
     "sweep.grid.'sensors.tension_readings'[1]: is -2; should be a whole number from "),
    ('[sweep.zip]\n"object.x_mm" = [1, 2]\n"object.y_mm" = [1]', "spec.toml:10: sweep.zip: lists "
     "should be equally long; object.x_mm has 2, object.y_mm has 1"),
    ('[sweep.grid]\n"object.x_mm" = [1]\n[sweep.zip]\n"object.x_mm" = [2]',
     "spec.toml:13: sweep.zip.'object.x_mm': object.x_mm is swept already in sweep.grid"),
    ('[sweep.sobol]\n"object.x_mm" = { low = 0, high = 1 }', "sweep.sobol.n: missing"),
    ('[sweep.sobol]\nn = -4\n"object.x_mm" = { low = 0, high = 1 }', "sweep.sobol.n: is -4"),
    ("[sweep.sobol]\nn = 4", "sweep.sobol: is empty"),
    ('[sweep.lhs]\nn = 4\n"object.x_mm" = { low = 2, high = 1 }', "low 2 should be below high 1"),
    ('[sweep.lhs]\nn = 4\n"object.x_mm" = [1, 2]', "should be a range such as"),
    ('[sweep.lhs]\nn = 4\n"hand.link_length_mm" = { low = [40, 30], high = [50, 40] }',
     "hand.link_length_mm'.low: is [40, 30]; should be a list of 3 numbers, each from 5 to "
     "200"),
    ('[sweep.lhs]\nn = 4\n"hand.link_length_mm" = { low = 40, high = [50, 40, 30] }', "is 40; "
     "should be a list of 3 numbers, each from 5 to 200"),
    ('[sweep.lhs]\nn = 4\n"hand.link_length_mm" = { low = [40, 30, 20], high = [50, 29, 30] }',
     "low [40, 30, 20] should be below high [50, 29, 30]"),
    ('[sweep.lhs]\nn = 4\n"object.x_mm" = { low = -5000, high = 1 }', "is -5000; should be"),
]


@pytest.mark.parametrize(("text", "says"), BAD_TABLES)
def test_bad_tables_are_refused_with_line_and_remedy(
        tmp_path: Path, text: str, says: str) -> None:
    found = refusals(tmp_path, SMALL + text + "\n")
    assert any(says in line for line in found), found


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


def test_every_problem_comes_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = SMALL.replace("seed = 7", "seed = -1").replace('"wedge"', '"wegde"').replace(
        "ring6", "rign6") + "[hand]\nlink = 3\n"
    found = refusals(tmp_path, text, "colour=3")
    assert [line.split(":")[1] for line in found[:-1]] == ["2", "4", "6", "11"]
    assert found[-1].startswith("--set: colour: ")


def test_a_trillion_episodes_are_refused_before_anything_is_expanded(tmp_path: Path) -> None:
    found = refusals(tmp_path, SMALL.replace("= 70\no", "= 1_000_000_000\no"))
    assert found == ["spec.toml:3: episodes_per_cell: makes 4,000,000,000 episodes in 4 cells; "
                     "the limit is 1,000,000,000"]
    lists = "".join(f'"hand.{name}" = {[v / 1000 for v in range(1, 1001)]}\n'
                    for name in ("tendon_friction",))
    many = f"[sweep.grid]\n{lists}" + '"object.x_mm" = ' + str(list(range(1000))) + (
        '\n"object.y_mm" = ' + str(list(range(1000))))
    text = SMALL + many.replace("1.0]", "0.0001]").replace("0.9", "0.0009")
    assert any("cells; the limit is" in line or "should be" in line
               for line in refusals(tmp_path, text))


def test_meshes_are_checked(tmp_path: Path) -> None:
    mug = trimesh.creation.box((80, 80, 80))
    mug.export(tmp_path / "mug.stl")
    mug.update_faces(np.arange(len(mug.faces)) > 0)
    mug.export(tmp_path / "open.stl")
    (tmp_path / "empty.stl").write_bytes(b"")

    def said(table: str) -> str:
        text = SMALL.replace('"block"', table)
        try:
            return f"ok {read(tmp_path, text).objects[0].name}"
        except SpecError as error:
            return str(error)

    assert said('{ mesh = "mug.stl", units = "mm" }') == "ok mug"
    assert said('{ mesh = "mug.stl", units = "mm", name = "cup" }') == "ok cup"
    for table in ('{ mesh = "mug.stl", units = "m" }', '{ mesh = "open.stl", units = "mm" }',
                  '{ mesh = "mug.stl" }'):
        assert "spec.toml:4: objects[0]: " in said(table)
    assert "spec.toml:4: objects[0].mesh: 'empty.stl' is empty" in said(
        '{ mesh = "empty.stl", units = "mm" }')


def test_a_mesh_is_known_by_its_content_not_its_path(tmp_path: Path) -> None:
    bodies = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        trimesh.creation.box((80, 80, 80)).export(folder / "mug.stl")
        text = SMALL.replace('"block"', '{ mesh = "mug.stl", units = "mm" }')
        bodies.append(read(folder, text).objects[0])
    assert bodies[0].table["mesh"] != bodies[1].table["mesh"]
    assert canonical_body(bodies[0]) == canonical_body(bodies[1])
    body_from_table(bodies[0].table, Path())
    trimesh.creation.box((80, 80, 81)).export(tmp_path / "b" / "mug.stl")
    assert canonical_body(read(tmp_path / "b", text).objects[0]) != canonical_body(bodies[1])


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


@pytest.mark.parametrize("name", ["none of these", "no answer"])
def test_no_object_has_the_name_of_an_answer(tmp_path: Path, name: str) -> None:
    text = SMALL.replace('"wedge"', f'{{ object = "wedge", name = "{name}" }}')
    found = refusals(tmp_path, text)
    assert len(found) == 1
    assert f"objects[1]: is named '{name}', which tables" in found[0]


def test_only_a_default_written_out_is_the_default() -> None:
    problems = Problems("", {})
    table = spec_fields(SECTIONS["arm"])
    written = [671.83, 0, 150.05, 431.8, 0, 0]
    assert table["d_mm"].read(written, (), problems) == table["d_mm"].default
    other = table["d_mm"].read([*written[:5], -0.0], (), problems)
    assert other[2] == 150.05 / 1000 != table["d_mm"].default[2]  # as it was before
    assert copysign(1.0, other[5]) == -1.0
    assert table["encoder_step_deg"].read(0.005729577952, (), problems) == radians(
        0.005729577952)
    assert not problems.found


def test_fuzzed_specs_are_read_or_refused(tmp_path: Path) -> None:
    counts, wrong = fuzz(tmp_path, 120, seed=1)
    assert not wrong, wrong[:3]
    assert counts["read"] >= 3


@pytest.mark.slow
def test_ten_thousand_fuzzed_specs_are_read_or_refused(tmp_path: Path) -> None:
    _, wrong = fuzz(tmp_path, 10_000, seed=2)
    assert not wrong, wrong[:3]


@pytest.mark.parametrize("own", ["", 'set = ["seed=8"]\n', 'set = [\n  "seed=8",\n]\n',
                                 '"set"=["seed=8"]  # as it was\n'])
def test_a_kept_spec_says_once_what_was_set(tmp_path: Path, own: str) -> None:
    """Whatever way its own key is written in."""
    text = own + SMALL + '[[strategy]]\nname = "q"\n[strategy.waypoints]\nkind = "ring"\n'
    file = write_spec(tmp_path, text)
    kept = spec_text(file, ["episodes_per_cell=2"]).decode()
    assert kept.count("episodes_per_cell=2") == 1
    (tmp_path / "kept.toml").write_text(kept)
    again = read_spec(tmp_path / "kept.toml")
    assert again.head.episodes_per_cell == 2
    assert again.head.seed == (8 if own else read_spec(file).head.seed)
    assert again.strategies == read_spec(file).strategies
