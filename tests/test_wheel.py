"""The wheel holds what the checkout holds, and runs by itself."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from places import ROOT

PACKAGES = ("warpgrasp", "fit", "strategies", "sweeps")


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder],
                   cwd=ROOT, check=True, capture_output=True)
    wheel, = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_every_tracked_file_of_the_packages_is_in_it(unpacked: Path) -> None:
    tracked = subprocess.run(["git", "ls-files", *PACKAGES], cwd=ROOT, check=True,
                             capture_output=True, text=True).stdout.split()
    assert tracked
    assert [name for name in tracked if not (unpacked / name).is_file()] == []


def test_it_runs_without_the_checkout(unpacked: Path) -> None:
    code = ("import sys, warpgrasp, sweeps.cli.main as cli; print(warpgrasp.__file__); "
            "warpgrasp.body_from_name('wine_bottle'); sys.exit(cli.run(['objects', '--json']))")
    done = subprocess.run([sys.executable, "-c", code], cwd=unpacked.parent, capture_output=True,
                          text=True, check=True, env={**os.environ, "PYTHONPATH": str(unpacked)})
    assert done.stdout.startswith(str(unpacked))
    assert '"wine_bottle"' in done.stdout
