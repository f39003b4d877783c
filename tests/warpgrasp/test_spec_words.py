"""Parameter tables take the words of a spec in Python."""

import math
from dataclasses import fields, replace
from math import radians
from typing import Any

import numpy as np
import pytest

from strategies.poses.waypoints import WAYPOINT_KINDS, Column, Ring
from sweeps.spec.cell import SECTIONS
from sweeps.spec.units import spec_fields
from warpgrasp.parameters import ErrorTable, FitTable, HandTable, ObjectTable, PadTable, SensorTable


def test_the_words_of_a_spec_and_the_fields_make_the_same_table() -> None:
    assert Ring(count=4, tilt_deg=50, palm_clearance_mm=30) == Ring(  # type: ignore[call-arg]
        count=4, tilt_rad=radians(50), palm_clearance_m=0.03)
    assert HandTable(link_length_mm=[40, 30, 20]).link_length_m == (0.04, 0.03, 0.02)  # type: ignore[call-arg]


@pytest.mark.parametrize("table", [*WAYPOINT_KINDS.values(), SensorTable, HandTable])
def test_every_word_of_a_spec_is_taken(table: type) -> None:
    for word, field in spec_fields(table).items():
        value = field.spec_default
        if value is not None:
            assert getattr(table(**{word: value}), field.name) == pytest.approx(field.default)


@pytest.mark.parametrize("table", [*WAYPOINT_KINDS.values(), SensorTable, HandTable])
def test_values_by_place_are_those_by_name(table: type) -> None:
    """Fields that a kind does not use have no place: Column's seventh value is `count`."""
    named = {f.name: f.default for f in fields(table) if f.init}
    assert table(*named.values()) == table(**named) == table()
    assert Column(0.04, 1.5, 0.0, 0.0, 0.5, 0.0, 6).count == 6


@pytest.mark.parametrize("table", [*WAYPOINT_KINDS.values(), *SECTIONS.values()])
def test_the_bounds_that_a_spec_names_are_taken(table: type) -> None:
    """They are rounded to ten digits."""
    for word, field in spec_fields(table).items():
        for value in (field.low, field.high):
            if math.isfinite(value) and field.kind in (int, float):
                many = isinstance(field.default, tuple)
                table(**{word: [value] * len(field.default) if many else value})


@pytest.mark.parametrize(("make", "says"), [
    (lambda: SensorTable(tendon_threshold_N=-1), "tendon_threshold_N is -1; should be a number from"
     " 0 to 1000"),
    (lambda: SensorTable(tendon_threshold_N=float("nan")), "tendon_threshold_N is nan"),
    (lambda: SensorTable(tension_readings=2.5), "is 2.5; should be a whole number from 1"),  # type: ignore[arg-type]
    (lambda: HandTable(link_radius_mm=-7), "link_radius_mm is -7; should be a number from 1 to 50"),  # type: ignore[call-arg]
    (lambda: HandTable(link_radius_m=7), "link_radius_m is 7; should be a number from 0.001 to"),
    (lambda: HandTable(link_radius_mm="7"), "link_radius_mm is '7'; should be a number"),  # type: ignore[call-arg]
    (lambda: HandTable(link_length_mm=[35, 45]), "should be 3 numbers, each from 5 to 200"),  # type: ignore[call-arg]
    (lambda: HandTable(link_length_mm=35), "should be 3 numbers, each from 5 to 200"),  # type: ignore[call-arg]
    (lambda: Ring(tilt_deg=500), "Ring: tilt_deg is 500; should be a number from 0 to 180"),  # type: ignore[call-arg]
    (lambda: Ring(aim="midle"), "Ring: aim is 'midle'; should be a number from -1 to 2"),  # type: ignore[arg-type]
    (lambda: Ring(7.0), "palm_clearance_m is 7.0; should be"),
    (lambda: HandTable(link_radius_m=None), "link_radius_m is None; should be a number from"),  # type: ignore[arg-type]
    (lambda: HandTable(kind=3), "kind is 3; should be a text"),  # type: ignore[arg-type]
    (lambda: PadTable(middle=3), "middle is 3; should be True or False"),  # type: ignore[arg-type]
    (lambda: ObjectTable(yaw_rad=math.inf), "yaw_rad is inf; should be a number"),
    (lambda: SensorTable(tendon_threshold_N=np.array(-1.0)), "should be a number from 0"),  # type: ignore[arg-type]
    (lambda: replace(Ring(), count=0), "Ring: count is 0; should be a whole number from 1 to"),
])
def test_a_value_that_a_spec_could_not_have_is_refused(make: object, says: str) -> None:
    with pytest.raises(ValueError, match="should be") as error:
        make()  # type: ignore[operator]
    assert says in str(error.value)


def test_what_may_be_missing_may_be() -> None:
    assert FitTable(upright_rad=None).upright_rad is None
    assert ObjectTable(yaw_rad=None).yaw_rad is None


def test_numbers_of_numpy_are_numbers() -> None:
    assert FitTable(taper=np.True_).taper  # type: ignore[arg-type]
    assert HandTable(link_density_kg_m3=np.array(1000.0)).link_density_kg_m3 == 1000.0  # type: ignore[arg-type]
    assert SensorTable(tension_readings=np.int64(3)).tension_readings == 3  # type: ignore[arg-type]


@pytest.mark.parametrize("lengths", [[43, 33, 28], np.array([43.0, 33.0, 28.0])])
def test_lists_and_arrays_of_one_table_are_tuples(lengths: Any) -> None:
    """So that a table is hashable and its numbers are checked, whatever it was made of."""
    hand: Any = HandTable
    metres = [entry / 1e3 for entry in lengths]
    table = hand(link_length_mm=lengths)
    assert table.link_length_m == (0.043, 0.033, 0.028)
    assert table == hand("utah_mit", HandTable().abduction_offset_m, metres)
    assert hash(table) == hash(hand(link_length_m=np.array(metres)))
    assert hash(hand(link_radius_m=np.array(0.008))) == hash(hand(link_radius_m=0.008))
    with pytest.raises(ValueError, match=r"HandTable: link_length_m is .*; should be 3 numbers"):
        hand(link_length_m=np.array([np.nan, 0.033, 0.028]))


def test_errors_and_their_scale_may_go_beyond_the_bounds_of_each() -> None:
    """A spec takes both; what they come to is no value of a spec's."""
    largest = {f.name: f.metadata["high"] for f in fields(ErrorTable)}
    scaled = ErrorTable(**largest).scaled()
    assert scaled.joint_offset_rad == 10.0 * largest["joint_offset_rad"]
    assert scaled.scale == 1.0
    assert scaled.scaled() == scaled


@pytest.mark.parametrize(("make", "says"), [
    (lambda: Ring(tilt=50), "Ring has no 'tilt'; did you mean tilt_deg"),  # type: ignore[call-arg]
    (lambda: SensorTable(threshold=3), "did you mean tendon_threshold_N"),  # type: ignore[call-arg]
    (lambda: Column(aim=0.5), "Column has no 'aim'; did you mean aim_"),  # type: ignore[call-arg]
    (lambda: Ring(tilt_deg=1, tilt_rad=1), "tilt_deg and tilt_rad are the same"),  # type: ignore[call-arg]
])
def test_a_wrong_word_is_answered_with_the_right_one(make: object, says: str) -> None:
    with pytest.raises(TypeError) as error:
        make()  # type: ignore[operator]
    assert says in str(error.value)
