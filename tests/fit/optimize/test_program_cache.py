"""Programs kept across processes: loaded, not traced; made anew where a file is no good."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fit.optimize import batch, program_cache
from fit.optimize.batch import Program, map_lanes

SETS = np.random.default_rng(4).normal(size=(5, 3, 3))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(program_cache, "_folder", lambda: tmp_path)
    yield tmp_path
    batch._programs.clear()


def factors(name: str = "factors") -> Program:
    """Calls LAPACK, whose addresses a loaded program needs."""
    return Program(name, jax.vmap(lambda a: jnp.linalg.cholesky(a @ a.T + jnp.eye(3))))


def never(name: str = "factors") -> Program:
    """The same program by its name; cannot be traced."""
    def refuse(lanes: object) -> None:
        raise AssertionError("traced")

    return Program(name, refuse)


def test_a_program_is_loaded_and_says_the_same(folder: Path) -> None:
    made = map_lanes(factors(), SETS)
    assert len(list(folder.iterdir())) == 1
    assert np.array_equal(map_lanes(never(), SETS), made)
    text = ("import sys, numpy as np; sys.path.insert(0, sys.argv[1]); "
            "import test_program_cache as t; from pathlib import Path; "
            "t.program_cache._folder = lambda: Path(sys.argv[2]);"
            "print(t.map_lanes(t.never(), t.SETS).tobytes().hex())")
    fresh = subprocess.run([sys.executable, "-c", text, str(Path(__file__).parent), str(folder)],
                           check=True, capture_output=True, text=True)
    assert fresh.stdout.strip() == made.tobytes().hex()


def test_other_names_and_shapes_are_other_programs(folder: Path) -> None:
    map_lanes(factors(), SETS)
    with pytest.raises(AssertionError, match="traced"):
        map_lanes(never("others"), SETS)
    with pytest.raises(AssertionError, match="traced"):
        map_lanes(never(), SETS[:, :2, :2])


@pytest.mark.parametrize("content", [b"", b"nonsense", None])
def test_a_damaged_file_is_made_anew(folder: Path, content: bytes | None) -> None:
    made = map_lanes(factors(), SETS)
    file, = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if content is None else content)
    batch._programs.clear()
    assert np.array_equal(map_lanes(factors(), SETS), made)
    batch._programs.clear()
    assert np.array_equal(map_lanes(never(), SETS), made)


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX paths")
def test_where_nothing_can_be_written_only_time_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program_cache, "_folder", lambda: Path("/dev/null/programs"))
    assert map_lanes(factors(), SETS).shape == (5, 3, 3)


def test_the_program_used_longest_ago_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    # A study over fit options needs many; a process has only so many memory mappings.
    monkeypatch.setattr(batch, "MAX_PROGRAMS", 2)
    batch._programs.clear()
    first, second, third = (factors(name) for name in ("first", "second", "third"))
    found = [map_lanes(program, SETS) for program in (first, second, first, third, second)]
    assert [key[0] for key in batch._programs] == [third, second]
    for answer in found[1:]:
        np.testing.assert_array_equal(answer, found[0])


def test_a_program_of_other_options_is_not_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_cache, "xla_flags_active", lambda: False)
    map_lanes(factors("by other options"), SETS)
    assert not list(folder.iterdir())


def test_fits_stay_on_the_cpu_where_jax_prefers_another_device(folder: Path) -> None:
    """As a GPU is; here a second CPU device stands for it, and is JAX's default."""
    made = map_lanes(factors(), SETS)
    text = ("import sys, jax; sys.path.insert(0, sys.argv[1]);"
            "import test_program_cache as t; from pathlib import Path; kept = Path(sys.argv[2]);"
            "jax.config.update('jax_default_device', jax.devices()[1]);"
            "t.program_cache._folder = lambda: kept; run = t.batch._run; where = set();"
            "seen = lambda out: [where.update(leaf.devices()) for leaf in jax.tree.leaves(out)];"
            "t.batch._run = lambda *given: (out := run(*given), seen(out))[0];"
            "print(t.map_lanes(t.factors('again'), t.SETS).tobytes().hex());"
            "t.batch._programs.clear();"
            "print(t.map_lanes(t.never('again'), t.SETS).tobytes().hex(), {d.id for d in where})")
    fresh = subprocess.run(
        [sys.executable, "-c", text, str(Path(__file__).parent), str(folder)], check=True,
        capture_output=True, text=True,
        env={**os.environ, "XLA_FLAGS": "--xla_force_host_platform_device_count=2"})
    assert fresh.stdout.split() == [made.tobytes().hex()] * 2 + ["{0}"]
