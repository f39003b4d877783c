"""The rules of the house that a reader should not have to remember: who may import whom, and what
a folder and a file may hold."""

import ast
import importlib
import re
import subprocess
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import pytest
from places import ROOT

FLOORS = {
    "warpgrasp": ["spec_words", "table_misfit", "parameters", "probe_status", "motion_cost", "core",
                  "geometry", "objects", "hands", "arms", "mechanism", "chain", "finger", "rubbing",
                  "hand_rest", "closing", "chain_closing", "touch", "sight", "export",
                  "hand_capsules", "robot_hand", "robot"],
    "fit": ["fit_status", "option_checks", "rotation", "arrays", "optimize", "prepare",
            "superquadric", "revolution", "implicit", "plane_record", "plane", "polyhedron",
            "match_parameters", "interpretation_tree", "point_sets", "points_csv"],
    "strategies": ["poses", "strategy", "ready_made", "procedures", "contacts", "recovery",
                   "recognition", "foresight", "planners", "reconstruct",
                   "exploration_record", "exploration"],
    "sweeps": ["output", "file_lock", "text_table", "spec", "result_file", "episode", "run",
               "analysis", "compare", "figures", "race", "report", "watch", "gym", "paper",
               "validate", "bench", "cli", "__main__"],
}
"""The rooms and files of each package; one may import those before it, in its package."""
BELOW = {"warpgrasp": set(), "fit": set(), "strategies": {"warpgrasp", "fit"},
         "sweeps": {"warpgrasp", "fit", "strategies"}}
SHARED = {"warpgrasp.core.cache_file", "warpgrasp.core.plain_text"}
"""Modules of `warpgrasp` that `fit` may import too: they know nothing of robots."""
FILES = {path: ".".join(path.relative_to(ROOT).with_suffix("").parts)
         for package in FLOORS for path in sorted((ROOT / package).rglob("*.py"))}
MODULES = {name: path for path, name in FILES.items()}


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def imported(path: Path) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Modules that a file imports, anywhere in it, and the names it takes from each."""
    found: list[tuple[str, tuple[str, ...]]] = []
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found.extend((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; name the package"
            found.append((node.module or "", tuple(alias.name for alias in node.names)))
    return tuple(found)


def ours(path: Path) -> Iterator[str]:
    """Modules of ours that a file imports, as full names of files."""
    for module, names in imported(path):
        if module.split(".")[0] in FLOORS:
            inner = [f"{module}.{name}" for name in names if f"{module}.{name}" in MODULES]
            yield from inner or [module]


def room(module: str) -> str:
    return module.split(".")[1]


@pytest.mark.parametrize("package", FLOORS)
def test_packages_and_rooms_import_downwards(package: str) -> None:
    floor = {name: level for level, name in enumerate(FLOORS[package])}
    for path, name in FILES.items():
        if name.split(".")[0] != package or name == f"{package}.__init__":
            continue
        for other in ours(path):
            if other.split(".")[0] != package:
                assert (other.split(".")[0] in BELOW[package]
                        or (package == "fit" and other in SHARED)), f"{name} imports {other}"
            elif room(other) != room(name):
                assert floor[room(other)] < floor[room(name)], f"{name} imports {other}, above it"


def test_no_files_import_each_other_in_a_circle() -> None:
    graph = {name: set(ours(path)) - {name} for path, name in FILES.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_folders_and_files_are_small() -> None:
    folders = defaultdict(list)
    for path in FILES:
        if path.name not in ("__init__.py", "__main__.py"):
            folders[path.parent].append(path)
            lines = path.read_text().count("\n")
            least = 1 if path.stem in RECORDS else 40
            assert least <= lines <= 400, f"{path}: {lines} lines; wanted are {least} to 400"
    for folder, files in folders.items():
        assert len(files) <= 15, f"{folder}: {len(files)} files"


RECORDS = {"probe_status", "catalogue_names", "strategy", "closing_record", "plane_record",
           "closing_kernels", "chain_closing_kernels"}
"""Files of one small record or list."""


def test_only_known_folders_stand_at_the_top() -> None:
    """What a command wrote into the checkout is no part of it."""
    tracked = subprocess.run(["git", "ls-files", "-z", "*/*"], cwd=ROOT, check=True,
                             capture_output=True, text=True).stdout.split("\0")
    assert {name.split("/")[0] for name in tracked if name} == {
        *FLOORS, "tests", "docs", "examples", ".ci"}


def test_no_name_of_a_file_stands_for_two_things() -> None:
    seen = defaultdict(set)
    for path, name in FILES.items():
        if not path.name.startswith("__"):
            seen[path.stem].add(name.split(".")[0])
    assert {stem: packages for stem, packages in seen.items()
            if len(packages) > 1 and stem != "fit"} == {}


def is_warp(node: ast.AST) -> bool:
    """Whether a definition is one of Warp's: its function, kernel, or struct."""
    return isinstance(node, ast.FunctionDef | ast.ClassDef) and any(
        ast.unparse(d).startswith("wp.") or ast.unparse(d) == "struct"
        for d in node.decorator_list)


def test_kernels_stand_in_files_of_their_own() -> None:
    """So that type checkers read every function that runs on the host."""
    for path in FILES:
        body = tree(path).body
        host = [n.name for n in body if isinstance(n, ast.FunctionDef) and not is_warp(n)]
        device = [n.name for n in body if isinstance(n, ast.FunctionDef) and is_warp(n)]
        assert not (host and device), f"{path}: {host} beside {device}"
        if path.read_text().startswith("# type: ignore"):
            assert not host or path.stem.startswith("peer"), f"{path}: hides {host} from pyright"


