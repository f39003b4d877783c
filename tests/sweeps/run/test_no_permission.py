"""A study whose files may not be read or moved: what is said, and which exit code."""

import errno
import fcntl
import os
from pathlib import Path
from typing import Any

import pytest
from studies import fill, plan_of

from sweeps.cli import main as cli
from sweeps.file_lock import TURN
from sweeps.run import store as store_module
from sweeps.run.store import Store, damaged_notes
from sweeps.run.unit_file import read_unit
from sweeps.watch import unit_rows
from sweeps.watch.view import View


@pytest.fixture
def study(tmp_path: Path) -> Store:
    return fill(tmp_path / "s", plan_of(tmp_path / "spec"))


def denied(path: Path) -> PermissionError:
    return PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


def test_a_damaged_file_that_cannot_be_moved_was_not_set_aside(
        study: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    units = list(plan_of(study.folder / "again").units())
    study.path(units[0]).write_bytes(b"cut")

    def read_only(source: Path, target: Path) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(source))

    with monkeypatch.context() as patch:
        patch.setattr(store_module.os, "replace", read_only)
        assert study.read(units[0]) is None
        assert study.read(units[0]) is None
    assert damaged_notes([study]) == [
        f"1 damaged file cannot be moved to {study.logs}, and left out"]
    other = Store(study.folder)
    assert other.read(units[0]) is None
    assert damaged_notes([other]) == [f"1 damaged unit set aside; see {study.logs}; run the sweep "
                                      "again to repeat what is missing"]


@pytest.mark.parametrize("name", ["read_unit", "looks_whole"])
def test_a_file_that_may_not_be_read_is_bad_usage(
        study: Store, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
        name: str) -> None:
    def deny(path: Path, *rest: object) -> Any:
        raise denied(path)

    monkeypatch.setattr(store_module, name, deny)
    words = (["leaderboard", str(study.folder)] if name == "read_unit" else
             ["sweep", str(study.folder.parent / "spec" / "spec.toml"), "-o", str(study.folder)])
    assert cli.run(words) == 2
    assert ".parquet: cannot be read: Permission denied" in capsys.readouterr().err


def test_environment_that_may_not_be_read(study: Store, monkeypatch: pytest.MonkeyPatch,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    real = Path.read_bytes

    def deny(path: Path) -> bytes:
        if path.name == "environment.json":
            raise denied(path)
        return real(path)

    monkeypatch.setattr(Path, "read_bytes", deny)
    assert cli.run(["sweep", str(study.folder.parent / "spec" / "spec.toml"),
                    "-o", str(study.folder)]) == 2
    assert "environment.json: cannot be read: Permission denied" in capsys.readouterr().err


def test_status_and_watch_do_without_a_lock_that_may_not_be_read(
        study: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    (study.folder / ".lock-1-of-1").touch()
    real = Path.open

    def deny(path: Path, *rest: Any, **named: Any) -> Any:
        if path.name.startswith(".lock-"):
            raise denied(path)
        return real(path, *rest, **named)

    monkeypatch.setattr(Path, "open", deny)
    assert study.holders() == {}
    assert study.holders(unknown=True) == {"1-of-1": ""}
    assert View(study.folder, "chamfer_mm").state().done == 1.0
    assert cli.run(["status", str(study.folder)]) == 0


def test_a_file_system_without_flock_is_told(study: Store, monkeypatch: pytest.MonkeyPatch,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    def none(descriptor: Any, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    (study.folder / ".lock-1-of-1").touch()
    monkeypatch.setattr(fcntl, "flock", none)
    spec = study.folder.parent / "spec" / "spec.toml"
    assert cli.run(["sweep", str(spec), "-o", str(study.folder)]) == 2
    assert ".lock-1-of-1: cannot be locked: No locks available; " in capsys.readouterr().err
    assert cli.run(["status", str(study.folder)]) == 0


def test_a_directory_that_another_user_has_begun_can_be_shared(
        study: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    (study.folder / TURN).touch()
    real = os.open

    def others(path: Any, flags: int, *mode: Any, **more: Any) -> int:
        if Path(path).name == TURN and flags & os.O_RDWR:
            raise denied(Path(path))
        return real(path, flags, *mode, **more)

    monkeypatch.setattr(os, "open", others)
    with study.lock((1, 1)):
        assert study.holders().keys() == {"1-of-1"}


def test_watch_counts_units_that_may_not_be_read(study: Store, monkeypatch: pytest.MonkeyPatch
                                                 ) -> None:
    hidden = study.path(next(plan_of(study.folder / "again").units()))

    def deny(path: Path, *rest: Any) -> Any:
        if path == hidden:
            raise denied(path)
        return read_unit(path, *rest)

    view = View(study.folder, "chamfer_mm")
    with monkeypatch.context() as patch:
        patch.setattr(unit_rows, "read_unit", deny)
        assert "1 unit cannot be read: permission denied" in view.state().notes
    view._due = 0.0
    assert view.state().notes == ()


def test_a_path_that_is_too_long_is_bad_usage(study: Store, capsys: pytest.CaptureFixture[str]
                                              ) -> None:
    long = str(study.folder.parent / ("n" * 300))
    assert cli.run(["sweep", str(study.folder.parent / "spec" / "spec.toml"), "-o", long]) == 2
    assert "File name too long" in capsys.readouterr().err
