"""Docs: built without a warning, and everything that they ask a reader to type does run.

What takes long is left to the slow test, which is `make docs-commands`: every command and block in
a copy of the tree. Here each is parsed, and the light ones run on a stand-in of the simulator.
"""

import ast
import importlib.util
import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import run_docs
from doc_blocks import ROOT, Block, blocks, commands, pages

from strategies.poses.closing_paths import CLOSING_PATHS
from strategies.poses.waypoints import WAYPOINT_KINDS
from strategies.recovery.belief import Belief
from sweeps.analysis.entries import METRICS
from sweeps.report.episode_files import OTHERS
from sweeps.spec.cell import SECTIONS
from sweeps.spec.reader import HEAD
from sweeps.spec.units import spec_fields
from warpgrasp.geometry.scene import Join
from warpgrasp.objects.catalogue import _COMPOUND_KEYS
from warpgrasp.parameters import FitTable

LIGHT = {"objects", "hands", "hand", "strategies", "init", "check", "sweep", "status",
         "leaderboard", "table", "rows", "compare", "figure", "export", "completion"}
NUMBER = re.compile(r"-?\d+\.\d*")
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
           "eleven", "twelve", "thirteen")
PROGRAMS = [block for block in commands() if "warpgrasp " in block.text
            and not run_docs.excuse(block)]


def words_of(block: Block) -> list[str]:
    """The words after `warpgrasp`, placeholders and variables filled in."""
    command = run_docs.shrunk(block.text).partition("warpgrasp ")[2]
    return shlex.split(re.sub(r"\$\{?\w+\}?", "1", command))


def test_every_page_is_in_the_menu() -> None:
    written = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")
               if "api" not in page.parts}
    assert written - {"index.md"} == {str(page.relative_to(ROOT / "docs")) for page in pages()[1:]}


def test_every_kind_of_table_and_figure_is_told() -> None:
    from sweeps.analysis import tables
    from sweeps.figures import kinds as figures

    text = (ROOT / "docs/leaderboard.md").read_text()
    assert [kind for kind in (*tables.KINDS, *figures.KINDS) if f"`{kind}`" not in text] == []
    readme, changes = ((ROOT / name).read_text() for name in ("README.md", "CHANGELOG.md"))
    assert f"and {NUMBERS[len(figures.KINDS) - 1]} kinds more" in readme
    assert (f"`table` with {NUMBERS[len(tables.KINDS)]} kinds, `figure` with "
            f"{NUMBERS[len(figures.KINDS)]}") in changes


@pytest.mark.parametrize(("page", "names"), [
    ("strategies", lambda: [*CLOSING_PATHS, *WAYPOINT_KINDS, *(
        key for table in WAYPOINT_KINDS.values() for key in spec_fields(table)),
        *spec_fields(FitTable), *(field.name for field in fields(Belief))]),
    ("studies", lambda: [*HEAD, *(f"[{section}]" for section in SECTIONS)]),
    ("leaderboard", lambda: METRICS), ("first_hour", lambda: OTHERS),
    ("objects", lambda: [*_COMPOUND_KEYS, *(join.name.lower() for join in Join)])])
def test_what_users_write_and_read_is_told(page: str, names: Callable[[], list[str]]) -> None:
    text = (ROOT / f"docs/{page}.md").read_text()
    assert [name for name in names() if f"`{name}" not in text] == []


def test_there_are_commands_and_blocks_to_check() -> None:
    kinds = [block.kind for block in blocks()]
    assert len(PROGRAMS) > 40
    assert kinds.count("python") >= 6
    assert kinds.count("toml") >= 4


@pytest.mark.parametrize("block", PROGRAMS, ids=lambda block: f"{block.place} {block.text}")
def test_commands_are_ones_there_are(block: Block) -> None:
    """Names, options and kinds are right."""
    from sweeps.analysis import tables
    from sweeps.cli import main as cli
    from sweeps.cli.app import folders_and_kind
    from sweeps.figures import kinds as figures

    if run_docs.is_name(block) or "pip install" in block.text:
        return
    words = [word for word in words_of(block) if word not in ("--quiet", "--help")]
    function, bound, _ = cli.app.parse_args(words, exit_on_error=False, print_error=False)
    kinds = {"table": tables.KINDS, "figure": figures.KINDS}.get(function.__name__)
    if kinds:
        folders_and_kind(bound.args[0] if bound.args else bound.arguments["words"], kinds)


