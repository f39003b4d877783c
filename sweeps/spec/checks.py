"""Values of a spec that do not go together, in its sections and at every point of its sweep.

Lower limits lie below upper ones, pads fit their links, keys say something of the study's robots.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import degrees
from typing import Any

import numpy as np

from sweeps.spec.cell import APART, SECTIONS
from sweeps.spec.errors import KeyPath, Problems
from sweeps.spec.study import ARM_KEY, SEEN, SHIPPED, Axis, Study
from sweeps.spec.units import spec_fields
from warpgrasp.arms.arm_column import in_column
from warpgrasp.parameters import (
    FLOATING,
    PUMA560,
    UTAH_MIT,
    ArmTable,
    HandTable,
    PadTable,
)
from warpgrasp.spec_words import word_of

_PAIRS = (("arm", "limit_low_deg", "limit_high_deg"),
          ("arm", "box_low_mm", "box_high_mm"),
          ("hand", "flexion_low_deg", "flexion_high_deg"))

LIMIT_KEYS = ("hand.abduction_limit_deg", "arm.d_mm", "arm.a_mm", "arm.kind", *(
    f"{section}.{name}" for section, *names in _PAIRS for name in names))


def check_order(tables: Mapping[str, Any], given: Mapping[str, Any], axes: Sequence[Axis],
                problems: Problems) -> None:
    """Checks pairs that are not swept, and those that one robot has without the sweep; whichever of
    the two was given."""
    swept = {key for axis in axes for key in axis.keys}
    apart = "robot.swept" in swept or tables["robot"].swept != "both"
    for section, low, high in _PAIRS:
        here = {f"{section}.{low}", f"{section}.{high}"} & swept
        if (not here or (apart and section in APART)) and _crossed(tables, section, low, high):
            at = low if low in given.get(section, {}) else high
            whose = "of the robot that is not swept: " if here else ""
            problems.add((section, at), f"{whose}{low} should be below {high}")


def check_swept_order(tables: Mapping[str, Any],
                      parts: Mapping[str, Mapping[str, tuple[KeyPath, Any]]],
                      readers: Mapping[str, Callable[[Any, KeyPath, Problems], Any]],
                      problems: Problems) -> None:
    """Checks pairs of which one is swept: lists by their values, ranges by their ends.

    `parts` has, by kind of axis and key, where a key's values stand, and the values, all checked.
    """
    swept = {key: (kind, *found) for kind, table in parts.items() for key, found in table.items()}
    for section, *names in _PAIRS:
        keys = [f"{section}.{name}" for name in names]
        at = next((swept[key][1] for key in keys if key in swept), None)
        if at is None:
            continue
        sides = []
        for key, name in zip(keys, names, strict=True):
            if key not in swept:
                sides.append(_set(tables, section, name))
                continue
            _, path, values = swept[key]
            values = values.values() if isinstance(values, Mapping) else values
            si = [readers[key](value, path, problems) for value in values]
            sides.append(np.array(si, float).reshape(len(si), -1))
        lows, highs = sides
        if {swept.get(key, ("",))[0] for key in keys} != {"zip"}:  # every value meets every other
            lows, highs = lows.max(0), highs.min(0)
        if (lows >= highs).any():
            problems.add(at, f"{names[0]} should be below {names[1]} at every point of the sweep")


def _set(tables: Mapping[str, Any], section: str, name: str) -> np.ndarray:
    """What a section has for a key, in SI, shape (1, number)."""
    value = getattr(tables[section], spec_fields(SECTIONS[section])[name].name)
    return np.array(value, float).reshape(1, -1)


def _crossed(tables: Mapping[str, Any], section: str, low: str, high: str) -> bool:
    return bool((_set(tables, section, low) >= _set(tables, section, high)).any())


def note_idle(study: Study, section: str, idle: Mapping[str, str], given: Collection[str],
              problems: Problems) -> None:
    """Notes keys that say nothing of the study: where they are among the `given`, swept or
    searched. `idle` has, by field of the section's table, what to say of it."""
    for key, field in spec_fields(SECTIONS[section]).items():
        if field.name in idle:
            for path in ([(section, key)] if key in given else []) + [
                    *places_of_swept(study, f"{section}.{key}", problems)]:
                problems.add(path, idle[field.name])


def spec_keys(fields: Iterable[str]) -> str:
    """The keys of fields in a spec, for a message."""
    return ", ".join(word_of(name)[0] for name in fields)


def changed(study: Study, section: str) -> set[str]:
    """Keys of a section whose value is not the default."""
    table = study.tables[section]
    return {key for key, field in spec_fields(type(table)).items()
            if getattr(table, field.name) != field.default}


