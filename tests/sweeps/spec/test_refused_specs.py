"""What is wrong with a spec is reported at once, with its line and what would be right."""

from pathlib import Path

import pytest
from fuzz_spec import fuzz
from studies import SMALL, refusals

BAD_KEYS = [
    ("seed = 7", "seed = -1", "spec.toml:2: seed: is -1; should be a whole number from 0 to "),
    ("seed = 7", "seed = 1.5", "spec.toml:2: seed: is 1.5; should be a whole number from 0 to "),
    ("= 70\no", "= -70\no", "spec.toml:3: episodes_per_cell: is -70; should be a whole "
     "number from 1 to "),
    ("schema = 1", "schema = 2", "spec.toml:1: schema: is 2; should be 1"),
    ("seed = 7", "hand = 3", "spec.toml:2: hand: is 3; should be a name (`warpgrasp hands` lists "
     "them) or a table"),
    ("seed = 7", 'arm = ["none"]', "spec.toml:2: arm: is ['none']; should be a name (`warpgrasp "
     "arms` lists them) or a table"),
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
    ("[object]\nyaw_deg = 1e300", "object.yaw_deg: is 1e+300; should be a number from -360 to 360"),
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


@pytest.mark.parametrize("name", ["none of these", "no answer"])
def test_no_object_has_the_name_of_an_answer(tmp_path: Path, name: str) -> None:
    text = SMALL.replace('"wedge"', f'{{ object = "wedge", name = "{name}" }}')
    found = refusals(tmp_path, text)
    assert len(found) == 1
    assert f"objects[1]: is named '{name}', which tables" in found[0]


def test_fuzzed_specs_are_read_or_refused(tmp_path: Path) -> None:
    counts, wrong = fuzz(tmp_path, 120, seed=1)
    assert not wrong, wrong[:3]
    assert counts["read"] >= 3


@pytest.mark.slow
def test_ten_thousand_fuzzed_specs_are_read_or_refused(tmp_path: Path) -> None:
    _, wrong = fuzz(tmp_path, 10_000, seed=2)
    assert not wrong, wrong[:3]
