"""Values that do not go together: pads and their links, thresholds and what tendons read."""

from dataclasses import replace
from pathlib import Path

import pytest
from studies import SMALL, write_spec

from sweeps.run.false_contacts import false_contact_warnings
from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec
from warpgrasp.arms.arm_file import arm_named, arm_text


def refusals(folder: Path, text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        read_spec(write_spec(folder, text))
    return [str(problem) for problem in caught.value.problems]


WIDE = "[hand]\nfinger_spacing_mm = 45\nlink_density_kg_m3 = 100\n"
PADS = [
    (WIDE + "link_radius_mm = 20\n", "spec.toml:14: hand.link_radius_mm: pad of 25.4 mm does not "
     "fit link 2 of 28 mm; should be 29.3 to 57.3 mm long"),
    ("[pads]\nmiddle = true\nlength_mm = 35\n", "spec.toml:13: pads.length_mm: pad of 35 mm does "
     "not fit link 1 of 33 mm; should be 0 to 33 mm long"),
    (WIDE + '[sweep.grid]\n"object.x_mm" = [450, 460]\n"hand.link_radius_mm" = [8, 20]\n'
     '"pads.wrap_deg" = [10, 80]\n', "spec.toml:14: sweep: with hand.link_radius_mm = 20, "
     "pads.wrap_deg = 80: pad of 25.4 mm does not fit link 2"),
    ("[pads]\nwidth_mm = 30\n", "spec.toml:12: pads.width_mm: pad of 30 mm is wider than the "
     "palmar half of a link; width_mm should be 28.3 mm at most"),
    ("[hand]\nlink_radius_mm = 2\n", "spec.toml:12: hand.link_radius_mm: pad of 12.7 mm is wider"),
    ("[pads]\nmiddle = true\ndistal = false\n", "spec.toml:13: pads.distal: no pad on the distal "
     "links, with which planar, contour and decide feel; pads.distal should be true"),
    ("[pads]\nrest_ohm = 500\n", "spec.toml:12: pads.rest_ohm: pad of 1000 ohm under load"),
    ("[pads]\nfloor_N = 5\n", "spec.toml:12: pads.floor_N: taxels feel from 5 N on"),
]


@pytest.mark.parametrize(("text", "says"), PADS)
def test_pads_fit_their_links_where_a_strategy_feels(
        tmp_path: Path, text: str, says: str) -> None:
    feels = SMALL + 'order = ["containment", "planar"]\n'
    found = refusals(tmp_path, feels + text)
    assert len(found) == 1
    assert says in found[0]
    swept = '"pads.wrap_deg" = [10, 80]\n'
    read_spec(write_spec(tmp_path, SMALL + text.replace(swept, "")))  # only grasps
    order = '"strategy.order" = [["containment"], ["decide"]]\n'
    text += order if "[sweep" in text else f"[sweep.grid]\n{order}"
    assert refusals(tmp_path, SMALL + text)


@pytest.mark.parametrize(("more", "says"), [
    ("", ""), ("[hand]\ntendon_friction = 0.1\n", ""),
    ("[hand]\nco_contraction_N = 200\n", "friction and noise of tendons read up to 30.1 N"),
    ("[sensors]\ntension_noise_N = 5\n", "fingers stop from 6 N on: some contacts"),
    ('[sweep.grid]\n"sensors.tendon_threshold_N" = [6, 2]\n',
     "with sensors.tendon_threshold_N = 2: friction"),
    ("[pads]\nnoise_counts = 4\n", ""),
    ('order = ["contour"]\n[pads]\nnoise_counts = 4\n', "threshold in 1 of a pad's readings"),
    ('order = ["planar"]\n[sweep.grid]\n"pads.threshold_counts" = [6, 4]\n',
     "with pads.threshold_counts = 4: noise alone"),
    ("[sensors]\njoint_noise_deg = 1\n", ""),
    ('order = ["contour"]\n[sensors]\njoint_noise_deg = 1\n', "past pads.yield_deg = 1.5"),
    ("[sensors]\ntension_step_N = 2\n", "steps of 2 N are large beside noise of 0.3 N"),
    ('order = ["planar"]\n[sensors]\ntendon_threshold_N = 1\ntension_step_N = 2\n', ""),
])
def test_a_threshold_that_noise_passes_is_told(
        tmp_path: Path, more: str, says: str) -> None:
    """That of tendons only where fingers close."""
    alone = SMALL.replace('name = "ring6"', 'name = "ring6"\norder = ["planar"]')
    text = (alone if "planar" in more else SMALL) + more
    found = "".join(false_contact_warnings(read_spec(write_spec(tmp_path, text))))
    assert says in found
    assert bool(found) == bool(says)


@pytest.mark.parametrize("hand", ["allegro", "leap", "barrett"])
@pytest.mark.parametrize(("more", "says"), [
    ("", ""), ("[sensors]\ntorque_step_Nm = 0.006\n", ""),
    # 0.0505 N m, which a converter with these steps reads as 0.048
    ("[sensors]\ntorque_step_Nm = 0.006\ntorque_friction_Nm = 0.0355\n", ""),
    ("[sensors]\ntorque_friction_Nm = 0.1\n", "of torques read up to 0.115 N m where nothing"),
    ("[sensors]\ntorque_noise_Nm = 0.05\n", "fingers stop from 0.05 N m on: some contacts"),
    ('[sweep.grid]\n"sensors.torque_threshold_Nm" = [0.05, 0.005]\n',
     "with sensors.torque_threshold_Nm = 0.005: friction and noise of torques read up to 0.025"),
    ("[sensors]\ntorque_step_Nm = 0.2\n", "steps of 0.2 N m are large beside noise of 0.003 N m"),
])
def test_a_threshold_that_noise_of_torques_passes_is_told(
        tmp_path: Path, hand: str, more: str, says: str) -> None:
    """Steps of 0.2 N m swallow friction and noise."""
    text = f'hand = "{hand}"\n' + SMALL + more
    found = [*false_contact_warnings(read_spec(write_spec(tmp_path, text)))]
    assert len(found) == bool(says)
    assert says in "".join(found)
    feels = SMALL.replace('name = "ring6"', 'name = "ring6"\norder = ["planar"]')
    text = f'hand = "{hand}"\n' + feels + 'order = ["planar"]\n' + more
    assert not [*false_contact_warnings(read_spec(write_spec(tmp_path, text)))]


def test_a_sweep_of_hands_is_told_of_those_that_read_torques(tmp_path: Path) -> None:
    sensors = "[sensors]\ntorque_noise_Nm = 0.05\ntendon_threshold_N = 1\n"
    text = SMALL + sensors + '[sweep.grid]\nhand = ["utah_mit", "allegro"]\n'
    tendons, torques = false_contact_warnings(read_spec(write_spec(tmp_path, text)))
    assert tendons.startswith("with hand.kind = utah_mit: friction and noise of tendons")
    assert torques.startswith("with hand.kind = allegro: friction and noise of torques")


@pytest.mark.parametrize(("more", "place", "says"), [
    ("[hand]\nabduction_limit_deg = [25, -25]\n", "11: hand.abduction_limit_deg",
     "is 25, -25; the first should be below the second"),
    ("[arm]\nd_mm = [671.83, 0.0, 150.05, 431.8, 0.0, 55.8]\n", "11: arm.d_mm",
     "wants d2 = d5 = d6 = a1 = a4 = a5 = a6 = 0"),
    ("[arm]\nlimit_low_deg = [-160, -35, -190, -266, -100, -266]\n", "11: arm.limit_low_deg",
     "joint 3 is limited to -190 to 45 deg; should include -200"),
    ('[sweep.grid]\n"arm.a_mm" = [[0, 431.8, 20.3, 0, 0, 0], [10, 431.8, 20.3, 0, 0, 0]]\n',
     "10: sweep", "a1"),
])
def test_an_arm_and_a_hand_that_cannot_be_moved_are_refused(
        tmp_path: Path, more: str, place: str, says: str) -> None:
    found, = refusals(tmp_path, SMALL + more)
    assert found.startswith(f"{tmp_path}/spec.toml:{place}")
    assert says in found


METRES = ("[object]\nx_mm = 0.45\n", 'x_mm = 0.45, y_mm = 0 is where the arm itself stands; should '
          "be 100 mm or more from x_mm = 0, y_mm = 0; lengths are in mm: did you mean x_mm = 450, "
          "y_mm = 0?")


def test_an_object_in_the_arms_column_is_refused(tmp_path: Path) -> None:
    """Metres written for millimetres gave a leaderboard."""
    text, says = METRES
    assert refusals(tmp_path, SMALL + text) == [f"{tmp_path}/spec.toml:11: object.x_mm: {says}"]
    for arm in ("ur5e", "panda"):
        assert says.partition(";")[0] in refusals(tmp_path, f'arm = "{arm}"\n' + SMALL + text)[0]
    swept = '[sweep.grid]\n"object.x_mm" = [450, -60]\n'
    found, = refusals(tmp_path, SMALL + swept)
    assert "sweep: with object.x_mm = -60: x_mm = -60, y_mm = 0 is where the arm" in found
    assert "did you mean" not in found
    drawn = '[sweep.sobol]\nn = 8\n"object.x_mm" = { low = 0.43, high = 0.47 }\n'
    assert "is where the arm itself stands" in refusals(tmp_path, SMALL + drawn)[0]


@pytest.mark.parametrize(("space", "says"), [
    ('"object.x_mm" = { low = 0.43, high = 0.47 }\n', "with object.x_mm = 0.43: x_mm = 0.43"),
    ('"object.x_mm" = { low = -450, high = 450 }\n', "with object.x_mm = 0.0: x_mm = 0, y_mm = 0"),
    ('"object.x_mm" = { low = -450, high = 450, step = 300 }\n', ""),
    ('"object.x_mm" = { low = -450, high = 450, step = 90 }\n', "with object.x_mm = 0: x_mm = 0"),
    ('"object.x_mm" = [50, 450]\n"object.y_mm" = { low = 0, high = 50, when = '
     '{ "object.x_mm" = [450] } }\n', "with object.x_mm = 50: x_mm = 50, y_mm = 0"),
    ('"object.x_mm" = [450]\n"object.y_mm" = { low = 0, high = 50 }\n', ""),
])
def test_a_space_that_holds_the_arms_column_is_refused(tmp_path: Path, space: str,
                                                       says: str) -> None:
    text = ('schema = 1\nobjects = ["block"]\n[[strategy]]\nname = "ring"\n'
            f'waypoints = {{ kind = "ring", count = 6 }}\n[search]\n{space}')
    if says:
        found, = refusals(tmp_path, text)
        assert f"search: {says}" in found
    else:
        read_spec(write_spec(tmp_path, text))


def test_keys_that_no_strategy_reads_are_refused(tmp_path: Path) -> None:
    """One entry was ranked alone; a race of such points ended in an error of its own."""
    text = ('schema = 1\nobjects = ["block"]\n[[strategy]]\nname = "ring"\n'
            'waypoints = { kind = "ring", count = 6 }\n')
    key = '"contour.axis" = ["vertical", "fit"]\n'
    for table, says in (("sweep.grid", "changes nothing in this study: no strategy reads it"),
                        ("search", "no key of it says anything of the strategy")):
        assert says in refusals(tmp_path, f"{text}[{table}]\n{key}")[0]


def test_a_place_without_a_column_is_taken(tmp_path: Path) -> None:
    """A floating wrist has none; an arm may hang from above; beside it there is room."""
    text = METRES[0]
    read_spec(write_spec(tmp_path, 'arm = "none"\n' + SMALL + text))
    read_spec(write_spec(tmp_path, SMALL + text + "y_mm = -120\n"))
    arm = arm_named("ur5e")
    (tmp_path / "hung.toml").write_text(arm_text(replace(arm, base_xyz_m=(0.0, 0.0, 1.2))))
    (tmp_path / "beside.toml").write_text(arm_text(replace(arm, base_xyz_m=(0.44, 0.0, 0.0))))
    read_spec(write_spec(tmp_path, 'arm = "hung.toml"\n' + SMALL + text))
    assert "from x_mm = 440, y_mm = 0" in refusals(tmp_path, 'arm = "beside.toml"\n' + SMALL)[0]
    together = '[sweep.zip]\narm = ["none", "puma560"]\n"object.x_mm" = [0, 450]\n'
    read_spec(write_spec(tmp_path, SMALL + together))


FEELS = 'order = ["contour"]\n'


@pytest.mark.parametrize(("more", "place", "says"), [
    (FEELS + "[errors]\nscale = 4\n", "12: errors.scale", "pad_gain_pct times scale is 40 %"),
    (FEELS + "[errors]\npad_gain_pct = 40\n", "12: errors.pad_gain_pct", "pad_gain_pct times"),
    ("[errors]\nlink_length_pct = 10\nscale = 4\n", "11: errors.link_length_pct",
     "link_length_pct times scale is 40 %"),
    ("[errors]\nscale = 7\n", "11: errors.scale", "moment_arm_pct times scale is 35 %"),
    ('[sweep.grid]\n"errors.scale" = [1, 3, 7]\n', "10: sweep", "moment_arm_pct times scale is"),
    ('[search]\n"errors.scale" = { low = 1, high = 6.7 }\n', "7: search", "is 33.5 %")])
def test_errors_that_turn_a_factor_round_are_refused(
        tmp_path: Path, more: str, place: str, says: str) -> None:
    """Tendons would be read with the wrong sign, and pads be dead."""
    text = SMALL[:SMALL.rindex("[[")] if "search" in more else SMALL  # which is of one strategy
    found, = refusals(tmp_path, text + more)
    assert found.startswith(f"{tmp_path}/spec.toml:{place}: ")
    assert says in found
    assert found.endswith("which would make a factor zero or less; should be below 33 %")


@pytest.mark.parametrize("whose", ["truth", "belief"])
def test_errors_of_the_robot_that_is_not_swept_are_refused_too(tmp_path: Path, whose: str) -> None:
    text = (f'[errors]\nscale = 7\n[robot]\nswept = "{whose}"\n'
            '[sweep.grid]\n"errors.scale" = [0, 1]\n')
    found, = refusals(tmp_path, SMALL + text)
    assert found.startswith(f"{tmp_path}/spec.toml:11: errors.scale: of the robot that is not "
                            "swept: moment_arm_pct times scale is 35 %")
    read_spec(write_spec(tmp_path, SMALL + text.replace(whose, "both")))


def test_limits_of_the_robot_that_is_not_swept_are_in_order(tmp_path: Path) -> None:
    text = ('[hand]\nflexion_low_deg = [100, 0, 0]\n[robot]\nswept = "truth"\n'
            '[sweep.grid]\n"hand.flexion_low_deg" = [[0, 0, 0], [-5, 0, 0]]\n')
    found, = refusals(tmp_path, SMALL + text)
    assert found.endswith("spec.toml:11: hand.flexion_low_deg: of the robot that is not swept: "
                          "flexion_low_deg should be below flexion_high_deg")
    read_spec(write_spec(tmp_path, SMALL + text.replace("truth", "both")))


def test_errors_as_large_as_they_may_be_are_taken(tmp_path: Path) -> None:
    """Gains of pads do not count where nothing feels with them."""
    read_spec(write_spec(tmp_path, SMALL + "[errors]\nscale = 6.6\n"))
    read_spec(write_spec(tmp_path, SMALL + FEELS + "[errors]\nscale = 3.3\n"))