def places_of_swept(study: Study, key: str, problems: Problems) -> Iterator[KeyPath]:
    """Where a spec sweeps or searches a key; of a key that `--set` sweeps, as in [sweep.grid]."""
    swept = any(key in axis.keys for axis in study.axes)
    for told, start in ((swept, ("sweep", "grid")), (study.searches(key), ("search",))):
        if told:
            yield next((path for path in problems.lines if path[:1] == start[:1]
                        and ".".join(map(str, path[len(start):])) == key), (*start, key))


PROCEDURES = {"planar", "contour", "decide"}
"""What feels with pads; planners that do so find out by themselves."""
_DECIDING = ("strategy.order", "object.prior", "contour.axis", "errors.scale")
"""Keys that decide of which tables others are read."""
PLACE_KEYS = ("object.x_mm", "object.y_mm")
JOINT_FIELDS = ("d_m", "a_m", "limit_low_rad", "limit_high_rad", "speed_rad_s")
"""Fields of `ArmTable` that say something of the PUMA 560 alone."""
WRIST_FIELDS = ("box_low_m", "box_high_m", "wrist_speed_m_s", "wrist_turn_rad_s")
"""Fields that say something of a floating wrist alone."""
JOINT_ERRORS = ("arm_joint_offset_rad", "arm_link_m")  # say nothing of a floating wrist
ERROR_KEYS = ("errors.link_length_pct", "errors.moment_arm_pct", "errors.pad_gain_pct",
              "errors.scale")
PAD_KEYS = ("hand.kind", "hand.link_length_mm", "hand.link_radius_mm", *map("pads.{}".format, (
    "length_mm", "width_mm", "wrap_deg", "thickness_mm", "distal", "middle", "proximal", "law",
    "rest_ohm", "least_ohm", "newton_ohm", "power", "floor_N", "saturation_N")))


def check_used(study: Study, problems: Problems) -> None:
    """Notes swept or searched keys of tables that nothing in the study reads, whatever they are.

    Keys that are given once may stand there all the same, as `init` writes them.
    """
    if study.search and not any(study.reaches(strategy, factor.key)
                                for factor in study.search.factors
                                for strategy in study.strategies):
        problems.add(("search",), "no key of it says anything of the strategy: all its points are "
                     "one entry")
    if any(study.searches(key) for key in _DECIDING):
        return
    orders = {name for order in _orders(study) for name in order}
    turned = bool({"contour", "decide"} & orders)
    views = SEEN & study.values_of("object.prior")
    used = {
        "planar": ({"planar", "decide"} & orders, "faces are crossed where an order has planar or "
                   "decide"),
        "contour": (turned, "contours are followed where an order has contour or decide"),
        "decide": ("decide" in orders, "it is for an order with decide"),
        "pads": (_may_feel(study), _FEELS),
        "stereo": (views or (turned and "stereo" in study.values_of("contour.axis")),
                   "cameras look where object.prior is silhouettes or depth, or contour.axis is "
                   "stereo and an order has contour or decide"),
        "errors": (study.values_of("errors.scale") != {0.0}, "errors.scale is 0, and is a factor "
                   "of all other errors")}
    idle = {section for section, (reason, _) in used.items() if not reason}
    for section, (reason, where) in used.items():
        if not reason:
            note_idle(study, section, {
                field.name: f"changes nothing in this study: {where}"
                for key, field in spec_fields(SECTIONS[section]).items()
                if f"{section}.{key}" not in _DECIDING}, (), problems)
    for keys, reads, where in _READ_WHERE:
        for key in () if reads(study) else [k for k in keys if k.partition(".")[0] not in idle]:
            for path in places_of_swept(study, key, problems):
                problems.add(path, f"changes nothing in this study: {where}")
    if not problems.found:
        for key in [key for n in frozenset.intersection(*study.idle) for key in study.axes[n].keys]:
            for path in places_of_swept(study, key, problems):
                problems.add(path, "changes nothing in this study: no strategy reads it")


def _may_feel(study: Study) -> bool:
    """Whether a strategy feels with pads, or is a user's planner, which may."""
    return feels_with_pads(study) or any(
        strategy.call and strategy.call not in SHIPPED for strategy in study.strategies)


_FEELS = "pads feel where an order has planar, contour or decide, or your planner moves them"
Reads = Callable[[Study], bool]


def _where(key: str, *values: Any) -> tuple[Reads, str]:
    """Whether a key may have one of these values, and what to say where it does not."""
    words = " or ".join("true" if value is True else value for value in values)
    return lambda study: study.may_be(key, set(values)), f"it is read where {key} is {words}"


