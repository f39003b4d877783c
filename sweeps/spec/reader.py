"""Reading a spec: TOML to a resolved `Study`, or every problem at once with file and line."""

import json
import re
import tomllib
from codecs import BOM_UTF8
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

from sweeps.output import quiet_stdout
from sweeps.spec.axes import read_axes, read_overrides
from sweeps.spec.cell import SECTIONS
from sweeps.spec.checks import (
    ERROR_KEYS,
    LIMIT_KEYS,
    PAD_KEYS,
    PLACE_KEYS,
    check_arms,
    check_errors,
    check_limits,
    check_order,
    check_pads,
    check_places,
    check_used,
)
from sweeps.spec.errors import Problem, Problems, SpecError, choose, short
from sweeps.spec.hands import check_closings, check_hands, read_hand, spelled_out
from sweeps.spec.named_files import (
    KEY,
    check_swept_reconstruct,
    kept_name,
    read_arm,
    read_reconstruct,
    with_files,
    with_models,
)
from sweeps.spec.objects import read_objects
from sweeps.spec.search import Search, read_search, with_ends
from sweeps.spec.strategies import read_strategies
from sweeps.spec.study import (
    ARM_KEY,
    CELL_LIMIT,
    EPISODE_LIMIT,
    HAND_KEY,
    WORDS,
    Study,
    StudyTable,
)
from sweeps.spec.toml_reader import parse_toml, read_content
from sweeps.spec.units import read_table

HEAD = ("schema", "name", "seed", "episodes_per_cell", "keep")
REQUIRED = ("schema", "objects", "strategy")
TOP = (*HEAD, "objects", "strategy", *SECTIONS, "sweep", "search")


def read_spec(file: FilePath, overrides: Sequence[str] = (), content: bytes | None = None
              ) -> Study:
    """The study a spec describes, with `--set KEY=V1,V2` overrides; `SpecError` lists problems.

    Whoever keeps the spec's text gives its `content`: the file may be edited meanwhile.

    A spec that a study keeps has the overrides that it was run with under its key `set`.
    """
    values, lines = parse_toml(file, read_content(file) if content is None else content)
    problems = Problems(str(file), lines)
    try:
        text_axes, head_values = read_overrides(_settings(values.pop("set", []), overrides))
    except SpecError as error:
        problems.found.extend(error.problems)
        text_axes, head_values = {}, {}
    problems.overrides = frozenset([*((key,) for key in head_values),
                                    *(("sweep", "grid", key) for key in text_axes)])
    with quiet_stdout():  # planners' files are run
        study = resolve({**values, **head_values}, file.resolve().parent, problems, text_axes)
    if problems.found:
        raise SpecError(sorted(problems.found, key=_place))
    return study


def spec_text(content: bytes, overrides: Sequence[str]) -> bytes:
    """The text of a spec that alone, without `--set`, describes the same study as a spec of this
    content that was read, with them."""
    text = content.removeprefix(BOM_UTF8)
    if not overrides:
        return text
    given = _settings(tomllib.loads(text.decode()).get("set", []), overrides)
    line = f"set = {json.dumps(given, ensure_ascii=False)}  # what --set said\n"
    return (line + _without_set(text.decode())).encode()


def _without_set(text: str) -> str:
    """The spec without its own key `set`, which stands above all tables."""
    lines = text.splitlines(keepends=True)
    for start, line in enumerate(lines):
        if line.lstrip().startswith("["):
            break
        if re.match(r"""\s*["']?set["']?\s*=""", line):
            for stop in range(start + 1, len(lines) + 1):
                try:
                    tomllib.loads("".join(lines[start:stop]))
                except tomllib.TOMLDecodeError:  # its list goes on in the next line
                    continue
                return "".join(lines[:start] + lines[stop:])
    return text


def _settings(own: Any, overrides: Sequence[str]) -> list[str]:
    """The overrides of a spec's key `set`, and those of the command, which come before them."""
    if not isinstance(own, list) or not all(isinstance(text, str) for text in own):
        raise SpecError([Problem("set", "", 'should be a list of texts such as "seed=8"')])
    keys = set(map(_key_of, overrides))
    return [*(text for text in own if _key_of(text) not in keys), *overrides]


def _key_of(override: str) -> str:
    key = override.partition("=")[0].strip()
    return WORDS.get(key, key)


