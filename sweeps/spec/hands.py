"""The hand of a spec: `hand = "allegro"`, a hand that ships or a TOML file, in place of `[hand]`.

The same word in a sweep, `hand = ["utah_mit", "allegro"]`, compares hands.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from strategies.poses.closing_paths import CLOSING_PATHS
from sweeps.spec.checks import (
    changed,
    closes_fingers,
    is_apart,
    note_idle,
    note_misfit,
    places_of_swept,
    spec_keys,
)
from sweeps.spec.errors import KeyPath, Problems, choose, short
from sweeps.spec.named_files import NoFile, named_file
from sweeps.spec.search import with_ends
from sweeps.spec.study import HAND_KEY, WORDS, Study
from warpgrasp.hands.hand_model import HandError
from warpgrasp.parameters import UTAH_MIT, ContactTable, HandTable

HAND_LIMIT = 1 << 20
CLOSINGS_KEY = "strategy.closings"
COUNTS = ("kind", "mount_length_m", "palm_thickness_m", "joint_stop_Nm_rad", "link_density_kg_m3",
          "skin_stiffness_N_m")
"""Fields of `HandTable` that count for every hand."""
_TENSIONS, TORQUES, _SWITCHES, _NOTHING = (
    "tendon tensions", "joint torques", "switches in the tips", "nothing")
_SENSES = {"tendons": TORQUES, "joint_torques": TORQUES, "tip_switches": _SWITCHES,
           "nothing": _NOTHING}
"""What is read, by what a hand's file says; tendons of the Utah-MIT hand alone are read as such."""
_READ_BY = {
    "tendon_threshold_N": (_TENSIONS,), "tension_noise_N": (_TENSIONS,),
    "tension_step_N": (_TENSIONS,), "tension_readings": (_TENSIONS, TORQUES),
    "torque_threshold_Nm": (TORQUES,), "torque_noise_Nm": (TORQUES,),
    "torque_step_Nm": (TORQUES,), "torque_friction_Nm": (TORQUES,),
    "switch_force_N": (_SWITCHES,)}
"""Fields of `SensorTable` that count for hands of some senses only."""
_MOUNT_KEY = "hand.mount_length_mm"
_CLOSED_BY = ("hand.kind", "hand.link_density_kg_m3", "contact.weight", "contact.self_contact")
"""Keys by which a hand can be closed or not."""
_WEIGHED = ("hand.joint_stiffness_Nm_rad", "hand.link_density_kg_m3", "hand.link_length_mm",
            "hand.link_radius_mm", "hand.abduction_offset_mm", "hand.kind", "contact.weight")
"""Keys by which the Utah-MIT hand's fingers hang."""
_BUILT = ("hand.finger_spacing_mm", "hand.palm_gap_mm", "hand.link_radius_mm", "hand.kind")
"""Keys by which they stand beside one another."""


def spelled_out(values: Mapping[str, Any]) -> dict[str, Any]:
    """A spec whose hand and arm are tables."""
    return {key: {"kind": value} if key in WORDS and isinstance(value, str) else value
            for key, value in values.items()}


def read_hand(value: str, base_dir: Path, problems: Problems, path: KeyPath = ("hand", "kind")
              ) -> str:
    """The name of a hand that ships, or its file made absolute; what is wrong is noted."""
    if value == UTAH_MIT:
        return value
    from warpgrasp.chain.chain_hand import chain_of_table, hand_of_kind
    from warpgrasp.hands.hand_file import SHIPPED

    if value in SHIPPED:
        return value
    if not value.endswith(".toml"):
        problems.add(path, f"no hand {short(value)}; {choose(value, SHIPPED)}; or a TOML file, as "
                     "`warpgrasp hand URDF -o my_hand.toml` writes it")
        return UTAH_MIT
    try:
        file = str(named_file(value, base_dir, HAND_LIMIT))
        hand_of_kind(file)
        chain_of_table(HandTable(kind=file))
    except (NoFile, HandError) as error:
        problems.add(path, str(error))
        return UTAH_MIT
    return file


def check_hands(study: Study, given: Mapping[str, Any], problems: Problems) -> None:
    """Notes keys of `[hand]`, `[pads]` and `[sensors]` that say nothing of any hand of the study,
    and hands that a robot would mistake; `given` is the spec."""
    hands = hands_of(study)
    if not study.searches(HAND_KEY):
        note_idle(study, "sensors", _unread(hands), changed(study, "sensors"), problems)
        if UTAH_MIT not in hands:
            note_idle(study, "hand", {
                field.name: "is a number of the Utah-MIT hand; other hands have their numbers in "
                f"their TOML file, and {spec_keys(COUNTS[1:])}"
                for field in fields(HandTable) if field.name not in COUNTS},
                given.get("hand", {}), problems)
            note_idle(study, "pads", dict.fromkeys(
                _pads_said(hands), "says nothing of this hand: which of its links bear pads, and "
                "how large they are, its TOML file says"), given.get("pads", {}), problems)
    everywhere = hands_of(with_ends(study, (HAND_KEY,)))
    if everywhere != {study.tables["hand"].kind} and is_apart(study):
        problems.add(("robot", "swept"), "hands are swept, and a robot knows which hand it has; "
                     "should be both")
    for path in places_of_swept(study, _MOUNT_KEY, problems) if is_apart(study) else ():
        problems.add(path, "arm and hand share the mount, and a robot knows it; should be swept "
                     'with robot.swept = "both" alone')
    if UTAH_MIT in everywhere:
        for keys, misfit in ((_BUILT, _overlaps), (_WEIGHED, _hangs)):
            note_misfit(with_ends(study, keys), keys, misfit, ("hand",), problems)
    if everywhere != {UTAH_MIT} and closes_fingers(study):
        note_misfit(with_ends(study, _CLOSED_BY), _CLOSED_BY, _misfit, ("hand", "kind"), problems)