_READ_WHERE: tuple[tuple[tuple[str, ...], Reads, str], ...] = (
    (("errors.pad_mm", "errors.pad_gain_pct", "fit.normals", "fit.free_tips"), _may_feel, _FEELS),
    (("pads.least_ohm", "pads.force_scale_N"), *_where("pads.law", "exponential")),
    (("pads.newton_ohm", "pads.power"), *_where("pads.law", "inverse_power")),
    (("hand.joint_stop_Nm_rad",), *_where("contact.joint_stops", True)),
    (("hand.link_density_kg_m3",), *_where("contact.weight", True)),
    (("fit.upright_deg",), *_where("fit.table_plane", True)),
    (("decide.flat_below",), *_where("decide.ends", True)),
    (("stereo.missing_depth",), *_where("object.prior", "depth")),
    (("stereo.missing_edges", "stereo.spurious_edges", "stereo.clutter", "stereo.flipped_pixels"),
     lambda study: study.sees_silhouettes, "it is read where object.prior is silhouettes, or "
     "contour.axis is stereo and an order has contour or decide"),
    (("recognition.none_prior",), *_where("recognition.way", "as_felt", "faces", "profile",
                                          "parameters")),
    (("robot.swept",), lambda study: any(
        key.split(".")[0] in APART for axis in study.axes for key in axis.keys) or any(
        study.searches(f"{name}.{key}") for name in APART for key in spec_fields(SECTIONS[name])),
     "no key of hand, sensors or errors is swept beside it"))
"""Keys that are read in some modes only, whether a study has such a one, what to say if not."""


def check_errors(study: Study, problems: Problems) -> None:
    """Notes the first setting under which a true robot could have a factor of zero or less; of
    pads' gains, if any strategy feels."""
    feels = feels_with_pads(study) or study.searches("strategy.order")
    note_misfit(study, ERROR_KEYS, lambda tables: tables["errors"].misfit(feels), ("errors",),
                problems)


def check_pads(study: Study, problems: Problems) -> None:
    """Notes the first setting under which a pad tells no force or does not fit its link, if any
    strategy feels."""
    if feels_with_pads(study) or study.searches("strategy.order"):
        note_misfit(study, PAD_KEYS, lambda tables: _misfit(tables["hand"], tables["pads"]),
                    ("pads",), problems)


def note_misfit(study: Study, keys: Collection[str], misfit: Callable[[Mapping[str, Any]], str],
                path: KeyPath, problems: Problems) -> None:
    """Notes the first point of the sweep at which tables do not fit together, as far as they depend
    on `keys`: where one of them is given, or else at `path`. Where truth and belief differ, those
    of the robot that is not swept are asked, too."""
    given = [own for key in keys if (own := tuple(key.split("."))) in problems.lines]
    apart = {name: study.tables[name] for name in APART if is_apart(study)}
    for swept, tables in swept_points(study, keys):
        if wrong := misfit(tables):
            if swept:
                searched = any(study.searches(key) for key, *_ in swept)
                given = [("search",) if searched else problems.at_swept(swept[0][0])]
            problems.add([*given, path][0], told_of(swept) + wrong)
            return
        if apart and (wrong := misfit(tables | apart)):
            problems.add([*given, path][0], f"of the robot that is not swept: {wrong}")
            return


def is_apart(study: Study) -> bool:
    """Whether a sweep varies the robot that is, or the one that is believed, alone."""
    return study.may_be("robot.swept", {"truth", "belief"})


def swept_points(study: Study, keys: Collection[str]
            ) -> Iterator[tuple[list[tuple[str, Any, Any]], dict[str, Any]]]:
    """The combinations of values that a study sweeps some keys over, as (key, value, SI value) of
    each, and the tables there."""
    axes = [dict.fromkeys(
        tuple(entry for entry in zip(axis.keys, values, si, strict=True) if entry[0] in keys)
        for values, si in zip(axis.values, axis.si, strict=True)) for axis in study.axes]
    for chosen in product(*axes):
        swept = [entry for point in chosen for entry in point if entry[2] is not None]
        tables = dict(study.tables)
        for key, _, si in swept:
            section, name = key.split(".")
            field = spec_fields(SECTIONS[section])[name]
            tables[section] = replace(tables[section], **{field.name: si})
        yield swept, tables


def told_of(swept: Sequence[tuple[str, Any, Any]]) -> str:
    """Where in a sweep something is so, for a message; empty without a sweep."""
    told = ", ".join(f"{key} = {value}" for key, value, _ in swept)
    return f"with {told}: " if told else ""


