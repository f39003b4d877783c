"""Families of everyday objects, made by seed: tables of compounds as a spec has them.

Proportions and wall thicknesses are drawn by (family, seed) from ranges that are estimates [est]
of what stands in a kitchen or a workshop. Seeds below `PUBLIC` are for development; those from
`HELD_OUT` on are for a last comparison, which nothing should be tuned to.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from warpgrasp.core.random import Purpose, counter_key, counter_uniform
from warpgrasp.objects.catalogue_names import member_of_family

Part = dict[str, Any]


class Draw:
    """Uniform numbers of one object, in the order that they are asked for."""

    def __init__(self, family: str, seed: int) -> None:
        name = int.from_bytes(family.encode()[:7], "big")
        self.key = counter_key(int(Purpose.OBJECT), name, seed)
        self.count = 0

    def __call__(self, low: float, high: float) -> float:
        """A length [mm] or angle [deg], to a tenth."""
        self.count += 1
        share = float(counter_uniform(counter_key(self.key, self.count)))
        return round(low + (high - low) * share, 1)

    def one_of(self, choices: tuple[Any, ...]) -> Any:
        """One of several, all as likely."""
        return choices[min(int(self(0.0, 1e3) / 1e3 * len(choices)), len(choices) - 1)]


def family_table(name: str) -> Part | None:
    """The spec's table of an object such as "mug-17"; None where the name is no family's."""
    member = member_of_family(name)
    if member is None:
        return None
    return {"name": name, "compound": FAMILIES[member[0]](Draw(*member))}


def _at(*place: float) -> list[float]:
    return [round(float(value), 1) for value in place]


def _solid(shape: str, at: list[float], rpy: tuple[float, ...] = (0, 0, 0), join: str = "union",
           **size: Any) -> Part:
    turned = {"rpy_deg": [float(v) for v in rpy]} if any(rpy) else {}
    return {"shape": shape, "join": join, "at_mm": at, **turned, **size}


def _mug(draw: Draw) -> list[Part]:
    radius, height, wall = draw(32, 46), draw(70, 110), draw(3.5, 7)
    bar, reach = draw(5, 7.5), draw(20, 32)
    low, high = draw(0.15, 0.3) * height, draw(0.7, 0.85) * height
    out = radius + reach - bar
    return [
        _solid("cylinder", _at(0, 0, 0), radius_mm=radius, height_mm=height),
        *(_solid("capsule", _at(radius - 2 * bar, 0, z), (0, 90, 0), radius_mm=bar,
                 height_mm=round(reach + 2 * bar, 1)) for z in (low, high)),
        _solid("capsule", _at(out, 0, low - bar), radius_mm=bar,
               height_mm=round(high - low + 2 * bar, 1)),
        _solid("cylinder", _at(0, 0, wall), join="difference", radius_mm=round(radius - wall, 1),
               height_mm=height)]


def _bowl(draw: Draw) -> list[Part]:
    radius, height, wall, power = draw(55, 85), draw(45, 70), draw(4, 9), draw(7, 11) / 10
    deep = [round(radius - wall, 1)] * 2 + [round(height - wall, 1)]
    return [
        _solid("superquadric", _at(0, 0, height), size_mm=[radius, radius, height],
               exponents=[power, 1.0]),
        _solid("superquadric", _at(0, 0, height), join="difference", size_mm=deep,
               exponents=[power, 1.0]),
        _solid("block", _at(0, 0, height), join="difference",
               size_mm=[3 * radius, 3 * radius, round(height + 20, 1)])]


def _hammer(draw: Draw) -> list[Part]:
    grip, length, head = draw(10, 15), draw(160, 240), draw(70, 120)
    side = draw(22, 34)
    face = _solid("cylinder", _at(length / 2, -head / 2, side / 2), (-90, 0, 0),
                  radius_mm=round(side / 2, 1), height_mm=head)
    beak = _solid("block", _at(length / 2, 0, 0), size_mm=[side, head, side])
    return [_solid("capsule", _at(-length / 2, 0, max(grip, side / 2)), (0, 90, 0), radius_mm=grip,
                   height_mm=length), draw.one_of((face, beak))]


def _pliers(draw: Draw) -> list[Part]:
    radius, length, angle, jaw = draw(7, 10), draw(140, 190), draw(9, 16), draw(35, 55)
    parts = []
    for sign in (1, -1):
        yaw = sign * np.radians(angle)
        # Both handles cross the origin with a quarter of their length before it.
        start = -0.75 * length * np.array([np.cos(yaw), np.sin(yaw)])
        parts.append(_solid("capsule", _at(*start, radius), (0, 90, sign * angle), radius_mm=radius,
                            height_mm=length))
    return [*parts, _solid("cylinder", _at(0, 0, 0), radius_mm=round(1.8 * radius, 1),
                           height_mm=round(2 * radius, 1)),
            _solid("block", _at(jaw / 2, 0, 0), size_mm=[jaw, round(2.4 * radius, 1),
                                                         round(2 * radius, 1)])]


def _bottle(draw: Draw) -> list[Part]:
    radius, body, neck = draw(28, 42), draw(90, 160), draw(11, 16)
    shoulder, top = draw(25, 50), draw(25, 60)
    taper = round(neck / radius, 3) - 1.0
    half = round(shoulder / 2, 1)
    # A cylinder that tapers from the body's radius to the neck's over its height.
    middle = round((radius + neck) / 2, 1)
    share = round(max(taper / (taper + 2.0), -0.95), 3)
    return [
        _solid("cylinder", _at(0, 0, 0), radius_mm=radius, height_mm=body),
        _solid("superquadric", _at(0, 0, body + half), size_mm=[middle, middle, half],
               exponents=[0.1, 1.0], taper=[share, share]),
        _solid("cylinder", _at(0, 0, body + shoulder - 2), radius_mm=neck,
               height_mm=round(top + 2, 1))]


def _box(draw: Draw) -> list[Part]:
    x, y, z, rim, lid = draw(50, 95), draw(50, 140), draw(40, 110), draw(2, 6), draw(12, 30)
    box = [_solid("block", _at(0, 0, 0), size_mm=[x, y, z]),
           _solid("block", _at(0, 0, z - 2), size_mm=[round(x + 2 * rim, 1), round(y + 2 * rim, 1),
                                                      lid])]
    knob = _solid("sphere", _at(0, 0, z + lid - 6), radius_mm=draw(9, 15))
    return [*box, knob] if draw.one_of((True, False)) else box


def _toy(draw: Draw) -> list[Part]:
    size = [draw(40, 70), draw(40, 70), draw(30, 60)]
    parts = [_solid("block", _at(0, 0, 0), size_mm=size)]
    for _ in range(draw.one_of((2, 3, 4, 5))):
        width = draw(18, 30)
        at = _at(draw(-0.5, 0.5) * size[0], draw(-0.5, 0.5) * size[1], draw(0.3, 0.9) * size[2])
        parts.append(draw.one_of((
            _solid("sphere", at, radius_mm=width),
            _solid("cylinder", at, radius_mm=width, height_mm=draw(40, 90)),
            _solid("capsule", at, (0, 90, draw(0, 360)), radius_mm=round(width / 2, 1),
                   height_mm=draw(60, 100)),
            _solid("block", at, (0, 0, draw(0, 90)), size_mm=[width, width, draw(40, 90)]))))
    return parts


FAMILIES: dict[str, Callable[[Draw], list[Part]]] = {
    "mug": _mug, "bowl": _bowl, "hammer": _hammer, "pliers": _pliers, "bottle": _bottle,
    "box": _box, "toy": _toy}
"""The parts of a member of each family."""
