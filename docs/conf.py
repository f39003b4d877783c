"""Sphinx: Markdown pages, and an API reference read from the source without importing it."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("warpgrasp", "fit", "strategies", "sweeps")

project = "warpgrasp"
author = "The warpgrasp developers"
extensions = ["myst_parser"]
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
    """A page a package: every public function and class with its signature and docstring."""
    folder.mkdir(exist_ok=True)
    (folder / "parameters.md").write_text("\n".join(_parameters()))
    names = "\n".join(PACKAGES)
    (folder / "index.md").write_text(
        "# API reference\n\nFrom the docstrings: shapes, units, errors raised, sources.\n\n"
        f"```{{toctree}}\n:maxdepth: 2\n\n{names}\n```\n")
    for package in PACKAGES:
        parts = [f"# {package}\n"]
        for file in sorted((ROOT / package).rglob("*.py")):
            tree = ast.parse(file.read_text())
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            entries = list(_entries(tree))
            if entries and file.name != "__init__.py":
                parts += [f"## {module}\n", _text(ast.get_docstring(tree) or ""), *entries]
        (folder / f"{package}.md").write_text("\n".join(parts))


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


def _entries(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
            continue
        if isinstance(node, ast.FunctionDef):
            gives = f" -> {ast.unparse(node.returns)}" if node.returns else ""
            sign = f"{node.name}({ast.unparse(node.args)}){gives}"
        else:
            fields = [f"    {item.target.id}: {ast.unparse(item.annotation)}" for item in node.body
                      if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)]
            sign = "\n".join([f"class {node.name}", *fields])
        yield f"```python\n{sign}\n```\n"
        yield _text(ast.get_docstring(node) or "")


def _text(docstring: str) -> str:
    """A docstring as it stands: it is prose with a few indented lines, not markup."""
    return f"```text\n{docstring}\n```\n" if docstring else ""
