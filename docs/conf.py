"""Sphinx: Markdown pages, and an API reference read from the source without importing it."""

import ast
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("warpgrasp", "fit", "strategies", "sweeps")

project = "warpgrasp"
author = "The warpgrasp developers"
extensions = ["myst_parser", "sphinx.ext.githubpages"]  # the latter lets hosts serve _static
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
html_theme = "alabaster"
html_theme_options = {"page_width": "76rem", "sidebar_width": "15rem"}
html_sidebars = {"**": ["navigation.html", "searchbox.html"]}
html_show_copyright = html_show_sphinx = False
html_last_updated_fmt = None
myst_heading_anchors = 4
# A page that the menu names and that is not there yet is left out; links within pages are checked.
suppress_warnings = ["toc.not_included", "toc.not_readable", "myst.header",
                     "misc.highlighting_failure"]


def setup(app) -> None:
    """Writes the API pages before the sources are read."""
    app.connect("builder-inited", lambda _: write_api(Path(__file__).parent / "api"))


def write_api(folder: Path) -> None:
    """A page a package, by rooms: every public function, class and constant with its docstring."""
    folder.mkdir(exist_ok=True)
    (folder / "parameters.md").write_text("\n".join(_parameters()))
    names = "\n".join(PACKAGES)
    (folder / "index.md").write_text(
        "# API reference\n\nFrom the docstrings: shapes, units, errors raised, sources.\n\n"
        f"```{{toctree}}\n:maxdepth: 2\n\n{names}\n```\n")
    for package in PACKAGES:
        parts = [f"# {package}\n"]
        for facade in sorted((ROOT / package).rglob("__init__.py")):
            parts += _room(facade)
        (folder / f"{package}.md").write_text("\n".join(parts))


def _room(facade: Path) -> Iterator[str]:
    """A room: what its `__init__` says and names, then its files."""
    room = ".".join(facade.parent.relative_to(ROOT).parts)
    named = public_names(facade)
    yield f"## {room}\n\n{ast.get_docstring(ast.parse(facade.read_text()))}\n"
    if named:
        yield f"`from {room} import ...`: " + ", ".join(
            f"`{name}`" for names in named.values() for name in names) + ".\n"
    for file in sorted(facade.parent.glob("*.py")):
        tree = ast.parse(file.read_text())
        entries = list(_entries(tree, named.get(file.stem, ())))
        if entries and file.name != "__init__.py":
            yield f"### {room}.{file.stem}\n"
            yield _text(ast.get_docstring(tree) or "")
            yield from entries


def public_names(facade: Path) -> dict[str, list[str]]:
    """The names that an `__init__` attaches, by the file they are defined in."""
    for node in ast.walk(ast.parse(facade.read_text())):
        if isinstance(node, ast.keyword) and node.arg == "submod_attrs":
            return ast.literal_eval(node.value)
    return {}


def _parameters() -> Iterator[str]:
    """Every number of the model as a spec writes it, from the tables that the simulator uses."""
    sys.path.insert(0, str(ROOT))
    from sweeps.spec.cell import SECTIONS
    from sweeps.spec.units import spec_fields

    yield ("# Every number of the model\n\nAs a spec sets and sweeps them (`[hand]`, then "
           "`link_radius_mm = 9`), with the default, the source and what is estimated: [paper] "
           "Allen and Michelman 1990, [ref] read in the source named, [est] an estimate. "
           "`warpgrasp init` writes the same.\n")
    for section, table in SECTIONS.items():
        yield f"## {section}\n\n{_line(table.__doc__)}\n"
        yield "| key | default | meaning and source |\n|---|---|---|"
        for field in spec_fields(table).values():
            choices = f" (one of {', '.join(field.choices)})" if field.choices else ""
            yield f"| `{field.key}` | {field.spec_default} | {_line(field.doc)}{choices} |"
        yield ""


def _line(text: str | None) -> str:
    return " ".join((text or "").split()).replace("|", "\\|")


def _entries(tree: ast.Module, constants: Collection[str]) -> Iterator[str]:
    """Public functions and classes, and those of the `constants` that are assigned here."""
    body = [inner for node in tree.body
            for inner in (node.body if isinstance(node, ast.If) else [node])]
    for node, after in zip(body, [*body[1:], ast.Pass()], strict=True):
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            gives = f" -> {ast.unparse(node.returns)}" if node.returns else ""
            sign, doc = f"{node.name}({ast.unparse(node.args)}){gives}", ast.get_docstring(node)
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            fields = [f"    {item.target.id}: {ast.unparse(item.annotation)}" for item in node.body
                      if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)]
            sign, doc = "\n".join([f"class {node.name}", *fields]), ast.get_docstring(node)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and any(
                isinstance(part, ast.Name) and part.id in constants
                for target in getattr(node, "targets", [getattr(node, "target", None)])
                for part in ast.walk(target)):
            sign, doc = ast.unparse(node)[:400], None
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                doc = str(after.value.value)
        else:
            continue
        yield f"```python\n{sign}\n```\n"
        yield _text(doc or "")


def _text(docstring: str) -> str:
    """A docstring as it stands: it is prose with a few indented lines, not markup."""
    return f"```text\n{docstring}\n```\n" if docstring else ""
