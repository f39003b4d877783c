"""Units of keys: what a spec writes in mm and degrees, the program has in SI."""

from math import copysign, isclose, radians
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from studies import SMALL, read

from strategies.poses.waypoints import WAYPOINT_KINDS
from sweeps.spec.cell import SECTIONS
from sweeps.spec.errors import Problems
from sweeps.spec.units import spec_fields


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
