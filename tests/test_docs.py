"""Docs: built without a warning, commands that parse, Python that runs, the notebook too."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMAND = re.compile(r"^(?:    |\$ )?(?:\.venv/bin/)?warpgrasp ([a-z].*?)(?:  +#.*)?$",
                     re.MULTILINE)


def commands() -> list[tuple[str, str]]:
    """Every command of a page that stands on a line of its own, with the page's name."""
    found = []
    for page in PAGES:
        text = page.read_text().replace("\\\n", " ")
        found += [(page.name, command.partition("  #")[0].strip())
                  for command in COMMAND.findall(text)]
    return found


def test_there_are_commands_to_check() -> None:
    assert len(commands()) > 15


@pytest.mark.parametrize(("page", "command"), commands())
def test_commands_are_ones_there_are(page: str, command: str) -> None:
    """Names, options and kinds are right; what they do is tested beside each command."""
    from sweeps import cli, figures, tables
    from sweeps.cli_arguments import folders_and_kind

    words = shlex.split(re.sub(r"\$\{?\w+\}?", "1", command.replace("...", "")))
    function, bound, _ = cli.app.parse_args(
        [word for word in words if word != "--quiet"], exit_on_error=False, print_error=False)
    kinds = {"table": tables.KINDS, "figure": figures.KINDS}.get(function.__name__)
    if kinds:
        folders_and_kind(bound.args[0] if bound.args else bound.arguments["words"], kinds)


def test_the_site_is_built_and_every_link_leads_somewhere(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html",
         "-d", str(tmp_path / "trees"), str(ROOT / "docs"), str(tmp_path / "site")],
        capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "fit_superquadric(" in re.sub(
        "<.*?>", "", (tmp_path / "site" / "api" / "fit.html").read_text())


def test_readme_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", (ROOT / "README.md").read_text()):
        assert (ROOT / target).exists(), target


def test_a_batch_of_probes_in_ten_lines() -> None:
    text = (ROOT / "docs" / "python.md").read_text()
    source = text.split("```python\n")[1].split("```")[0]
    found: dict[str, object] = {}
    exec(compile(source, "docs/python.md", "exec"), found)
    assert found["fits"].size_m.shape == (8, 3)  # type: ignore[attr-defined]


def test_the_notebook_runs() -> None:
    nbclient = pytest.importorskip("nbclient")
    import nbformat

    notebook = nbformat.read(ROOT / "examples" / "story.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)  # kept without outputs
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3",
                            resources={"metadata": {"path": str(ROOT)}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in shown)
