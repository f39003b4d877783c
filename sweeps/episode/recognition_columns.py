"""Recognition of a block's objects, and its columns: the one definition of a right answer.

A robot knows models that it recovered before. Whether it is right is judged by geometry: the right
answer is the known model that was learned from the same body, else "none of these".
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
    right = np.repeat(right_answers(bodies, table), counts)
    return {"recognized_as": found.name, "recognized": found.name == right,
            "recognized_by": found.way, "recognized_probability": found.probability}


def right_answers(bodies: Sequence[Body], table: RecognitionTable) -> np.ndarray:
    """The known model of each body's geometry, whatever its name, str (body,).

    "none of these" where there is none.
    """
    known = _catalogue() if table.way == ALIGNMENT else {
        one.content: one.name for one in models_from_file(table.models).objects}
    return np.array([known.get(body.content, NONE) for body in bodies], object)


@cache
def _catalogue() -> dict[str, str]:
    return {body_from_name(name).content: name for name in BODY_NAMES}


@cache
def _recognizer(device: str) -> Recognizer:
    return recognizer(device=device)
