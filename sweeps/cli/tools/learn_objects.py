"""What `warpgrasp learn` does: known models from episodes with objects that a teacher names."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sweeps.cli.app import DONE, SOME_FAILED
from sweeps.output import init_warp, note, quiet_stdout, say
from sweeps.result_file import write_result
from sweeps.spec.errors import StoreError
from sweeps.spec.objects import object_of_argument
from sweeps.text_table import print_table
from warpgrasp.objects.catalogue_names import BODY_NAMES

if TYPE_CHECKING:
    from strategies.recognition.known_models import KnownModels, KnownObject
    from strategies.recognition.lessons import Lesson
    from strategies.strategy import Strategy

CATALOGUE = "catalogue"
"""An argument that stands for all objects of the catalogue."""


def learn_objects(
    what: Sequence[str], out: Path, *, units: str | None, strategies: Sequence["Strategy"],
    episodes: int, seed: int, unlisted: int, extend: Path | None, only: bool, device: str,
) -> int:
    """Feel each object and write what was recovered; prints a row an object.

    With `unlisted` objects everything is learned anew, else the objects are added to the models of
    `extend`, by default those that ship. One body under two names is refused. An object of which no
    body was recovered is left out, and the exit code says so.
    """
    with quiet_stdout():
        init_warp()
        objects = _tables(what, units)
        from strategies.recognition.known_models import ModelsError, models_from_file, models_text

        try:
            known = models_from_file("" if extend is None else str(extend))
        except ModelsError as error:
            if unlisted == 0:
                raise StoreError(str(error)) from None
            known = None
        models, left_out = _learned(
            objects, strategies, episodes, seed, unlisted, known, only, device,
            _command(what, units, strategies, episodes, seed, unlisted, extend, only))
        write_result(out, models_text(models).encode())
    print_table(("object", "recovered", "faces", "profile", "parameters"),
                [(one.name or "unlisted", str(max(one.tried.values())),
                  *(f"{one.found[way]} of {one.tried[way]}" for way in
                    ("faces", "profile", "parameters")))
                 for one in (*models.objects, models.unlisted)], False)
    for way in models.unused:
        without = next(one.name for one in models.objects if not one.tried[way])
        note(f"{way}: is not used to recognize with this file, for it was not tried on {without}")
    return SOME_FAILED if left_out else DONE


def _tables(what: Sequence[str], units: str | None) -> dict[str, dict[str, Any]]:
    """Objects by name, as a spec would have them. Raises StoreError for a name given twice."""
    names = [name for one in what for name in (BODY_NAMES if one == CATALOGUE else [one])]
    tables: dict[str, dict[str, Any]] = {}
    for name in names:
        table = object_of_argument(name, units)
        if table["name"] in tables:
            raise StoreError(f"{name}: the name {table['name']} is given twice")
        tables[table["name"]] = table
    if units is not None and not any("mesh" in table for table in tables.values()):
        raise StoreError("--units: is of mesh files, and none is named")
    return tables


def _learned(
    objects: dict[str, dict[str, Any]], strategies: Sequence["Strategy"], episodes: int, seed: int,
    unlisted: int, known: "KnownModels | None", only: bool, device: str, made_by: str,
) -> tuple["KnownModels", set[str]]:
    """The models, and objects of which no body was recovered."""
    from dataclasses import replace

    from strategies.recognition.lessons import add_objects, learn_models, taught
    from sweeps.episode.teaching import contents_of, teach, unlisted_table

    every = contents_of(objects)
    _compare(every, () if only or unlisted or known is None else known.objects)
    lessons: list[Lesson] = []
    for strategy, lesson in teach(objects, strategies, episodes, seed, device):
        lessons.append(lesson)
        note(f"{strategy.name}: {len(lesson.names)} episodes")
    contents = taught(lessons, every)
    left_out = set(objects) - set(contents)
    for name in sorted(left_out):
        say(f"{name}: no body was recovered in any episode; it is left out")
    if not contents:
        raise StoreError("no object can be learned; nothing was written")
    try:
        if unlisted == 0 and known is not None:
            before = replace(known, objects=()) if only else known
            return add_objects(before, lessons, contents, made_by), left_out
        others = [unlisted_table(seed, number) for number in range(unlisted)]
        for strategy, lesson in teach({table["name"]: table for table in others}, strategies, 2,
                                      seed, device, listed=False):
            lessons.append(lesson)
            note(f"{strategy.name}: {len(lesson.names)} episodes with unlisted objects")
        return learn_models(lessons, contents, made_by), left_out
    except ValueError as error:
        raise StoreError(str(error)) from None


def _compare(contents: Mapping[str, str], known: Sequence["KnownObject"]) -> None:
    """Compares the objects to learn, name to hash of geometry, with each other and with models that
    stay. Raises StoreError for one body under two names; notes a name that gets another body."""
    names: dict[str, str] = {one.content: one.name for one in known if one.name not in contents}
    for name, content in contents.items():
        if (other := names.setdefault(content, name)) != name:
            raise StoreError(f"{name}: is the same body as {other}, which no touch can tell apart; "
                             "learn it under one name")
    for one in known:
        if contents.get(one.name, one.content) != one.content:
            note(f"{one.name}: takes the place of the model of another body")


def _command(what: Sequence[str], units: str | None, strategies: Sequence["Strategy"],
             episodes: int, seed: int, unlisted: int, extend: Path | None, only: bool) -> str:
    """The command that makes the same models again, without folders."""
    names = [Path(one).name for one in what]
    words = ["warpgrasp", "learn", *names, *(["--units", units] if units else []),
             "--episodes", str(episodes), "--seed", str(seed)]
    for strategy in strategies:
        words += ["--strategy", Path(strategy.name).name]
    words += ["--unlisted", str(unlisted)] if unlisted else []
    words += ["--extend", extend.name] if extend is not None else []
    return shlex.join([*words, *(["--only"] if only else [])])
