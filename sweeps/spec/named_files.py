"""Keys of a spec's sections that name a file of the user's: it is found, read once, made absolute.

`[fit] reconstruct` is a word, or a function in a file; `[recognition] models` is a file that
`warpgrasp learn` wrote.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from strategies.planners.planner_file import PlannerError
from strategies.reconstruct.plug_in_name import BUILT_IN as WORDS
from strategies.reconstruct.plug_in_name import find_plug_in, plug_in_file
from sweeps.spec.errors import KeyPath, Problems, choose, short
from sweeps.spec.objects import CSV_LIMIT, NoFile, named_file
from warpgrasp.parameters import RecognitionTable

KEY = "fit.reconstruct"
MODELS_LIMIT = 1 << 24
"""Bytes of a file of models."""
UNSWEPT = "recognition.models"
"""The key that names a file; a study keeps one."""


def read_reconstruct(value: str, base_dir: Path, problems: Problems,
                     path: KeyPath = ("fit", "reconstruct")) -> str:
    """The word, or `file.py:function` with its file made absolute; what is wrong is noted."""
    if value in WORDS:
        return value
    file = plug_in_file(value)
    if not file:
        problems.add(path, f"is {short(value)}; {choose(value, WORDS)}; or a function in a "
                     'file, as "mine.py:my_network"')
        return WORDS[0]
    try:
        call = f"{named_file(file, base_dir, CSV_LIMIT)}:{value.rpartition(':')[2]}"
    except NoFile as error:
        problems.add(path, str(error))
        return WORDS[0]
    try:
        find_plug_in(call)
    except PlannerError as error:
        problems.add(path, str(error))
    return call


def check_swept_reconstruct(values: Any, path: KeyPath, problems: Problems) -> None:
    """Notes a value of a sweep that is no word: a plug-in is named in [fit]."""
    for value in values:
        if value not in WORDS:
            problems.add(path, f"{KEY}: is {short(value)}; {choose(value, WORDS)}; a function of "
                         "yours is named in [fit], not in a sweep")


def with_models(
    table: RecognitionTable, base_dir: Path, problems: Problems
) -> RecognitionTable:
    """The table with its file made absolute; what is wrong with the file is noted."""
    if not table.models:
        return table
    path = ("recognition", "models")
    try:
        file = named_file(table.models, base_dir, MODELS_LIMIT)
    except NoFile as error:
        problems.add(path, str(error))
        return table
    # Heavy, and only a study with a file of its own needs it.
    from strategies.recognition.known_models import ModelsError, models_from_file

    try:
        models_from_file(str(file))
    except ModelsError as error:
        problems.add(path, str(error))
    return replace(table, models=str(file))
