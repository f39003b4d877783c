"""The file of known models that a spec's `[recognition]` names: found, read once, made absolute."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from sweeps.spec.errors import Problems
from sweeps.spec.objects import NoFile, named_file
from warpgrasp.parameters import RecognitionTable

MODELS_LIMIT = 1 << 24
"""Bytes of a file of models."""
UNSWEPT = "recognition.models"
"""The key that names a file; a study keeps one."""


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


def canonical_table(table: Any, hash_of: Any) -> dict[str, Any]:
    """A section as plain data, a file by its content: `hash_of` takes its path."""
    values = asdict(table)
    if values.get("models"):
        values["models"] = f"sha256:{hash_of(values['models'])}"
    return values
