"""Runs of tests throw no compiled kernels and programs away but their own."""

from pathlib import Path

import pytest

from sweeps.run import local_engine
from warpgrasp.core import drop_cached


@pytest.fixture(autouse=True)
def dropped_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The packages whose kernels a run would have dropped, as it does once workers crash twice.

    Tests that crash them would have all other tests, and the user's next run, compile again.
    """
    packages: list[str] = []

    def drop(folder: Path) -> None:
        if tmp_path in folder.parents:
            drop_cached(folder)

    monkeypatch.setattr(local_engine, "drop_cached", drop)
    monkeypatch.setattr("warpgrasp.core.kernel_cache.drop_kernels",
                        lambda *names: packages.extend(names))
    return packages
