"""What a study keeps of the machine that its units were made on."""

from pathlib import Path

import pytest
from studies import fill, plan_of

from fit.optimize.xla_flags import ONE_THREAD, OPTIONS


@pytest.mark.parametrize(("name", "own"), [
    ("XLA_FLAGS", f"{OPTIONS} {ONE_THREAD} "), ("OPENBLAS_CORETYPE", "")])
def test_a_variable_that_changes_bits_is_told(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, own: str) -> None:
    """What this package sets itself is the same everywhere."""
    monkeypatch.setenv(name, own.strip())
    store = fill(tmp_path, plan_of(tmp_path))
    assert store.environment_notes("cpu") == []
    monkeypatch.setenv(name, f"{own}other")
    note, = store.environment_notes("cpu")
    assert note.endswith(f"bits may differ: {name}: None -> other")