def resolve(values: Mapping[str, Any], base_dir: FilePath, problems: Problems,
            extra_grid: Mapping[str, list[Any]] | None = None) -> Study:
    """The study a spec's values describe; what is wrong is noted in `problems`."""
    values = spelled_out(values)
    for key in REQUIRED:
        if key not in values:
            problems.add((), f"{key}: missing; {_EXAMPLES[key]}")
    for key in values:
        if key not in TOP:
            problems.add((key,), f"unknown key; {choose(key, TOP)}")
    head = StudyTable(**read_table(StudyTable, {k: v for k, v in values.items() if k in HEAD},
                                   (), problems))
    if not head.name:
        spec = FilePath(problems.file)
        head = replace(head, name=kept_name(base_dir / spec.name) or spec.stem)
    tables = {name: table(**read_table(
        table, values.get(name, {}), (name,), problems,
        f"a name (`warpgrasp {name}s` lists them) or a table" if name in WORDS else "a table"))
        for name, table in SECTIONS.items()}
    tables["hand"] = replace(tables["hand"], kind=read_hand(tables["hand"].kind, base_dir,
                                                            problems))
    tables["arm"] = replace(tables["arm"], kind=read_arm(tables["arm"].kind, base_dir, problems))
    tables["recognition"] = with_models(tables["recognition"], base_dir, problems)
    tables["fit"] = replace(tables["fit"], reconstruct=read_reconstruct(
        tables["fit"].reconstruct, base_dir, problems))
    strategies = read_strategies(values.get("strategy", []), base_dir, problems)
    objects = read_objects(values.get("objects", []), base_dir, problems)
    axes = read_axes(values.get("sweep", {}), extra_grid or {}, strategies, tables, head.seed,
                     problems)
    for key, read in _KINDS:
        axes = tuple(with_files(axis, key, read, base_dir, problems) for axis in axes)
    check_order(tables, values, axes, problems)
    for axis in axes:
        if KEY in axis.keys:
            check_swept_reconstruct([point[axis.keys.index(KEY)] for point in axis.values],
                                    problems.at_swept(KEY), problems)
    search = read_search(values.get("search"), strategies, axes, problems)
    _check_searched(search, values.get("search"), base_dir, problems)
    study = Study(head, objects, strategies, tables, axes, search, base_dir)
    if (spanned := max(study.cell_count, study.setting_count)) > CELL_LIMIT:
        problems.add(("sweep",), f"spans {spanned:,} cells; the limit is {CELL_LIMIT:,}")
    elif study.cell_count * head.episodes_per_cell > EPISODE_LIMIT:
        problems.add(("episodes_per_cell",),
                     f"makes {study.cell_count * head.episodes_per_cell:,} episodes in "
                     f"{study.cell_count:,} cells; the limit is {EPISODE_LIMIT:,}")
    check_closings(study, problems)
    if not problems.found:
        check_hands(study, values, problems)
        check_arms(study, values.get("arm", {}), problems)
        check_places(with_ends(study, PLACE_KEYS), problems)
        check_pads(with_ends(study, PAD_KEYS), problems)
        check_limits(with_ends(study, LIMIT_KEYS), problems)
        check_errors(with_ends(study, ERROR_KEYS), problems)
    if not problems.found:
        check_used(study, problems)
    return study


def _check_searched(search: Search | None, table: Any, base_dir: FilePath, problems: Problems
                    ) -> None:
    """Notes what a search names and there is not: hands, arms, what stands for the body. `table` is
    the spec's, where a hand or an arm may stand under its word."""
    for factor in search.factors if search else ():
        path = ("search", next((word for word, key in WORDS.items()
                                if key == factor.key and word in table), factor.key))
        for key, read in _KINDS:
            for name in factor.choices if factor.key == key else ():
                if name.endswith(".toml"):
                    problems.add(path, f"is {short(name)}; a search proposes those that ship; "
                                 "write yours in [sweep.grid]")
                else:
                    read(name, base_dir, problems, path)
        if factor.key == KEY:
            check_swept_reconstruct(factor.choices, path, problems)


_KINDS = ((HAND_KEY, read_hand), (ARM_KEY, read_arm))
_EXAMPLES = {
    "schema": "write schema = 1",
    "objects": 'name at least one, as in objects = ["block", "wine_bottle"]',
    "strategy": 'name at least one, as in [[strategy]] with name = "ring6"',
}


def _place(problem: Problem) -> tuple[bool, int]:
    line = problem.where.rpartition(":")[2]
    return not line.isdigit(), int(line) if line.isdigit() else 0
