"""The hand of a spec: `hand = "allegro"`, a hand that ships or a TOML file, in place of `[hand]`.

The same word in a sweep, `hand = ["utah_mit", "allegro"]`, compares hands.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sweeps.spec.axes import WORDS
from sweeps.spec.errors import KeyPath, Problems, choose, short
from sweeps.spec.objects import NoFile, named_file
from sweeps.spec.study import HAND_KEY, Axis, Study
from sweeps.spec.units import spec_fields
from warpgrasp.hands.hand_model import HandError
from warpgrasp.parameters import UTAH_MIT, ContactTable, HandTable

HAND_LIMIT = 1 << 20
COUNTS = ("kind", "mount_length_m", "palm_thickness_m", "joint_stop_Nm_rad", "link_density_kg_m3",
          "skin_stiffness_N_m")
"""Fields of `HandTable` that count for every hand."""


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


def with_hands(axis: Axis, base_dir: Path, problems: Problems) -> Axis:
    """An axis of a sweep whose hands are found."""
    if HAND_KEY not in axis.keys:
        return axis
    at = axis.keys.index(HAND_KEY)
    si = tuple((*point[:at], read_hand(point[at], base_dir, problems, ("sweep",)),
                *point[at + 1:]) for point in axis.si)
    return replace(axis, si=si)


def check_hands(study: Study, given: Mapping[str, Any], problems: Problems) -> None:
    """Notes keys of `[hand]` that say nothing of the hand, and closing paths that it has not."""
    hands = hands_of(study)
    if hands == {UTAH_MIT}:
        return
    # Warp and what reads hands are imported for other hands alone.
    from strategies.poses.chain_paths import chain_path_names
    from warpgrasp.chain.chain_hand import chain_of_table
    from warpgrasp.chain_closing.chain_closing import unsupported_contact

    if UTAH_MIT not in hands:
        for key, field in spec_fields(HandTable).items():
            if key in given and field.name not in COUNTS:
                problems.add(("hand", key), "is a number of the Utah-MIT hand; other hands have "
                             f"their numbers in their TOML file, and {', '.join(COUNTS[1:])}")
    if len(hands) > 1 and _sides(study) != {"both"}:
        problems.add(("robot", "swept"), "hands are swept, and a robot knows which hand it has; "
                     "should be both")
    for table in _contacts(study):
        for key, what in unsupported_contact(table):
            problems.add(("contact", key), what)
            return
    for kind in sorted(hands - {UTAH_MIT}):
        chain = chain_of_table(HandTable(kind=kind))
        assert chain is not None
        known = chain_path_names(chain)
        for strategy in study.strategies:
            for name in strategy.closings:
                if name not in known:
                    problems.add(("strategy",), f"{strategy.name}: the hand {chain.model.name} has "
                                 f"no closing path {short(name)}; {choose(name, known)}")


def _contacts(study: Study) -> list[ContactTable]:
    """Every table of what acts on the fingers that a study runs with."""
    tables = [study.tables["contact"]]
    for axis in study.axes:
        for n, key in enumerate(axis.keys):
            if key.startswith("contact."):
                name = spec_fields(ContactTable)[key.removeprefix("contact.")].name
                tables += [replace(tables[0], **{name: point[n]}) for point in axis.si]
    return tables


def _sides(study: Study) -> set[str]:
    """Whose tables the study sweeps, at all of its settings."""
    key = "robot.swept"
    swept = {point[axis.keys.index(key)] for axis in study.axes if key in axis.keys
             for point in axis.si}
    return swept or {study.tables["robot"].swept}


def hands_of(study: Study) -> set[str]:
    """Every hand that a study runs with."""
    swept = {point[axis.keys.index(HAND_KEY)] for axis in study.axes if HAND_KEY in axis.keys
             for point in axis.si}
    return swept or {study.tables["hand"].kind}
