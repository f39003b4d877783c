"""Recognition of a block's objects, and its columns: the one definition of a right answer.

A robot knows models that it recovered before. Whether it is right is judged by geometry: a right
answer is a known model that was learned from the same body, else "none of these".
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from strategies.recognition.answers import ALIGNMENT, NONE, Recognition, recognize
from strategies.recognition.catalogue_alignment import Recognizer, recognizer
from strategies.recognition.known_models import models_from_file
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from warpgrasp.geometry.body import Body
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.objects.catalogue_names import BODY_NAMES
from warpgrasp.parameters import RecognitionTable


def recognize_objects(
    belief: Belief, recovered: Recovered, table: RecognitionTable, device: str
) -> Recognition:
    """What each world's object is taken for. Raises ModelsError where the models cannot be read."""
    if table.way == ALIGNMENT:
        return _recognizer(device).recognize(belief, recovered)
    return recognize(belief, recovered, models_from_file(table.models), way=table.way,
                     none_prior=table.none_prior)


def columns_of_recognition(
    found: Recognition, table: RecognitionTable, bodies: Sequence[Body], counts: Sequence[int]
) -> dict[str, np.ndarray]:
    """Columns of a block with so many worlds of each of `bodies` in turn, (world,) each."""
    return {"recognized_as": found.name,
            "recognized": right_ones(found.name, bodies, table, counts),
            "recognized_by": found.way, "recognized_probability": found.probability}


def right_ones(names: np.ndarray, bodies: Sequence[Body], table: RecognitionTable,
               counts: Sequence[int]) -> np.ndarray:
    """Whether the answers `names` (world,) are right, bool (world,), in so many worlds of each of
    `bodies` in turn."""
    right = [answers for answers, count in zip(right_answers(bodies, table), counts, strict=True)
             for _ in range(count)]
    return np.array([name in answers for name, answers in zip(names, right, strict=True)], bool)


def right_answers(bodies: Sequence[Body], table: RecognitionTable) -> list[set[str]]:
    """Of each body the known models of its geometry, whatever their names; there may be several.

    "none of these" where there is none.
    """
    known = _catalogue() if table.way == ALIGNMENT else [
        (one.content, one.name) for one in models_from_file(table.models).objects]
    return [{name for content, name in known if content == body.content} or {NONE}
            for body in bodies]


@cache
def _catalogue() -> list[tuple[str, str]]:
    return [(body_from_name(name).content, name) for name in BODY_NAMES]


@cache
def _recognizer(device: str) -> Recognizer:
    return recognizer(device=device)