def _overlaps(tables: Mapping[str, Any]) -> str:
    """Why fingers of the Utah-MIT hand lie in one another."""
    from warpgrasp.mechanism.utah_mit_weight import overlap_misfit

    hand = tables["hand"]
    return overlap_misfit(hand) if hand.kind == UTAH_MIT else ""


def _hangs(tables: Mapping[str, Any]) -> str:
    """Why fingers of the Utah-MIT hand hang too far from their commands."""
    from warpgrasp.mechanism.utah_mit_weight import weight_misfit

    hand = tables["hand"]
    return weight_misfit(hand, tables["contact"]) if hand.kind == UTAH_MIT else ""


def _misfit(tables: Mapping[str, Any]) -> str:
    """Why a hand cannot be closed; empty where it can."""
    from warpgrasp.chain.chain_hand import chain_of_table
    from warpgrasp.chain_closing.chain_path import closing_misfit

    chain = chain_of_table(tables["hand"])
    return "" if chain is None else closing_misfit(chain, tables["hand"], tables["contact"])


def misfit_of(hand: HandTable, closings: Iterable[str]) -> str:
    """Why a hand cannot be closed along some paths with contacts as they are by default; empty
    where it can."""
    known, called = _closing_names(hand.kind)
    for name in closings:
        if name not in known:
            return f"the hand {called} has no closing path {short(name)}; {choose(name, known)}"
    return _misfit({"hand": hand, "contact": ContactTable()})


def _unread(hands: set[str]) -> dict[str, str]:
    """Fields of `[sensors]` that no hand reads, and what to say of them."""
    senses = {sense_of(kind) for kind in hands}
    read = [name for name, by in _READ_BY.items() if senses & {*by}]
    told = f"says nothing of this study's hands, which sense {' or '.join(sorted(senses))}"
    advice = f"; of those count {spec_keys(read)}" if read else ""
    return {name: told + advice for name in _READ_BY if name not in read}


def sense_of(kind: str) -> str:
    """What a hand's fingers feel beside their joint angles."""
    if kind == UTAH_MIT:
        return _TENSIONS
    from warpgrasp.chain.chain_hand import hand_of_kind

    return _SENSES[hand_of_kind(kind).senses]


def _pads_said(hands: set[str]) -> set[str]:
    """Fields of `[pads]` that say nothing of any of these hands, none of them the Utah-MIT."""
    from warpgrasp.chain.chain_hand import hand_of_kind

    said = {"distal", "middle", "proximal"}
    if all(hand_of_kind(kind).pad_size is not None for kind in hands):
        said |= {"width_m", "length_m", "wrap_rad", "thickness_m"}
    return said


def check_closings(study: Study, problems: Problems) -> None:
    """Notes closing paths that a hand of the study has not."""
    if not problems.found:  # a search may name hands that there are not
        study = with_ends(study, (HAND_KEY, CLOSINGS_KEY))
    hands = hands_of(study)
    for path, name, kinds in _closings(study, problems):
        for kind in sorted(kinds):
            known, called = _closing_names(kind)
            if name not in known:
                problems.add(path, f"is {short(name)}; {choose(name, known)}"
                             if hands == {UTAH_MIT} else
                             f"the hand {called} has no closing path {short(name)}; "
                             f"{choose(name, known)}")


def _closings(study: Study, problems: Problems) -> Iterator[tuple[KeyPath, str, set[str]]]:
    """Every closing path named, where, and the hands that may go it."""
    hands = hands_of(study)
    swept = [(axis, axis.keys.index(CLOSINGS_KEY)) for axis in study.axes
             if CLOSINGS_KEY in axis.keys]
    for n, strategy in enumerate(() if swept else study.strategies):
        for k, name in enumerate(strategy.closings):
            yield ("strategy", n, "closings", k), name, hands
    for axis, at in swept:
        path = (("search", CLOSINGS_KEY) if study.searches(CLOSINGS_KEY)
                else next(places_of_swept(study, CLOSINGS_KEY, problems)))
        for point in axis.si:
            own = ({point[axis.keys.index(HAND_KEY)] or study.tables["hand"].kind}
                   if HAND_KEY in axis.keys else hands)
            unasked = study.strategies[0].closings if study.searches(CLOSINGS_KEY) else ()
            for name in point[at] or unasked:
                yield path, name, own


def _closing_names(kind: str) -> tuple[Collection[str], str]:
    """Names of a hand's closing paths, and its own name."""
    if kind == UTAH_MIT:
        return CLOSING_PATHS, kind
    # Warp and what reads hands are imported for other hands alone.
    from strategies.poses.chain_paths import chain_path_names
    from warpgrasp.chain.chain_hand import chain_of_table

    chain = chain_of_table(HandTable(kind=kind))
    assert chain is not None
    return chain_path_names(chain), chain.model.name


def hands_of(study: Study) -> set[str]:
    """Every hand that a study runs with."""
    own = study.tables["hand"].kind  # also where a search proposes none
    swept = {point[axis.keys.index(HAND_KEY)] or own for axis in study.axes
             if HAND_KEY in axis.keys for point in axis.si}
    return swept or {own}
