"""The key `[fit] reconstruct` of a spec: a word, or a function in a file of the user's."""

from pathlib import Path
from typing import Any

from strategies.planners.planner_file import PlannerError
from strategies.reconstruct.plug_in_name import BUILT_IN as WORDS
from strategies.reconstruct.plug_in_name import find_plug_in, plug_in_file
from sweeps.spec.errors import KeyPath, Problems, choose, short
from sweeps.spec.objects import CSV_LIMIT, NoFile, named_file

KEY = "fit.reconstruct"


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