def test_what_is_not_run_is_there_and_nothing_else_is_excused() -> None:
    """Every excuse and every way to make a command small belongs to a command of the docs."""
    texts = [block.text for block in blocks() if block.kind == "shell"]
    for pattern in run_docs.EXCUSED:
        assert any(re.fullmatch(pattern, text) for text in texts), pattern
    for pattern, _ in run_docs.SHRINKS:
        assert any(re.fullmatch(pattern, text) for text in texts), pattern
    excused = {block.text for block in blocks() if run_docs.excuse(block)}
    assert excused == {
        "make test", "make check", "make models", "make validate", "make studies-docs",
        "sweeps/bench/gpu.sh",
        ".venv/bin/pip install '.[ray]'", "pytest tests/sweeps/run/test_ray_engine.py",
        "sbatch array.sh", "examples/newcomer.sh",
        "warpgrasp sweep study.toml -o DIR --engine ray --address auto"}
    names = {block.text for block in blocks() if block.kind == "shell" and run_docs.is_name(block)}
    assert names == {f"warpgrasp {name}" for name in ("check", "fit", "init", "paper",
                                                      "sensitivity")}


@pytest.mark.slow
def test_light_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                            capfd: pytest.CaptureFixture[str]) -> None:
    """Those that need no simulator, in order, as a reader would; sweeps run a stand-in."""
    sys.path.insert(0, str(ROOT / "tests/sweeps"))
    from sweeps.cli import main as cli
    from sweeps.run import worker

    monkeypatch.setattr(worker, "EPISODES", "curved_episodes:run_episodes")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WARPGRASP_QUIET", "1")
    for folder in ("sweeps/studies", "examples"):
        (tmp_path / folder).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / folder).symlink_to(ROOT / folder)
    run_docs.prepare(tmp_path)
    assert cli.run(["sweep", "sweeps/studies/demo.toml", "-o", "runs/demo",
                    "--set", "episodes_per_cell=4"]) == 0
    ran = 0
    for number, block in enumerate(blocks()):
        if block.kind == "toml":
            spec = tmp_path / f"block-{number}.toml"
            spec.write_text(run_docs.whole_spec(block.text))
            words = ["check", str(spec)]
        elif block in PROGRAMS and not run_docs.is_name(block) and words_of(block)[0] in LIGHT:
            words = [word for word in words_of(block) if word != "--workers"]
            words = [word for n, word in enumerate(words) if not (n and word == "2")]
        elif block.text == "cp -r examples/mine .":
            run_docs.run_step(block, block.text, tmp_path, "")
            continue
        else:
            continue
        # What SLURM's tasks wrote; an episode run again.
        if "study-" in block.text or {"grasp", "contacts"} & set(words):
            continue
        assert cli.run(words) == 0, (block.place, words, capfd.readouterr().err)
        ran += 1
    assert ran > 25


@pytest.mark.slow
def test_everything_runs() -> None:
    done = subprocess.run([sys.executable, str(ROOT / "tests/scripts/run_docs.py")], text=True,
                          stdout=subprocess.PIPE, env={**os.environ, "WARPGRASP_QUIET": ""})
    assert done.returncode == 0, done.stdout


def test_the_newcomer_needs_no_step_that_readme_and_first_hour_do_not_have() -> None:
    script = (ROOT / "examples/newcomer.sh").read_text()
    steps = re.findall(r"^step (.*)$", script, re.MULTILINE)
    asked = [block.text for block in blocks()
             if block.page in ("README.md", "docs/first_hour.md", "first_hour.md")]
    assert len(steps) >= 7
    assert [step for step in steps if step not in asked] == []


def build_site(folder: Path, builder: str) -> None:
    """The site of the docs, without a warning."""
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", builder,
         "-d", str(folder / "trees"), str(ROOT / "docs"), str(folder / "site")],
        capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.fixture(scope="module")
