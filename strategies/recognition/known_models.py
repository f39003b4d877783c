"""Known models: what was recovered by touch of each object, and of objects that are not listed.

A file of JSON. Those that ship stand in `models.json` beside this file; `warpgrasp learn` writes
one's own, and the key `models` of a spec's `[recognition]` names it.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fit.interpretation_tree import FaceModel
from fit.match_parameters import Kernels, Population
from strategies.recognition.descriptions import FACES, NUMBERS, WAYS
from strategies.recognition.match_faces import closed_model
from warpgrasp.objects.catalogue_names import NO_ANSWER, NONE_OF_THESE

FORMAT = "warpgrasp models 1"
SHIPPED = Path(__file__).with_name("models.json")
FEWEST = 4
"""Recoveries of an object by one way for a population or a polyhedron of its own."""
DIGITS = 5


class ModelsError(ValueError):
    """A file of models that cannot be used; the message says why."""


@dataclass(frozen=True)
class FacePlanes:
    """A polyhedron, by its planes in a frame that stands on the table."""

    normals: np.ndarray
    """(face, 3)."""
    offset_m: np.ndarray
    """(face,)."""
    std_m: float
    """Of a felt plane about these."""
    model: FaceModel


@dataclass(frozen=True)
class KnownObject:
    """What was recovered of one object, or of all that are not listed."""

    name: str
    tried: Mapping[str, int]
    """Episodes in which a body was recovered and each way was looked for."""
    found: Mapping[str, int]
    """Those of them in which the way could be taken."""
    populations: Mapping[str, Population]
    """By way, of those that compare numbers."""
    faces: FacePlanes | None = None
    content: str = ""
    """The hash of the object's geometry, by which an answer is judged; no way looks at it."""


@dataclass(frozen=True)
class KnownModels:
    """Objects that can be named, and what is known of those that cannot."""

    objects: tuple[KnownObject, ...]
    unlisted: KnownObject
    temperature: Mapping[str, float]
    """By way: what log densities are divided by, so that probabilities are calibrated."""
    made_by: str = ""
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(known.name for known in self.objects))

    @property
    def unused(self) -> tuple[str, ...]:
        """Ways that were not tried on every object: of some it is not known what would be found."""
        return tuple(way for way in WAYS if not all(known.tried[way] for known in self.objects))


def models_from_file(file: str) -> KnownModels:
    """The models of a file, "" for those that ship. Raises ModelsError."""
    try:
        text = Path(file or SHIPPED).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelsError(f"{file}: cannot be read: {error}") from None
    try:
        return _models_of(text)
    except (ValueError, TypeError, KeyError, AttributeError, IndexError, RecursionError) as error:
        raise ModelsError(f"{file}: is no file of models ({type(error).__name__}: {error!s:.200}); "
                          "`warpgrasp learn` writes one") from None


@cache
def _models_of(text: str) -> KnownModels:
    value = json.loads(text)
    if value["format"] != FORMAT:
        raise ValueError(f"format {value['format']!r:.40}, should be {FORMAT!r}")
    if value["numbers"] != {way: list(names) for way, names in NUMBERS.items()}:
        raise ValueError("numbers: are others than those that are compared")
    objects = tuple(_object_of(name, entry) for name, entry in value["objects"].items())
    if not objects:
        raise ValueError("objects: none")
    for known in objects:
        if known.name in ("", NONE_OF_THESE, NO_ANSWER):
            raise ValueError(f"objects: {known.name!r} is no name of one")
    unlisted = _object_of("", value["unlisted"])
    if unlisted.populations.keys() != NUMBERS.keys():
        raise ValueError(f"unlisted: wants {' and '.join(NUMBERS)}")
    temperature = {way: float(value["temperature"][way]) for way in WAYS}
    if not all(0 < t < np.inf for t in temperature.values()):
        raise ValueError("temperature: should be positive numbers")
    return KnownModels(objects, unlisted, temperature, str(value["made_by"]))


