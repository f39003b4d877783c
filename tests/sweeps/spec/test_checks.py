"""Values that do not go together: pads and their links, thresholds and what tendons read."""

from pathlib import Path

import pytest
from studies import SMALL, write_spec

from sweeps.spec.errors import SpecError
from sweeps.spec.false_contacts import false_contacts
from sweeps.spec.reader import read_spec


def refusals(folder: Path, text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        read_spec(write_spec(folder, text))
    return [str(problem) for problem in caught.value.problems]


PADS = [
    ("[hand]\nlink_radius_mm = 20\n", "spec.toml:12: hand.link_radius_mm: pad of 25.4 mm does not "
     "fit link 2 of 28 mm; should be 29.3 to 57.3 mm long"),
    ("[pads]\nmiddle = true\nlength_mm = 35\n", "spec.toml:13: pads.length_mm: pad of 35 mm does "
     "not fit link 1 of 33 mm; should be 0 to 33 mm long"),
    ('[sweep.grid]\n"object.x_mm" = [450, 460]\n"hand.link_radius_mm" = [8, 20]\n'
     '"pads.wrap_deg" = [10, 80]\n', "spec.toml:11: sweep: with hand.link_radius_mm = 20, "
     "pads.wrap_deg = 80: pad of 25.4 mm does not fit link 2"),
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
])
def test_a_threshold_that_noise_passes_is_told(
        tmp_path: Path, more: str, says: str) -> None:
    found = "".join(false_contacts(read_spec(write_spec(tmp_path, SMALL + more))))
    assert says in found
    assert bool(found) == bool(says)
