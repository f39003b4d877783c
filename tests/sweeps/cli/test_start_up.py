"""What commands do not import: it is most of the time that they take to start."""

import gc
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from places import PYTHONPATH
from studies import write_spec

from strategies.ready_made import STRATEGIES
from sweeps.cli import main as cli
from sweeps.cli import warmup
from sweeps.cli.warmup import kernels_explored


def modules_after(code: str, *arguments: str) -> set[str]:
    """Names of all modules that a fresh Python has imported once `code` has run."""
    tail = "; print('\\n'.join(sys.modules), file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; {code}{tail}", *arguments], check=True,
        capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": PYTHONPATH})
    return set(done.stderr.splitlines())


def test_explore_starts_without_what_only_compiling_needs() -> None:
    """jaxopt is for tracing programs, which are kept; none of its solvers is needed to run them."""
    found = modules_after("import sweeps.cli.explore, sweeps.spec.objects, "
                          "sweeps.report.episode_files")
    assert {"jax", "warp"} <= found
    assert not found & {"jaxopt", "scipy.optimize", "scipy.stats", "trimesh", "pandas", "pyarrow",
                        "pydantic"}


@pytest.mark.slow
def test_a_whole_explore_imports_neither_what_draws_nor_kernels_that_it_does_not_launch(
        tmp_path: Path) -> None:
    """An episode of the default strategy on a block; another process draws its figures."""
    found = modules_after("from sweeps.cli.main import run; run(sys.argv[1:])",
                          "explore", "block", "-o", str(tmp_path))
    assert (tmp_path / "contacts.png").exists()
    assert (tmp_path / "surfaces.png").exists()
    assert not found & {"matplotlib", "pydantic", "scipy.sparse.csgraph", "multiprocessing",
                        "fit.implicit.process",
                        "strategies.contacts.chain_placing_kernel",
                        "strategies.foresight.foresight_kernel"}
    assert not {name for name in found if name.startswith(("warpgrasp.chain_closing.",
                                                           "warpgrasp.touch.pad_kernel",
                                                           "warpgrasp.sight."))}


def test_what_draws_an_episode_imports_no_simulator() -> None:
    found = modules_after("import importlib; from sweeps.report.picture_process import IMPORTED; "
                          "[importlib.import_module(name) for name in IMPORTED]")
    assert "matplotlib" in found
    assert not found & {"jax", "warp", "pydantic", "scipy.spatial"}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "hand", "arm"), [
    *((name, "utah_mit", "puma560") for name in STRATEGIES),
    ("planar", "allegro", "none"), ("any-object", "leap", "puma560"),
    ("coverage", "utah_mit", "ur5e"), ("planar", "barrett", "panda")])
def test_explore_compiles_at_once_what_its_strategy_launches(
        name: str, hand: str, arm: str) -> None:
    """In a process of its own, since this one has launched the kernels of other tests. Fingers meet
    about a bowl, not about a block."""
    code = ("import sys, numpy as np; from strategies.ready_made import STRATEGIES; "
            "from sweeps.episode.episodes import run_block; from sweeps.spec.cell import Cell; "
            "from warpgrasp.objects.families import family_table; "
            "from warpgrasp.parameters import ArmTable, HandTable; name, hand, arm = sys.argv[1:]; "
            "robot = {'hand': HandTable(kind=hand), 'arm': ArmTable(kind=arm)}; "
            "[run_block(Cell(STRATEGIES[name], table, 'it', **robot), np.arange(1), 'cpu') "
            "for table in ({'name': 'block'}, {'name': 'funnel'}, family_table('bowl-1'))]; "
            "from warpgrasp.core import kernel_launch; print(*kernel_launch._launched)")
    done = subprocess.run(
        [sys.executable, "-c", code, name, hand, arm], check=True, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": PYTHONPATH})
    assert set(kernels_explored(STRATEGIES[name], hand, arm)) == set(done.stdout.split())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "of", "word"), [
    ("ring6", "block", "superquadric"), ("any-object", "block", "chosen"),
    ("contour-first", "beer_bottle", "superquadric"), ("contour", "block", "superquadric"),
    ("coarse-to-fine", "block", "superquadric")])
def test_explore_compiles_at_once_the_programs_of_its_fits(
        tmp_path: Path, name: str, of: str, word: str) -> None:
    code = ("import sys, numpy as np; from pathlib import Path; name, of, word = sys.argv[1:]; "
            "from strategies.ready_made import STRATEGIES; from sweeps.cli.warmup import "
            "fit_explored; from fit.optimize.program_cache import _folder; "
            "kept = lambda: {file.name for file in _folder().glob('*.xla')}; "
            "from sweeps.episode.episodes import run_block; from sweeps.spec.cell import Cell; "
            "from warpgrasp.parameters import FitTable; "
            "fit_explored(STRATEGIES[name], word == 'chosen'); ahead = kept(); "
            "run_block(Cell(STRATEGIES[name], {'name': of}, of, fit=FitTable(reconstruct=word)), "
            "np.arange(1), 'cpu'); print(len(ahead), len(kept() - ahead))")
    done = subprocess.run(
        [sys.executable, "-c", code, name, of, word], check=True, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": PYTHONPATH, "XDG_CACHE_HOME": str(tmp_path),
             "WARPGRASP_CACHE": str(tmp_path)})
    ahead, later = map(int, done.stdout.split())
    assert ahead > 0
    # A free form's values are a program for its number of touches, which takes 0.2 s.
    assert later <= (word == "chosen")


def test_kernels_that_are_kept_are_not_loaded_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their first launch loads them, after it has checked them."""
    loaded: list[str] = []
    monkeypatch.setattr(warmup, "_load", lambda names, device: loaded.extend(names))
    monkeypatch.setattr(warmup, "fit_explored", lambda strategy, bends: None)
    strategy = STRATEGIES["even"]
    every = kernels_explored(strategy)
    monkeypatch.setattr("warpgrasp.core.kernel_cache.has_kernels", lambda name: name != every[1])
    warmup.compile_explored(strategy, "cpu", bends=False)
    assert loaded == [every[1]]
    # What is kept may be the CPU's.
    monkeypatch.setattr("warp.get_device", lambda name: SimpleNamespace(is_cpu=name == "cpu"))
    warmup.compile_explored(strategy, "cuda:0", bends=False)
    assert loaded[1:] == every


def test_the_parent_of_a_sweep_simulates_nothing(tmp_path: Path) -> None:
    found = modules_after(
        "from sweeps.cli import main as cli; from sweeps.run import worker; "
        "worker.EPISODES = 'fake_episodes:run_episodes'; "
        "cli.run(sys.argv[1:])", "sweep", str(write_spec(tmp_path)), "-o", str(tmp_path / "out"))
    assert "sweeps.analysis.leaderboard" in found
    assert (tmp_path / "out" / "leaderboard.csv").exists()
    assert not found & {"jax", "warp", "scipy.stats", "scipy.optimize", "matplotlib"}


def test_what_workers_import_of_the_command_is_nothing() -> None:
    """A process that is spawned imports the script that its parent was started by."""
    assert not modules_after("import sweeps.__main__") & {"cyclopts", "numpy", "sweeps.cli.main"}


def test_a_command_ends_without_a_search_for_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python searches all that was imported before it ends: 0.7 s of `explore`."""
    monkeypatch.setattr(cli, "run", lambda arguments: 3)
    threshold = gc.get_threshold()
    try:
        with pytest.raises(SystemExit) as end:
            cli.main([])
        assert end.value.code == 3
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()
        gc.set_threshold(*threshold)
