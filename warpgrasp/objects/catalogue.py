"""Objects by name, and objects from a spec's table: mesh, compound or superquadric.

The first database of Allen and Michelman 1990 [paper], sizes estimated [est], and the bottles of
the second, each a radius profile in `profiles/` whose first line says what is sourced.
"""

from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from functools import cache
from math import cos, radians, sin
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.geometry.body import Body, BodyError, Part
from warpgrasp.geometry.scene import Join, Shape
from warpgrasp.objects.catalogue_names import (
    BODY_NAMES,
    NAME_LIMIT,
    family_hint,
    member_of_family,
)
from warpgrasp.objects.grid_baking import triple
from warpgrasp.objects.mesh_import import LARGEST_M, SMALLEST_M, body_from_mesh, can_be_explored
from warpgrasp.objects.stable_pose import body_in_stable_pose

_PROFILES = Path(__file__).parent / "profiles"
_LARGEST_COMPOUND = 64


@cache
def body_from_name(name: str) -> Body:
    """An object of the catalogue, or a member of a family such as "mug-17". Raises BodyError
    listing what there is for an unknown name."""
    if not isinstance(name, str):
        raise BodyError(f"an object's name is {_short(name)}: a text such as \"block\" is wanted")
    if member_of_family(name):
        from warpgrasp.objects.families import family_table  # needs Warp, for random numbers

        return body_from_table(family_table(name) or {}, Path())
    if name not in BODY_NAMES:
        close = get_close_matches(name, BODY_NAMES, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise BodyError(f"no object {name!r}; {family_hint(name)}{hint}there are: "
                        f"{', '.join(BODY_NAMES)}")
    doc = BODY_NAMES[name]
    simple = {
        "block": (Shape.BLOCK, (0.060, 0.080, 0.120)),
        "wedge": (Shape.WEDGE, (0.060, 0.060, 0.100)),
        "large_cylinder": (Shape.CYLINDER, (0.035, 0.0, 0.120)),
        "small_cylinder": (Shape.CYLINDER, (0.020, 0.0, 0.090)),
    }
    if name in simple:
        shape, size = simple[name]
        part = Part(shape, size_m=size)
    else:
        part = Part(Shape.REVOLUTION, profile_m=profile_from_csv(_PROFILES / f"{name}.csv"))
    return _body(name, (part,), doc)


def body_from_table(table: Mapping[str, Any], base_dir: Path | str) -> Body:
    """An object of a spec's table; relative paths are relative to `base_dir`.

    `{mesh = "mug.stl", units = "cm"}`, `{name = "mug", compound = [...]}`, `{name = "egg",
    superquadric = {size_mm = [..], exponents = [..], taper = [..], bend_per_m, bend_deg}}` or
    `{name = "vase", profile = "vase.csv"}` (columns z_mm, r_mm), or `{object = "block"}`, one of
    the catalogue. `size_mm` of a superquadric is half its extent, of a block or wedge all of it.
    With `stable_pose = 2` the object lies in the second of its stable poses. Raises BodyError, also
    where the longest side of the object is not of 5 mm to 1 m.
    """
    if not isinstance(table, Mapping):
        raise BodyError(f"an object is {_short(table)}: a table such as "
                        '{"mesh": "mug.stl", "units": "cm"} is wanted')
    number = table.get("stable_pose")
    body = _standing_body({k: v for k, v in table.items() if k != "stable_pose"}, Path(base_dir))
    if number is None:
        return body
    if not isinstance(number, Integral) or isinstance(number, bool):
        raise BodyError(f"stable_pose = {_short(number)}: a whole number is wanted, 1 for the "
                        "likeliest pose")
    return body_in_stable_pose(body, int(number))


def _standing_body(table: Mapping[str, Any], base_dir: Path) -> Body:
    """An object as its table makes it."""
    name = table.get("name")
    if name is not None and not (
            isinstance(name, str) and name.strip() and len(name) <= NAME_LIMIT):
        raise BodyError(f"name {_short(name)}: a text of 1 to {NAME_LIMIT} characters is wanted")
    kinds = {"mesh": {"mesh", "units", "name"}, "compound": {"compound", "name"},
             "superquadric": {"superquadric", "name"}, "profile": {"profile", "name"},
             "object": {"object", "name"}}
    kind = next((k for k in kinds if k in table), None)
    if kind is None:
        raise BodyError(f"an object table wants one of {', '.join(kinds)}")
    _refuse_unknown(table, kinds[kind], f"{kind} object")
    if kind == "mesh":
        if "units" not in table:
            raise BodyError(f"{table['mesh']}: say units = \"m\", \"cm\", \"mm\" or \"in\"")
        return body_from_mesh(base_dir / str(table["mesh"]), units=table["units"], name=name)
    if kind == "object":
        return replace(body_from_name(str(table["object"])), name=name or str(table["object"]))
    if kind == "profile":
        path = base_dir / str(table["profile"])
        part = Part(Shape.REVOLUTION, profile_m=profile_from_csv(path))
        return _body(name or path.stem, (part,), f"profile {path.name}")
    if name is None:
        raise BodyError(f"a {kind} object wants a name")
    if kind == "superquadric":
        given = _mapping(table, "superquadric")
        _refuse_unknown(given, _SUPERQUADRIC_KEYS, "superquadric outside a compound")
        part = _superquadric_part({"shape": "superquadric", **given})
        a3 = part.superquadric[2]
        place = (0.0, 0.0, a3, 0.0, 0.0, 0.0, 1.0)
        return _body(name, (Part(Shape.SUPERQUADRIC, place=place,
                                 superquadric=part.superquadric),), "superquadric",
                     on_table=any(part.superquadric[5:8]))
    parts = table["compound"]
    if not isinstance(parts, (list, tuple)) or not 0 < len(parts) <= _LARGEST_COMPOUND:
        raise BodyError(f"{name}: compound wants a list of 1 to {_LARGEST_COMPOUND} tables")
    return _body(name, tuple(_placed_part(p, k, base_dir) for k, p in enumerate(parts)),
                 "compound", on_table=True)


def profile_from_csv(path: Path) -> np.ndarray:
    """A radius profile, (z, r) [m], shape (point, 2), from columns z_mm, r_mm; # starts a comment.

    Rows below and above the body, whose radii are 0, are left out. Raises BodyError naming the
    line: z must rise, r must not be negative, two points at least.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BodyError(f"{path}: cannot be read: {error}") from None
    rows: list[tuple[float, float]] = []
    numbers: list[int] = []
    header_seen = False
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [c.strip() for c in line.split(",")]
        if not header_seen:
            if cells != ["z_mm", "r_mm"]:
                raise BodyError(f"{path}:{number}: the columns are z_mm,r_mm, not "
                                f"{_short(line.strip())}")
            header_seen = True
            continue
        try:
            z, r = (float(c.replace("_", "?")) for c in cells)  # float("1_0") is 10
        except ValueError:
            raise BodyError(f"{path}:{number}: {_short(line.strip())}: two numbers are "
                            "wanted") from None
        for column, value, least, most in (("z_mm", z, -1e6, 1e6), ("r_mm", r, 0.0, 1000.0)):
            if not least <= value <= most:
                raise BodyError(f"{path}:{number}: {column} {value:g}: a number from {least:g} to "
                                f"{most:g} is wanted")
        if rows and z <= rows[-1][0]:
            raise BodyError(f"{path}:{number}: z_mm {z:g} after {rows[-1][0]:g}: z must rise; a "
                            "step needs two heights, such as 40 and 40.1, and hollows are cut out "
                            "of a compound")
        rows.append((z, r))
        numbers.append(number)
    if len(rows) < 2 or max(r for _, r in rows) <= 0.0:
        raise BodyError(f"{path}: a profile wants two points at least, and a positive radius")
    profile = np.asarray(rows) / 1000.0
    solid = (profile[1:, 1] > 0.0) | (profile[:-1, 1] > 0.0)  # between a row and the next
    first, last = np.flatnonzero(solid)[[0, -1]]
    if not solid[first:last].all():
        line = numbers[int(first + np.argmin(solid[first:last])) + 1]
        raise BodyError(f"{path}:{line}: r_mm is 0 here and in the row before: what is above is "
                        "not joined to what is below")
    profile = profile[first:last + 2]
    profile[:, 0] -= profile[0, 0]
    return profile


def _mapping(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = table[key]
    if not isinstance(value, Mapping):
        raise BodyError(f"{key}: a table is wanted, not {_short(value)}")
    return value


def _short(value: Any) -> str:
    """A value as a message shows it, cut to a bearable length."""
    try:
        text = repr(value)
    except ValueError:  # an integer of too many digits to print
        return "a huge number"
    return text if len(text) <= 80 else text[:77] + "..."


def _refuse_unknown(table: Mapping[str, Any], known: set[str], what: str) -> None:
    for key in table:
        if key not in known:
            close = get_close_matches(str(key), known, 1)
            hint = f"did you mean {close[0]}? " if close else ""
            raise BodyError(f"{what}: unknown key {_short(key)}; {hint}there are: "
                            f"{', '.join(sorted(known))}")


def _numbers(table: Mapping[str, Any], key: str, count: int, low: float, high: float,
             default: tuple[float, ...] | None = None) -> tuple[float, ...]:
    value = table.get(key, default)
    if value is None:
        raise BodyError(f"{table.get('shape', 'object')}: {key} is missing")
    if isinstance(value, np.ndarray):
        value = value.tolist()
    values = value if isinstance(value, (list, tuple)) else [value]
    good = len(values) == count and all(
        isinstance(v, (int, float, np.integer, np.floating)) and not isinstance(v, bool)
        and low <= v <= high for v in values)
    if not good:
        wanted = f"{count} numbers" if count > 1 else "a number"
        raise BodyError(f"{table.get('shape', 'object')}: {key} = {_short(value)}: {wanted} from "
                        f"{low:g} to {high:g} is right")
    return tuple(float(v) for v in values)


_PART_KEYS = {"shape", "join", "at_mm", "rpy_deg"}
_SUPERQUADRIC_KEYS = {"size_mm", "exponents", "taper", "bend_per_m", "bend_deg"}


def _superquadric_part(table: Mapping[str, Any]) -> Part:
    _refuse_unknown(table, _PART_KEYS | _SUPERQUADRIC_KEYS, "superquadric")
    size = tuple(v / 1000 for v in _numbers(table, "size_mm", 3, 1.0, 1000.0))
    exponents = _numbers(table, "exponents", 2, 0.1, 2.0)
    taper = _numbers(table, "taper", 2, -1.0, 1.0, (0.0, 0.0))
    bend = _numbers(table, "bend_per_m", 1, 0.0, 100.0, (0.0,))
    angle = radians(_numbers(table, "bend_deg", 1, -360.0, 360.0, (0.0,))[0])
    widest = max(*size, _half_width(size, exponents, taper, angle))
    if bend[0] * widest >= 1.0:
        raise BodyError(f"superquadric: bend_per_m = {bend[0]:g} folds the body over; "
                        f"below {1 / widest:.3g} is right")
    return Part(Shape.SUPERQUADRIC, superquadric=(*size, *exponents, *taper, *bend, angle))


def _half_width(
    size_m: tuple[float, ...], exponents: tuple[float, ...], taper: tuple[float, ...],
    angle_rad: float
) -> float:
    """How far the widest tapered section reaches along a direction across the axis [m]: the norm
    dual to that of which a section is the unit ball."""
    up = np.linspace(-1.0, 1.0, 2001)
    section = (1.0 - np.abs(up) ** (2.0 / exponents[0])) ** (exponents[0] / 2.0)
    most = max(size_m)
    along = [abs(way) * half / most * (1.0 + change * up) * section for way, half, change in zip(
        (cos(angle_rad), sin(angle_rad)), size_m, taper, strict=False)]
    power = 2.0 / (2.0 - min(exponents[1], 1.99))  # of rhombi it is that of the larger part
    return most * float(np.linalg.norm(along, power, axis=0).max())


_COMPOUND_KEYS: dict[str, tuple[Shape, dict[str, int]]] = {
    "block": (Shape.BLOCK, {"size_mm": 3}),
    "wedge": (Shape.WEDGE, {"size_mm": 3}),
    "cylinder": (Shape.CYLINDER, {"radius_mm": 1, "height_mm": 1}),
    "capsule": (Shape.CAPSULE, {"radius_mm": 1, "height_mm": 1}),
    "sphere": (Shape.SPHERE, {"radius_mm": 1}),
    "revolution": (Shape.REVOLUTION, {}),
    "superquadric": (Shape.SUPERQUADRIC, {}),
}


def _placed_part(table: Any, index: int, base_dir: Path) -> Part:
    if not isinstance(table, Mapping):
        raise BodyError(f"compound[{index}]: a table is wanted, not {_short(table)}")
    try:
        return _checked_part(table, index, base_dir)
    except BodyError as error:
        raise BodyError(f"compound[{index}]: {error}") from None


def _checked_part(table: Mapping[str, Any], index: int, base_dir: Path) -> Part:
    kind = table.get("shape")
    if not isinstance(kind, str) or kind not in _COMPOUND_KEYS:
        raise BodyError(f"shape {_short(kind)}: one of {', '.join(_COMPOUND_KEYS)}")
    joins = {j.name.lower(): j for j in Join}
    join = table.get("join", "union")
    if not isinstance(join, str) or join not in joins or (index == 0 and join != "union"):
        raise BodyError(f"join {_short(join)}: one of {', '.join(joins)}, and the first part a "
                        "union")
    at = tuple(v / 1000 for v in _numbers(table, "at_mm", 3, -1000.0, 1000.0, (0.0, 0.0, 0.0)))
    rpy = _numbers(table, "rpy_deg", 3, -360.0, 360.0, (0.0, 0.0, 0.0))
    turn = Rotation.from_euler("xyz", rpy, degrees=True).as_quat() if any(rpy) else (0, 0, 0, 1.0)
    place = (*at, *(float(v) for v in turn))
    shape, wanted = _COMPOUND_KEYS[kind]
    if shape == Shape.SUPERQUADRIC:
        return Part(shape, joins[join], place,
                    superquadric=_superquadric_part(table).superquadric)
    if shape == Shape.REVOLUTION:
        _refuse_unknown(table, _PART_KEYS | {"profile"}, kind)
        if "profile" not in table:
            raise BodyError("revolution: profile is missing, a CSV of z_mm, r_mm")
        return Part(shape, joins[join], place,
                    profile_m=profile_from_csv(base_dir / str(table["profile"])))
    _refuse_unknown(table, _PART_KEYS | set(wanted), kind)
    values = {k: tuple(v / 1000 for v in _numbers(table, k, n, 1.0, 1000.0))
              for k, n in wanted.items()}
    if shape == Shape.CAPSULE:
        radius, height = (1000 * values[key][0] for key in ("radius_mm", "height_mm"))
        if height < 2 * radius:
            raise BodyError(f"capsule: height_mm = {height:g} is less than its two round ends of "
                            f"radius_mm = {radius:g}; {2 * radius:g} or more is right")
    if "size_mm" in values:
        size = values["size_mm"]
    else:
        size = (values["radius_mm"][0], 0.0, values.get("height_mm", (0.0,))[0])
    return Part(shape, joins[join], place, size_m=(size[0], size[1], size[2]))


def _body(name: str, parts: tuple[Part, ...], doc: str, on_table: bool = False) -> Body:
    """A body with its box, found from the parts' own; a compound is lowered onto the table.

    Raises BodyError where the longest side of its box is not one that a hand explores.
    """
    lows, highs = [], []
    for part in parts:
        low, high = _part_box(part)
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1)
        placed = (Rotation.from_quat(part.place[3:]).apply(corners.reshape(-1, 3))
                  + np.asarray(part.place[:3]))
        if part.join == Join.UNION:
            lows.append(placed.min(0))
            highs.append(placed.max(0))
    body = Body(name, parts, triple(np.min(lows, 0)), triple(np.max(highs, 0)), doc)
    if on_table:
        from warpgrasp.geometry.body_sampling import body_lowered

        body = body_lowered(body)
    sides = np.subtract(body.high_m, body.low_m)
    if not can_be_explored(sides.max()):
        size = " x ".join(f"{1000 * side:.6g}" for side in sides)
        raise BodyError(f"{name}: comes out at {size} mm; a longest side of {1000 * SMALLEST_M:g} "
                        f"to {1000 * LARGEST_M:g} mm can be explored: are its lengths in mm?")
    return body


def _part_box(part: Part) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if part.shape == Shape.REVOLUTION:
        r, top = part.profile_m[:, 1].max(), part.profile_m[-1, 0]
        return (-r, -r, 0.0), (r, r, top)
    if part.shape == Shape.SUPERQUADRIC:
        a1, a2, a3, _, _, kx, ky, bend, _ = part.superquadric
        x, y, top = a1 * (1 + abs(kx)), a2 * (1 + abs(ky)), a3
        if bend > 0.0:
            reach = (a3**2 + max(x, y)**2) ** 0.5 + max(x, y)
            x, y, top = reach, reach, a3 + reach
        return (-x, -y, -top), (x, y, top)
    x, y, z = part.size_m
    if part.shape in (Shape.BLOCK, Shape.WEDGE):
        return (-x / 2, -y / 2, 0.0), (x / 2, y / 2, z)
    if part.shape == Shape.SPHERE:
        return (-x, -x, 0.0), (x, x, 2 * x)
    return (-x, -x, 0.0), (x, x, z)
