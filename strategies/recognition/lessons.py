"""Known models from episodes: populations of numbers, polyhedra, and how far to trust them.

Everything is learned from recovered bodies; the truth enters only as the name that a teacher gives.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fit.interpretation_tree import FaceModel, Interpretation
from fit.match_parameters import Population, kernels_of, population_of, posterior
from strategies.recognition.answers import log_densities
from strategies.recognition.descriptions import (
    FACES,
    NUMBERS,
    WAYS,
    Described,
    FeltFaces,
    described,
)
from strategies.recognition.known_models import FEWEST, FacePlanes, KnownModels, KnownObject
from strategies.recognition.match_faces import best_interpretations, closed_model, with_table
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered

UNLISTED = ""
"""The name of what is not to be listed."""
LEAST_STD_M = 0.001
"""Of a felt plane about the model's, at least [est]."""
SELDOM = 0.3
"""A face found in a smaller share of the episodes is left out: a ridge crossed, a neighbour."""
CANDIDATES = 6
"""Episodes whose polyhedra are compared with all others'."""
ROUNDS = 2
"""Of averaging planes and closing the polyhedron again."""
TEMPERATURES = np.geomspace(1.0, 10.0, 25)
"""Among which the likeliest is taken; below one nothing would be gained but overconfidence."""
NONE_PRIOR = 0.2
"""Share of unlisted objects by which temperatures are judged."""
FOLDS = 8
"""Parts of the episodes, each recognized by models of the others, which tells the temperatures."""


@dataclass(frozen=True)
class Lesson:
    """A batch of episodes; a teacher says which object was felt in each world."""

    names: np.ndarray
    """str (world,)."""
    bodies: np.ndarray
    """Number of the object, int (world,), which tells unlisted ones apart."""
    found: Mapping[str, Described]
    """By way."""

    def part(self, kept: np.ndarray) -> "Lesson":
        """The worlds `kept`, bool (world,); the others count as not tried."""
        return replace(self, found={way: found.part(kept) for way, found in self.found.items()})


def lesson_of(belief: Belief, recovered: Recovered, names: np.ndarray,
              bodies: np.ndarray | None = None) -> Lesson:
    """What a batch of episodes teaches of the objects that stood in its worlds, str (world,).

    `bodies` are their numbers, int (world,), by which lessons know an unlisted object again; by
    default those of the worlds.
    """
    each = np.arange(len(names)) if bodies is None else bodies
    return Lesson(names, each, {way: described(belief, recovered, way) for way in WAYS})


def taught(lessons: Sequence[Lesson], contents: Mapping[str, str]) -> dict[str, str]:
    """Those of `contents` that can be learned: a body was recovered in one of their episodes."""
    return {name: content for name, content in contents.items()
            if any(len(lesson.found[way].part(lesson.names == name).rows)
                   for lesson in lessons for way in WAYS)}


