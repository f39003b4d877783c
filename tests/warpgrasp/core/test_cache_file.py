"""Files kept between runs: their content comes back as it was written, or not at all."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from places import PYTHONPATH

from warpgrasp.core import cache_file
from warpgrasp.core.cache_file import (
    cache_home,
    cache_root,
    kernel_root,
    read_cached,
    write_cached,
)
from warpgrasp.core.kernel_cache import check_kernels, has_kernels, seal_kernels


@given(content=st.binary(max_size=200), where=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_any_flipped_bit_is_seen(tmp_path_factory, content: bytes, where: int, bit: int) -> None:
    file = tmp_path_factory.mktemp("cache") / "own" / "program"
    write_cached(file, content)
    assert read_cached(file) == content
    stored = bytearray(file.read_bytes())
    stored[where % len(stored)] ^= 1 << bit
    file.write_bytes(stored)
    assert read_cached(file) is None


def test_the_file_of_another_name_is_not_taken(tmp_path: Path) -> None:
    write_cached(tmp_path / "own" / "one", b"content")
    os.rename(tmp_path / "own" / "one", tmp_path / "own" / "other")
    assert read_cached(tmp_path / "own" / "other") is None
    assert read_cached(tmp_path / "own" / "one") is None


def test_what_others_may_have_written_is_not_read(tmp_path: Path, monkeypatch) -> None:
    file = tmp_path / "own" / "program"
    write_cached(file, b"content")
    file.parent.chmod(0o770)
    assert read_cached(file) is None
    (file.parent / "planted").write_bytes(b"by another")
    write_cached(file, b"anew")  # takes the folder back
    assert [left.name for left in file.parent.iterdir()] == ["program"]
    assert read_cached(file) == b"anew"
    file.chmod(0o666)
    assert read_cached(file) is None
    file.chmod(0o600)
    monkeypatch.setattr(os, "getuid", lambda: os.stat(file).st_uid + 1)
    assert read_cached(file) is None


def test_nothing_is_raised_where_nothing_can_be_written() -> None:
    write_cached(Path("/dev/null/folder/file"), b"content")
    assert read_cached(Path("/dev/null/folder/file")) is None


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of compiled kernels as Warp leaves it."""
    wp.init()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    folder = tmp_path / "wp_room.some_kernel_0123abc"
    folder.mkdir()
    for suffix, content in ((".cpp", b"source"), (".cpu.o", b"code"), (".meta", b"{}")):
        folder.joinpath(folder.name + suffix).write_bytes(content)
    return folder


def test_whole_kernels_stay_and_damaged_ones_go(kernels: Path) -> None:
    check_kernels("room.some_kernel")  # not sealed yet
    seal_kernels("room.some_kernel")
    files = sorted(kernels.iterdir())
    assert len(files) == 5
    check_kernels("room.some_kernel")
    assert sorted(kernels.iterdir()) == files
    code = kernels / f"{kernels.name}.cpu.o"
    code.write_bytes(b"codd")
    check_kernels("room.other_kernel")
    assert kernels.exists()
    check_kernels("room.some_kernel")
    assert not kernels.exists()


def test_kernels_are_had_by_the_whole_name_of_their_module(kernels: Path) -> None:
    assert has_kernels("room.some_kernel")
    assert not has_kernels("room.some")
    assert not has_kernels("some_kernel")


@pytest.mark.slow
def test_warps_own_files_are_sealed_and_a_flip_is_compiled_again(tmp_path: Path) -> None:
    """A damaged compiled kernel is not run: another process gives the same answer."""
    program = ("import numpy as np\n"
               "from warpgrasp.core.random import counter_key, counter_uniform\n"
               "from warpgrasp.geometry.body import distance_to_bodies, scene_of\n"
               "from warpgrasp.objects.catalogue import body_from_name\n"
               "scene = scene_of([body_from_name('block')], 'cpu')\n"
               "points = counter_uniform(counter_key(np.arange(96))).reshape(1, 32, 3)\n"
               "print(distance_to_bodies(scene, np.zeros(1, int), points)[0].tobytes().hex())\n")
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path)}

    def answer() -> str:
        return subprocess.run([sys.executable, "-c", program], env=environment, check=True,
                              capture_output=True, text=True).stdout

    first = answer()
    codes = list(tmp_path.rglob("*.o"))
    assert codes
    assert all(code.with_name(code.name + ".sha256").exists() for code in codes)
    for code in codes:
        content = bytearray(code.read_bytes())
        content[len(content) // 2] ^= 16
        code.write_bytes(content)
    assert answer() == first


@pytest.fixture
def no_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where temporary files are, for a user whose home cannot hold anything."""
    for name in ("XDG_CACHE_HOME", "WARPGRASP_CACHE", "WARP_CACHE_PATH"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/dev/null")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cache_file._among_temporary.cache_clear()
    yield tmp_path
    cache_file._among_temporary.cache_clear()


def test_a_user_without_a_home_has_caches_of_their_own(
        no_home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as of a container: commands ended with a traceback."""
    own = no_home / f"cache-of-user-{os.getuid()}"
    assert cache_home() is None
    assert (cache_root(), kernel_root()) == (own / "warpgrasp", own / "warp")
    assert own.stat().st_mode & 0o777 == 0o700

    def unknown() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", unknown)
    assert cache_home() is None
    assert cache_root() == own / "warpgrasp"
    monkeypatch.setenv("XDG_CACHE_HOME", str(no_home / "given"))
    assert cache_root() == no_home / "given" / "warpgrasp"


def test_a_folder_that_others_may_write_holds_no_caches(no_home: Path) -> None:
    planted = no_home / f"cache-of-user-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    assert planted not in kernel_root().parents
    assert kernel_root().parent.stat().st_mode & 0o777 == 0o700


def test_warp_starts_without_a_home(no_home: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from sweeps.output import init_warp; init_warp(); "
         "import warp; print(warp.config.kernel_cache_dir)"],
        capture_output=True, text=True, check=True, cwd=no_home,
        env={**os.environ, "PYTHONPATH": PYTHONPATH})
    assert Path(done.stdout.strip()).is_relative_to(no_home / f"cache-of-user-{os.getuid()}")
    assert not (no_home / "~").exists()
