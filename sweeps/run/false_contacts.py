"""Settings under which a robot will feel what is not there, or less truly than is supposed, for a
word of warning before it does.

They are no errors: how a strategy bears bad sensors may be the question.
"""

from collections.abc import Iterator
from math import degrees

from sweeps.spec.checks import feels_with_pads, swept_points, told_of
from sweeps.spec.study import Study
from warpgrasp.parameters import UTAH_MIT

FALSE_STOPS_FROM = 5.0
"""Deviations of the difference of two tensions: readings are many, and the links' weight adds to
them [est]."""
FALSE_TOUCHES_FROM = 1e-3
"""Chance of a reading of a pad that nothing presses; a guarded line takes tens of them [est]."""
STOPS = ("hand.kind", "hand.tendon_friction", "hand.co_contraction_N", "hand.tension_low_N",
         "sensors.tendon_threshold_N", "sensors.tension_noise_N")
YIELDS_FROM = 4.0
"""Deviations of a joint's reading: one beyond `pads.yield_deg` stops a finger [est]."""
YIELDS = ("pads.yield_deg", "sensors.joint_noise_deg")
STEPS_UP_TO = 2.0
"""Deviations of the noise that makes readings of a coarse converter differ."""
STEPS = ("hand.kind", "sensors.tension_step_N", "sensors.tension_noise_N")
TOUCHES = ("pads.noise_counts", "pads.threshold_counts", "pads.dead_fraction")


def false_contact_warnings(study: Study) -> Iterator[str]:
    """What to say of the first setting of each kind under which contacts will be of nothing."""
    yield from filter(None, (
        _false_stops(study), _false_touches(study), _false_yields(study), _repeated_steps(study)))


def _false_stops(study: Study) -> str:
    """Of friction and noise of the tendons, which may stop fingers that touch nothing."""
    for swept, tables in swept_points(study, STOPS):
        hand, sensors = tables["hand"], tables["sensors"]
        rub = 2.0 * hand.tendon_friction * max(hand.co_contraction_N, hand.tension_low_N)
        read = rub + FALSE_STOPS_FROM * 2.0**0.5 * sensors.tension_noise_N
        if hand.kind == UTAH_MIT and read > sensors.tendon_threshold_N:
            return (f"{told_of(swept)}friction and noise of tendons read up to {read:.1f} N where "
                    f"nothing is touched, and fingers stop from {sensors.tendon_threshold_N:g} N "
                    "on: some contacts will be of nothing")
    return ""


def _false_touches(study: Study) -> str:
    """Of pads whose noise passes their threshold."""
    for swept, tables in swept_points(study, TOUCHES) if feels_with_pads(study) else ():
        chance = tables["pads"].false_touch_probability()
        if chance > FALSE_TOUCHES_FROM:
            return (f"{told_of(swept)}noise alone raises a taxel to the threshold in {chance:.2g} "
                    "of a pad's readings: guarded motions will end where nothing is touched")
    return ""


def _false_yields(study: Study) -> str:
    """Of joint sensors by which a finger seems to be pushed away."""
    for swept, tables in swept_points(study, YIELDS) if feels_with_pads(study) else ():
        noise, limit = tables["sensors"].joint_noise_rad, tables["pads"].yield_rad
        if limit < YIELDS_FROM * noise:
            return (f"{told_of(swept)}noise of {degrees(noise):g} deg moves readings of joints "
                    f"past pads.yield_deg = {degrees(limit):g}, from which a finger counts as "
                    "pushed away: guarded motions beside the object end blocked, and those in the "
                    "air do not, as a robot's would")
    return ""


def _repeated_steps(study: Study) -> str:
    """Of a converter that tells the same in all readings of a finger at rest."""
    for swept, tables in swept_points(study, STEPS):
        sensors = tables["sensors"]
        if tables["hand"].kind == UTAH_MIT and (
                sensors.tension_step_N > STEPS_UP_TO * sensors.tension_noise_N):
            return (f"{told_of(swept)}steps of {sensors.tension_step_N:g} N are large beside noise "
                    f"of {sensors.tension_noise_N:g} N, so that all readings at rest would err "
                    "alike; the model averages them as if each erred by itself")
    return ""