def _misfit(hand: HandTable, pads: PadTable) -> str:
    """Why pads tell no force, or do not fit a hand's links; empty where all is well."""
    if wrong := pads.insensitive():
        return wrong
    if hand.kind == UTAH_MIT:
        return pads.misfit(hand) or ("" if pads.distal else (
            "no pad on the distal links, with which planar, contour and decide feel; "
            "pads.distal should be true"))
    # What reads hands is not imported where the hand is the Utah-MIT's.
    from warpgrasp.chain.chain_hand import chain_of_table
    from warpgrasp.chain.chain_pads import pad_misfit

    chain = chain_of_table(hand)
    return pad_misfit(chain, pads) if chain is not None else ""


def check_limits(study: Study, problems: Problems) -> None:
    """Notes the first setting under which the PUMA 560 or the Utah-MIT hand cannot be moved."""
    note_misfit(study, LIMIT_KEYS, _immovable, ("arm",), problems)


def _immovable(tables: Mapping[str, Any]) -> str:
    arm, hand = tables["arm"], tables["hand"]
    low, high = hand.abduction_limit_rad
    if not low < high:
        return f"is {degrees(low):g}, {degrees(high):g}; the first should be below the second"
    for section, least, most in _PAIRS:  # those of a search; others were checked as they were read
        if _crossed(tables, section, least, most):
            return f"{least} should be below {most}"
    if arm.kind != PUMA560 or arm == ArmTable():
        return ""
    # Kernels, imported for arms that are changed alone.
    from warpgrasp.mechanism.puma560 import home_misfit, puma_misfit

    return puma_misfit(arm) or home_misfit(arm)


def feels_with_pads(study: Study) -> bool:
    """Whether a strategy that is no planner feels with pads."""
    return any(PROCEDURES & set(order) for order in _orders(study))


def closes_fingers(study: Study) -> bool:
    """Whether a strategy may close fingers on the object."""
    return any(strategy.call for strategy in study.strategies) or any(
        "containment" in order for order in _orders(study))


def _orders(study: Study) -> list[tuple[str, ...]]:
    """The orders of procedures that strategies are run with."""
    given = [strategy.order for strategy in study.strategies if not strategy.call]
    swept = [order for axis in study.axes if "strategy.order" in axis.keys for point in axis.si
             if (order := point[axis.keys.index("strategy.order")])]  # None: a search leaves it
    return swept if given and swept else given


def check_arms(study: Study, given: Mapping[str, Any], problems: Problems) -> None:
    """Notes keys of `[arm]` and `[errors]` that say nothing of any arm of the study; `given` is the
    spec's `[arm]`."""
    arms = arms_of(study)
    if study.searches(ARM_KEY):
        return
    instead = "; ".join([f"the PUMA 560 has {spec_keys(JOINT_FIELDS)}"] * (PUMA560 in arms)
                        + [f"a floating wrist has {spec_keys(WRIST_FIELDS)}"] * (FLOATING in arms)
                        + ["other arms have their numbers in their TOML file"]
                        * bool(arms - {PUMA560, FLOATING}))
    idle: dict[str, str] = {}
    if PUMA560 not in arms:
        idle |= dict.fromkeys(JOINT_FIELDS, f"is a number of the PUMA 560; {instead}")
    if FLOATING not in arms:
        idle |= dict.fromkeys(WRIST_FIELDS, "is a number of a floating wrist, arm = \"none\"; "
                              f"{instead}")
    if arms == {FLOATING}:
        errors: dict[str, str] = dict.fromkeys(
            JOINT_ERRORS, "is an error of an arm's joints, and a floating wrist has none; should "
            "be left out")
        note_idle(study, "errors", errors, changed(study, "errors"), problems)
        idle["encoder_step_rad"] = f"is of an arm's joints; {instead}"
    # As `init` writes them, all of [arm] may stand there of the PUMA 560.
    note_idle(study, "arm", idle, changed(study, "arm") if PUMA560 in arms else given, problems)


def check_places(study: Study, problems: Problems) -> None:
    """Notes the first setting under which the object stands where the arm does, as when metres are
    written for millimetres. Arms that a search proposes are not asked."""
    if not study.searches(ARM_KEY):
        note_misfit(study, (*PLACE_KEYS, ARM_KEY), lambda tables: in_column(
            tables["arm"].kind, tables["object"].x_m, tables["object"].y_m),
            ("object",), problems)

def arms_of(study: Study) -> set[str]:
    """Every arm that a study runs with."""
    swept = {point[axis.keys.index(ARM_KEY)] for axis in study.axes if ARM_KEY in axis.keys
             for point in axis.si}
    return swept or {study.tables["arm"].kind}