def test_facades_name_what_other_rooms_use() -> None:
    """But for what only kernels use, which stands in files `*_kernel`."""
    for path, name in FILES.items():
        for module, names in imported(path):
            if module not in MODULES or module.endswith(("__init__", "_kernel")):
                continue
            facade, _, stem = module.rpartition(".")
            if facade.count(".") == 1 and not name.startswith(f"{facade}."):
                known = getattr(importlib.import_module(facade), "__all__", ())
                missing = [n for n in names if n not in (*known, stem) and not n.startswith("_")]
                assert missing == [], f"{facade}/__init__.py does not name {missing} of {stem}"


def test_facades_give_what_they_name() -> None:
    for path, name in FILES.items():
        if path.name == "__init__.py":
            facade = importlib.import_module(name.removesuffix(".__init__"))
            assert (facade.__doc__ or "").endswith("."), f"{path}: says nothing"
            listed = [name.value for node in ast.walk(tree(path)) if isinstance(node, ast.List)
                      for name in node.elts if isinstance(name, ast.Constant)]
            assert len(listed) == len(set(listed)), f"{path}: names one thing twice"
            for public in getattr(facade, "__all__", ()):
                assert not (path.parent / f"{public}.py").exists(), f"{path}: {public} is a file"
                getattr(facade, public)


def test_every_module_can_be_imported() -> None:
    """Also those that a command imports when it is asked for, with the tables made there."""
    for name in MODULES:
        try:
            importlib.import_module(name.removesuffix(".__init__"))
        except ModuleNotFoundError as error:  # of an extra
            if (error.name or "").partition(".")[0] in FLOORS:
                raise


def test_private_names_are_used() -> None:
    """In their own file or by one that imports them; others are left over."""
    taken = {name for path in FILES for _, names in imported(path) for name in names}
    for path in FILES:
        known = {target.id for node in tree(path).body if isinstance(node, ast.Assign)
                 for target in node.targets if isinstance(target, ast.Name)}
        known |= {node.name for node in tree(path).body
                  if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        words = Counter(re.findall(r"\w+", path.read_text()))
        alone = sorted(n for n in known - taken if re.match("_[^_]", n) and words[n] == 1)
        assert alone == [], f"{path}: nothing uses {alone}"


def test_jaxopt_lives_in_one_file() -> None:
    users = [name for path, name in FILES.items()
             if any(module.split(".")[0] == "jaxopt" for module, _ in imported(path))]
    assert len(users) == 1, users


def test_warmup_compiles_every_file_with_a_kernel() -> None:
    from sweeps.cli.warmup import KERNEL_MODULES

    assert {module_of(path, name) for path, name in FILES.items()
            if "@wp.kernel" in path.read_text()} == set(KERNEL_MODULES)


def module_of(path: Path, name: str) -> str:
    """Warp's module of a file's kernels: the file itself, unless they name another."""
    named = set(re.findall(r'@wp\.kernel\(.*module="([\w.]+)"', path.read_text()))
    assert len(named) <= 1, f"{path}: {named}"
    return named.pop() if named else name


def test_kernels_of_one_module_are_known_together() -> None:
    """Warp compiles a module again when it learns of another kernel of it."""
    for path, name in FILES.items():
        module = module_of(path, name)
        if module != name:
            home = next(p for p, n in FILES.items() if n == module)
            assert name in set(ours(home)), f"{module} does not import {name}"
            taken = {n.name for n in tree(path).body
                     if isinstance(n, ast.FunctionDef) and "wp.kernel" in ast.unparse(n)}
            for other, its in FILES.items():
                names = {n for m, found in imported(other) if m == name for n in found}
                assert its == module or not names & taken, f"{its} takes {names & taken} of {name}"


NAMED = re.compile(rf"`((?:{'|'.join(FLOORS)})(?:\.\w+)+)[`(]")
NO_NAMES = {"warpgrasp.strategies"}
"""In back-ticks too: an entry point group."""


def resolve(name: str) -> None:
    """A module, or what stands in one. Raises AttributeError where there is none."""
    found: Any = importlib.import_module(name.split(".")[0])
    for n, part in enumerate(name.split(".")[1:], 2):
        try:
            found = importlib.import_module(".".join(name.split(".")[:n]))
        except ModuleNotFoundError:
            found = getattr(found, part)


def test_names_in_back_ticks_are_there() -> None:
    """In pages, docstrings and comments; keys of a spec (`fit.taper`) have dots too."""
    from sweeps.spec.cell import SECTIONS
    from sweeps.spec.units import spec_fields

    keys = {f"{section}.{key}" for section, table in SECTIONS.items() for key in spec_fields(table)}
    tests = (ROOT / "tests").rglob("*.py")
    missing = []
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *FILES, *tests):
        for name in sorted({*NAMED.findall(path.read_text())} - keys - NO_NAMES):
            try:
                resolve(name)
            except AttributeError:
                missing.append(f"{path.relative_to(ROOT)}: {name}")
    assert missing == []


def test_what_pages_and_kinds_import_by_name_is_there() -> None:
    """Names that no import statement of the packages shows: in Python blocks of pages, and figures
    of an episode, which are looked up in the facade of their room."""
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        for block in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
            for node in ast.walk(ast.parse(block)):
                if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in FLOORS:
                    for alias in node.names:
                        getattr(importlib.import_module(node.module or ""), alias.name)
    kinds = (ROOT / "sweeps/figures/kinds.py").read_text()
    names = re.findall(r'_of_episode\("(\w+)"\)', kinds)
    assert names
    for name in names:
        getattr(importlib.import_module("sweeps.figures"), name)
