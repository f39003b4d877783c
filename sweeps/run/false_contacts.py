"""Settings under which a robot will feel what is not there, or less truly than is supposed, for a
word of warning before it does.

They are no errors: how a strategy bears bad sensors may be the question.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from math import degrees, floor
from typing import Any

from sweeps.spec.checks import closes_fingers, feels_with_pads, swept_points, told_of
from sweeps.spec.hands import TORQUES, sense_of
from sweeps.spec.study import Study
from warpgrasp.parameters import UTAH_MIT

FALSE_STOPS_FROM = 5.0
"""Deviations of the difference of two tensions, or of a torque: readings are many, and the links'
weight adds to them [est]."""
FALSE_TOUCHES_FROM = 1e-3
"""Chance of a reading of a pad that nothing presses; a guarded line takes tens of them [est]."""
STOPS = ("hand.kind", "hand.tendon_friction", "hand.co_contraction_N", "hand.tension_low_N",
         "sensors.tendon_threshold_N", "sensors.tension_noise_N")
TORQUE_STOPS = ("hand.kind", "sensors.torque_threshold_Nm", "sensors.torque_noise_Nm",
                "sensors.torque_step_Nm", "sensors.torque_friction_Nm")
YIELDS_FROM = 4.0
"""Deviations of a joint's reading: one beyond `pads.yield_deg` stops a finger [est]."""
YIELDS = ("pads.yield_deg", "sensors.joint_noise_deg")
STEPS_UP_TO = 2.0
"""Deviations of the noise that makes readings of a coarse converter differ."""
STEPS = ("hand.kind", "sensors.tension_step_N", "sensors.tension_noise_N")
TORQUE_STEPS = ("hand.kind", "sensors.torque_step_Nm", "sensors.torque_noise_Nm")
TOUCHES = ("pads.noise_counts", "pads.threshold_counts", "pads.dead_fraction")
Tables = Mapping[str, Any]


def false_contact_warnings(study: Study) -> Iterator[str]:
    """What to say of the first setting of each kind under which contacts will be of nothing."""
    closes, feels = closes_fingers(study), feels_with_pads(study)
    asked: tuple[tuple[bool, Collection[str], Callable[[Tables], str]], ...] = (
        (closes, STOPS, _false_stops), (closes, TORQUE_STOPS, _false_torque_stops),
        (feels, TOUCHES, _false_touches), (feels, YIELDS, _false_yields),
        (closes, STEPS, _repeated_steps), (closes, TORQUE_STEPS, _repeated_torque_steps))
    for counts, keys, wrong in asked:
        said = (told_of(swept) + text for swept, tables in (
            swept_points(study, keys) if counts else ()) if (text := wrong(tables)))
        yield from [*said][:1]


def _false_stops(tables: Tables) -> str:
    """Of friction and noise of the tendons, which may stop fingers that touch nothing."""
    hand, sensors = tables["hand"], tables["sensors"]
    rub = 2.0 * hand.tendon_friction * max(hand.co_contraction_N, hand.tension_low_N)
    read = rub + FALSE_STOPS_FROM * 2.0**0.5 * sensors.tension_noise_N
    if hand.kind != UTAH_MIT or read <= sensors.tendon_threshold_N:
        return ""
    return (f"friction and noise of tendons read up to {read:.1f} N where nothing is touched, and "
            f"fingers stop from {sensors.tendon_threshold_N:g} N on: some contacts will be of "
            "nothing")


def _false_torque_stops(tables: Tables) -> str:
    """Of friction and noise of torques, likewise."""
    sensors = tables["sensors"]
    step = sensors.torque_step_Nm
    read = sensors.torque_friction_Nm + FALSE_STOPS_FROM * sensors.torque_noise_Nm
    if step > 0.0:
        read = step * floor(read / step + 0.5)
    if read <= sensors.torque_threshold_Nm or sense_of(tables["hand"].kind) != TORQUES:
        return ""
    return (f"friction and noise of torques read up to {read:.3g} N m where nothing is touched, "
            f"and fingers stop from {sensors.torque_threshold_Nm:g} N m on: some contacts will be "
            "of nothing")


def _false_touches(tables: Tables) -> str:
    """Of pads whose noise passes their threshold."""
    chance = tables["pads"].false_touch_probability()
    return "" if chance <= FALSE_TOUCHES_FROM else (
        f"noise alone raises a taxel to the threshold in {chance:.2g} of a pad's readings: guarded "
        "motions will end where nothing is touched")


def _false_yields(tables: Tables) -> str:
    """Of joint sensors by which a finger seems to be pushed away."""
    noise, limit = tables["sensors"].joint_noise_rad, tables["pads"].yield_rad
    return "" if limit >= YIELDS_FROM * noise else (
        f"noise of {degrees(noise):g} deg moves readings of joints past pads.yield_deg = "
        f"{degrees(limit):g}, from which a finger counts as pushed away: guarded motions beside "
        "the object end blocked, and those in the air do not, as a robot's would")


def _repeated_steps(tables: Tables) -> str:
    """Of a converter that tells the same in all readings of a finger at rest."""
    sensors, of_tendons = tables["sensors"], tables["hand"].kind == UTAH_MIT
    return _coarse(sensors.tension_step_N, sensors.tension_noise_N, "N") if of_tendons else ""


def _repeated_torque_steps(tables: Tables) -> str:
    """Of the converter of torques, likewise."""
    sensors = tables["sensors"]
    said = _coarse(sensors.torque_step_Nm, sensors.torque_noise_Nm, "N m")
    return said if said and sense_of(tables["hand"].kind) == TORQUES else ""


def _coarse(step: float, noise: float, unit: str) -> str:
    return "" if step <= STEPS_UP_TO * noise else (
        f"steps of {step:g} {unit} are large beside noise of {noise:g} {unit}: all readings "
        "at rest err alike, and their mean is hardly better than one of them")
