"""The objects of the catalogue and its families, a line each, for who only wants the list."""

import re

NAME_LIMIT = 80
"""Characters of an object's name, at most."""
NONE_OF_THESE, NO_ANSWER = "none of these", "no answer"
"""What is said where an object was recognized as none, or nothing was felt: no object's name."""
BODY_NAMES: dict[str, str] = {
    "block": "block 60 x 80 x 120 mm [est]",
    "large_cylinder": "cylinder of diameter 70, height 120 mm [est]",
    "small_cylinder": "cylinder of diameter 40, height 90 mm [est]",
    "wedge": "triangular wedge, base 60 x 60, ridge at 100 mm [est]",
    "lightbulb": "A19 lightbulb, diameter 60, height 110 mm [sourced; profile est]",
    "funnel": "funnel, bowl 100 mm, 60 deg [sourced; stem est]",
    "wine_bottle": "wine bottle, diameter 73.6, height 322 mm [sourced; shoulder est]",
    "beer_bottle": "beer bottle, diameter 61, height 231 mm [sourced; shoulder est]",
    "coke_bottle": "coke bottle, height 197 mm [est]",
    "orangina_bottle": "orangina bottle, height 145 mm [est]",
}
FAMILY_NAMES: dict[str, str] = {
    "mug": "hollow cylinder with a handle",
    "bowl": "half a superquadric, hollow",
    "hammer": "handle lying on the table, with a head across it",
    "pliers": "two crossing handles, lying",
    "bottle": "cylinder, shoulder and neck",
    "box": "block with a lid that overhangs, some with a knob",
    "toy": "block with two to five solids joined to it",
}
"""Families and what each is; an object's name is FAMILY-SEED."""
PUBLIC = 1000
"""Seeds from 0 to below this are the public half."""
HELD_OUT = 1000
"""Seeds from this on are the held-out half."""
MOST_SEED = 1999
SETS = {"public": 0, "held-out": HELD_OUT}
"""First seed of each half."""


def family_hint(name: str) -> str:
    """Which members the family has that `name` seems to be of, for a message; which families there
    are, where it is of none but numbered like a member; else nothing."""
    family, _, number = name.partition("-")
    if family in FAMILY_NAMES:
        return f"{family}-0 to {family}-{MOST_SEED} are made by seed; "
    if number.isdigit():
        known = list(FAMILY_NAMES)
        return f"made by seed, such as {known[0]}-1, are {', '.join(known)}; "
    return ""


def member_of_family(name: str) -> tuple[str, int] | None:
    """Family and seed of an object such as "mug-17"; None where the name is no family's."""
    match = re.fullmatch(r"([a-z_]+)-(0|[1-9][0-9]{0,3})", name)
    if match is None or match[1] not in FAMILY_NAMES or int(match[2]) > MOST_SEED:
        return None
    return match[1], int(match[2])