def _object_of(name: str, entry: Mapping[str, Any]) -> KnownObject:
    name.encode()  # rows are UTF-8; a ValueError where it has halves of characters
    tried, found = ({way: int(entry[key][way]) for way in WAYS} for key in ("tried", "found"))
    if not all(0 <= found[way] <= tried[way] for way in WAYS):
        raise ValueError(f"{name or 'unlisted'}: found should be from 0 to as many as were tried")
    populations = {way: _population_of(way, entry[way]) for way in NUMBERS if way in entry}
    faces = None
    if FACES in entry:
        normals = np.array(entry[FACES]["normals"], float)
        offset, std = np.array(entry[FACES]["offsets_m"], float), float(entry[FACES]["std_m"])
        if not 0 < std < np.inf:
            raise ValueError(f"{name}: std_m of faces should be positive")
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        model = closed_model(name, normals, offset)
        if model is None:
            raise ValueError(f"{name}: the planes of its faces hold no body")
        faces = FacePlanes(normals, offset, std, model)
    return KnownObject(name, tried, found, populations, faces, str(entry.get("content", "")))


def _population_of(way: str, entry: Mapping[str, Any]) -> Population:
    width = len(NUMBERS[way])
    mean, scatter = np.array(entry["mean"], float), _scatter_of(way, entry)
    if mean.shape != (width,) or not np.isfinite(mean).all():
        raise ValueError(f"{way}: wants {width} numbers")
    kernels = None
    if "kernels" in entry:
        middles = np.array(entry["kernels"]["middles"], float)
        if middles.shape[1:] != (width,) or not (len(middles) and np.isfinite(middles).all()):
            raise ValueError(f"{way}: wants {width} numbers of every kernel")
        kernels = Kernels(middles, _scatter_of(way, entry["kernels"]))
    return Population(mean, scatter, max(int(entry["count"]), 1), kernels)


def _scatter_of(way: str, entry: Mapping[str, Any]) -> np.ndarray:
    width, rows = len(NUMBERS[way]), entry["scatter"]
    scatter = np.zeros((width, width))
    for k, row in enumerate(rows):
        scatter[k, : k + 1] = scatter[: k + 1, k] = row
    if len(rows) != width or not np.isfinite(scatter).all():
        raise ValueError(f"{way}: wants {width} rows of their scatter")
    np.linalg.cholesky(scatter)  # a scatter is positive definite
    return scatter


def models_text(models: KnownModels) -> str:
    """The content of a file of models; reading it gives the same models, rounded."""
    value = {"format": FORMAT, "made_by": models.made_by,
             "numbers": {way: list(names) for way, names in NUMBERS.items()},
             "temperature": {way: _rounded(t) for way, t in models.temperature.items()},
             "unlisted": _entry_of(models.unlisted),
             "objects": {known.name: _entry_of(known) for known in models.objects}}
    lines = json.dumps(value, indent=1, allow_nan=False)
    # A list of numbers on one line.
    return _one_line_lists(lines) + "\n"


def _entry_of(known: KnownObject) -> dict[str, Any]:
    entry: dict[str, Any] = {"content": known.content, "tried": dict(known.tried),
                             "found": dict(known.found)}
    for way, population in known.populations.items():
        entry[way] = {
            "count": population.count, "mean": [_rounded(v) for v in population.mean],
            "scatter": _triangle(population.scatter)}
        if population.kernels is not None:
            entry[way]["kernels"] = {
                "scatter": _triangle(population.kernels.scatter),
                "middles": [[_rounded(v) for v in row] for row in population.kernels.middles]}
    if known.faces is not None:
        entry[FACES] = {"normals": [[round(float(v), DIGITS) for v in row]
                                    for row in known.faces.normals],
                        "offsets_m": [_rounded(v) for v in known.faces.offset_m],
                        "std_m": _rounded(known.faces.std_m)}
    return entry


def _triangle(scatter: np.ndarray) -> list[list[float]]:
    return [[_rounded(v) for v in row[: k + 1]] for k, row in enumerate(scatter)]


def _rounded(value: float) -> float:
    return float(f"{float(value):.{DIGITS}g}")


def _one_line_lists(text: str) -> str:
    """JSON whose lists of plain values stand on one line each."""
    return re.sub(r"\[[^\[\]{}]*\]", lambda found: re.sub(r"\s+", " ", found[0])
                  .replace("[ ", "[").replace(" ]", "]"), text)