def api(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages of the API reference, as the site writes them before it reads all pages. No HTML
    is written, which takes most of the time."""
    pytest.importorskip("sphinx")
    build_site(tmp_path_factory.mktemp("site"), "dummy")
    return ROOT / "docs" / "api"


def test_pages_are_read_without_a_warning(api: Path) -> None:
    """What they refer to is there."""
    assert (api / "index.md").exists()


@pytest.mark.slow
def test_the_site_is_built_and_every_link_leads_somewhere(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    build_site(tmp_path, "html")
    assert "fit_superquadric(" in re.sub(
        "<.*?>", "", (tmp_path / "site" / "api" / "fit.html").read_text())
    site = tmp_path / "site"
    assert (site / ".nojekyll").exists()
    for page in site.rglob("*.html"):
        for target in re.findall(r'(?:href|src)="([^"#?]+)', page.read_text()):
            if not re.match(r"[a-z]+:", target):  # whole in one folder
                assert (page.parent / target).exists(), f"{page}: {target}"


def test_readme_links_lead_somewhere() -> None:
    text = (ROOT / "README.md").read_text()
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)
    pictures = re.findall(r'src="([^"]+)"', text)
    assert len(pictures) >= 1
    for target in targets + pictures:
        assert (ROOT / target).exists(), target
    assert all((ROOT / picture).stat().st_size < 200_000 for picture in pictures)


@pytest.mark.slow
def test_a_batch_of_probes_in_ten_lines() -> None:
    text = (ROOT / "docs" / "python.md").read_text()
    source = text.split("```python\n")[1].split("```")[0]
    found: dict[str, object] = {}
    exec(compile(source, "docs/python.md", "exec"), found)
    assert found["fits"].size_m.shape == (8, 3)  # type: ignore[attr-defined]


def test_the_notebook_imports_what_there_is() -> None:
    """All of its code is Python, too."""
    pytest.importorskip("nbclient")
    notebook = runpy.run_path(str(ROOT / "docs" / "notebook.py"))["read"]()
    nodes = [node for cell in notebook.cells if cell.cell_type == "code"
             for node in ast.walk(ast.parse(cell.source)) if isinstance(node, ast.ImportFrom)]
    assert len(nodes) >= 3
    for node in nodes:
        module = importlib.import_module(node.module or "")
        for alias in node.names:
            getattr(module, alias.name)


@pytest.mark.slow
def test_the_notebook_runs() -> None:
    """With as many outputs as are kept."""
    pytest.importorskip("nbclient")
    notebook = runpy.run_path(str(ROOT / "docs" / "notebook.py"))
    assert len(notebook["texts"](notebook["run"]())) == len(notebook["texts"](notebook["read"]()))


@pytest.mark.slow
def test_the_notebook_says_what_it_is_kept_with() -> None:
    """Outputs are kept; text is what running it gives (`make notebook`), but for last digits, which
    another processor rounds otherwise."""
    pytest.importorskip("nbclient")
    notebook = runpy.run_path(str(ROOT / "docs" / "notebook.py"))
    kept = notebook["read"]()
    pictures = [output for cell in kept.cells for output in cell.get("outputs", ())
                if "image/png" in output.get("data", {})]
    assert len(pictures) >= 2
    assert str(ROOT) not in (ROOT / "examples" / "story.ipynb").read_text()
    now, then = ("".join("\n".join(notebook["texts"](n)).split())
                 for n in (notebook["run"](), kept))
    assert NUMBER.sub("0", now) == NUMBER.sub("0", then)
    assert np.allclose(*(list(map(float, NUMBER.findall(text))) for text in (now, then)),
                       rtol=0.05, atol=0.02)


def test_things_live_where_the_page_says() -> None:
    text = (ROOT / "docs/where_things_live.md").read_text()
    rows = re.findall(r"^\| .*\? \| `(.*?)` \| `(.*?)` \|$", text, re.MULTILINE)
    assert len(rows) == 10
    for file, name in rows:
        assert re.search(rf"^(def|class) {name}\b", (ROOT / file).read_text(), re.MULTILINE), file


def test_the_api_reference_names_what_every_facade_does(api: Path) -> None:
    """With a docstring; a room's names stand in its facade, `__init__.py`."""
    spec = importlib.util.spec_from_file_location("conf", ROOT / "docs/conf.py")
    assert spec is not None
    assert spec.loader is not None
    conf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conf)
    for facade in [file for package in conf.PACKAGES
                   for file in sorted((ROOT / package).rglob("__init__.py"))]:
        page = (api / f"{facade.relative_to(ROOT).parts[0]}.md").read_text()
        written = set(re.findall(r"\w+", " ".join(re.findall(r"```python\n([^`]*)", page))))
        for module, names in conf.public_names(facade).items():
            for name in names:
                assert name in written, f"{module}: {name}"