def learn_models(
    lessons: Sequence[Lesson], contents: Mapping[str, str], made_by: str
) -> KnownModels:
    """Models of all objects that the lessons name, and of the unlisted ones.

    Each eighth of the episodes is recognized by models of the others, which tells the temperatures;
    then all make the models. `contents` has the hash of each named object's geometry.
    Raises ValueError where nothing is unlisted or nothing named.
    """
    if not contents or not any((lesson.names == UNLISTED).any() for lesson in lessons):
        raise ValueError("lessons: should name objects, and hold unlisted ones beside them")
    alike: dict[str, float] = dict.fromkeys(WAYS, 1.0)
    trials = []
    for fold in range(FOLDS):
        # In pairs, so that both episodes with an unlisted object are on one side.
        asked = [np.arange(len(lesson.names)) // 2 % FOLDS == fold for lesson in lessons]
        rest, part = ([lesson.part(kept == side) for lesson, kept in zip(lessons, asked,
                       strict=True)] for side in (False, True))
        trials.append((_models(rest, taught(rest, contents), alike, made_by), part))
    return _models(lessons, contents, {way: _temperature(trials, way) for way in WAYS}, made_by)


def add_objects(
    known: KnownModels, lessons: Sequence[Lesson], contents: Mapping[str, str], made_by: str
) -> KnownModels:
    """The known models with the objects of the lessons, in place of those of the same name.

    Raises ValueError for an object of which no body was recovered.
    """
    common = {way: _mean_scatter(known.objects, way) for way in NUMBERS}
    kept = [one for one in known.objects if one.name not in contents]
    added = [_object(name, lessons, common, content) for name, content in contents.items()]
    return replace(known, objects=(*kept, *added), made_by=made_by)


def _models(lessons: Sequence[Lesson], contents: Mapping[str, str],
            temperature: Mapping[str, float], made_by: str) -> KnownModels:
    alone = [_object(name, lessons, {}) for name in contents]
    common = {way: _mean_scatter(alone, way) for way in NUMBERS}
    objects = tuple(_object(name, lessons, common, content)
                    for name, content in contents.items())
    unlisted = _unlisted(lessons, common)
    missing = [way for way in NUMBERS if way not in unlisted.populations]
    if missing:
        raise ValueError(f"lessons: too few unlisted objects were told by {', '.join(missing)}")
    return KnownModels(objects, unlisted, temperature, made_by)


def _unlisted(
    lessons: Sequence[Lesson], common: Mapping[str, np.ndarray | None]
) -> KnownObject:
    """What the lessons tell of unlisted objects, which are of several kinds."""
    together, kinds = _object(UNLISTED, lessons, {}), {}
    for way, population in together.populations.items():
        found = [lesson.found[way].part(lesson.names == UNLISTED) for lesson in lessons]
        shapes = np.concatenate([part.numbers for part in found])
        bodies = np.concatenate([lesson.bodies[part.rows]
                                 for lesson, part in zip(lessons, found, strict=True)])
        kinds[way] = replace(
            population, kernels=kernels_of(shapes, bodies, population, common.get(way)))
    return replace(together, populations=kinds)


def _mean_scatter(objects: Sequence[KnownObject], way: str) -> np.ndarray | None:
    scatters = [one.populations[way].scatter for one in objects if way in one.populations]
    return np.mean(scatters, axis=0) if scatters else None


def _object(name: str, lessons: Sequence[Lesson],
            common: Mapping[str, np.ndarray | None], content: str = "") -> KnownObject:
    """What the lessons tell of one object."""
    parts = {way: [lesson.found[way].part(lesson.names == name) for lesson in lessons]
             for way in WAYS}
    tried = {way: int(sum(part.tried.sum() for part in parts[way])) for way in WAYS}
    found = {way: int(sum(len(part.rows) for part in parts[way])) for way in WAYS}
    if name != UNLISTED and not any(found.values()):
        raise ValueError(f"{name}: no body was recovered in any episode; nothing can be learned")
    populations: dict[str, Population] = {}
    for way in NUMBERS:
        if found[way] >= FEWEST:
            numbers, covariance = (np.concatenate([getattr(part, key) for part in parts[way]])
                                   for key in ("numbers", "covariance"))
            populations[way] = population_of(numbers, covariance, common.get(way))
    faces = [felt for part in parts[FACES] for felt in part.faces] if name != UNLISTED else []
    return KnownObject(name, tried, found, populations,
                       _polyhedron(name, faces) if len(faces) >= FEWEST else None, content)


def _polyhedron(name: str, felt: Sequence[FeltFaces]) -> FacePlanes | None:
    """The polyhedron that explains most of the faces felt, its planes averaged over the episodes.
    """
    best: tuple[tuple[int, float], FaceModel] | None = None
    widest = sorted(range(len(felt)), key=lambda k: -len(felt[k].points_m))[:CANDIDATES]
    for k in widest:
        model = closed_model(name, *_planes_alone(felt[k]))
        if model is None:
            continue
        found = [f for f in best_interpretations(felt, model) if f is not None]
        worth = (sum(f.assigned for f in found), -float(np.mean([f.rms_m for f in found] or [0])))
        if best is None or worth > best[0]:
            best = worth, model
    if best is None:
        return None
    model, planes = best[1], None
    for _ in range(ROUNDS):
        planes = _averaged(model, felt)
        closed = None if planes is None else closed_model(name, *planes[:2])
        if planes is None or closed is None:
            return None
        model = closed
    return None if planes is None else FacePlanes(*planes, model)


def _planes_alone(faces: FeltFaces) -> tuple[np.ndarray, np.ndarray]:
    """Planes of one episode with the table, about the middle of the faces on the table."""
    points, normals = with_table(faces)
    return normals, ((points - points[-1]) * normals).sum(1)


def _averaged(
    model: FaceModel, felt: Sequence[FeltFaces]
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Planes of a model averaged over what was felt of them, and how far those lie about them."""
    seen: dict[int, list[tuple[np.ndarray, float]]] = {}
    found: list[Interpretation] = []
    for faces, one in zip(felt, best_interpretations(felt, model), strict=True):
        if one is None:
            continue
        found.append(one)
        for face, normal, offset in zip(one.assignment, *one.planes(*with_table(faces)),
                                        strict=True):
            if face >= 0:
                seen.setdefault(face, []).append((normal, offset))
    often = {face: planes for face, planes in sorted(seen.items())
             if len(planes) >= max(SELDOM * len(found), 1)}
    if len(found) < FEWEST:
        return None
    normals = np.array([np.mean([n for n, _ in planes], axis=0) for planes in often.values()])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offset = np.array([np.median([d for _, d in planes]) for planes in often.values()])
    free = sum(max(one.assigned - 3, 1) for one in found)  # the table, and two that fix the place
    square = sum(float((one.away_m**2).sum()) for one in found)
    return normals, offset, max(float(np.sqrt(square / free)), LEAST_STD_M)


def _temperature(trials: Sequence[tuple[KnownModels, Sequence[Lesson]]], way: str) -> float:
    """The temperature under which the names in lessons that models were not learned from are
    likeliest."""
    right, unlisted = [], []
    for models, lessons in trials:
        listed = [*models.names, UNLISTED]
        for lesson in lessons:
            # Not objects that no body was recovered of in the episodes that made the models.
            found = lesson.found[way].part(np.isin(lesson.names.astype(str), listed))
            truth = np.array([listed.index(str(name)) for name in lesson.names[found.rows]], int)
            log = log_densities(found, models, way)
            right.append([posterior(log, none_prior=NONE_PRIOR, temperature=t)[
                np.arange(len(truth)), truth] for t in TEMPERATURES])
            unlisted.append(truth == len(models.names))
    share, none = np.concatenate(right, axis=1), np.concatenate(unlisted)
    if len(none) == 0:
        return 1.0
    # As many unlisted ones as the prior says.
    weight = np.where(none, NONE_PRIOR / max(none.sum(), 1),
                      (1 - NONE_PRIOR) / max((~none).sum(), 1))
    loss = -(weight * np.log(share + 1e-12)).sum(1)
    return float(TEMPERATURES[int(np.argmin(loss))])
