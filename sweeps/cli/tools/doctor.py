"""`warpgrasp doctor`: what is installed, where it keeps things, and whether it computes."""

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from sweeps.output import devices, quiet_stdout
from sweeps.run.environment import PACKAGES, describe_environment
from sweeps.text_table import print_table
from warpgrasp.core.cache_file import cache_root, kernel_root
from warpgrasp.core.cores import core_count

OPTIONAL = ("ray", "viser", "yourdfpy", "gymnasium", "optuna", "mujoco", "pandas")
Row = tuple[str, str, str]  # what, value, "ok" or what to do


def doctor(*, as_json: bool, test: bool) -> int:
    """Prints a line each; 1 where something is wrong."""
    rows = [*_versions(), *_places()]
    with quiet_stdout():
        rows += list(_devices())
        if test:
            rows += list(_self_test())
    print_table(("what", "value", "verdict"), rows, as_json, words=("value",))
    return 0 if all(row[2] in ("ok", "") for row in rows) else 1


def _versions() -> Iterator[Row]:
    found = describe_environment("cpu")
    yield "python", str(found["python"]), "ok" if sys.version_info >= (3, 11) else "needs 3.11"
    yield "system", str(found["system"]), ""
    yield "processor", f"{found['processor']}, {core_count()} of {os.cpu_count()} cores", ""
    for name in PACKAGES:
        value = found[f"version.{name}"]
        yield name, str(value), "ok" if value else f"missing: pip install {name}"
    for name in OPTIONAL:
        try:
            yield f"{name} (optional)", version(name), "ok"
        except PackageNotFoundError:
            yield f"{name} (optional)", "not installed", ""


def _places() -> Iterator[Row]:
    for label, path, own in (("compiled fits, baked meshes", cache_root(), "WARPGRASP_CACHE"),
                             ("compiled kernels", kernel_root(), "WARP_CACHE_PATH")):
        yield label, f"{path} ({_size(path) / 1e6:.0f} MB)", _writable(
            path, own if os.environ.get(own) else "XDG_CACHE_HOME")


def _size(folder: Path) -> int:
    """Bytes of all files below; those that another process removes meanwhile are left out."""
    size = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                size += os.stat(os.path.join(place, name)).st_size
    return size


def _writable(path: Path, variable: str) -> str:
    """A verdict; of a folder that cannot be written, the variable that names another."""
    while not path.exists():
        path = path.parent
    try:
        with tempfile.TemporaryFile(dir=path):
            return "ok"
    except OSError as error:
        return f"cannot be written: {error.strerror}; set {variable}"


def _devices() -> Iterator[Row]:
    try:
        yield "devices", ", ".join(devices()), "ok"
    except Exception as error:
        yield "devices", "Warp does not start", f"{type(error).__name__}: {error}"


def _self_test() -> Iterator[Row]:
    """A distance of the simulator and a fit, against what they must be."""
    began = time.monotonic()
    try:
        import numpy as np

        from fit.superquadric.fit import fit_superquadric
        from warpgrasp.geometry.body import distance_to_bodies, scene_of
        from warpgrasp.objects.catalogue import body_from_name

        body = body_from_name("small_cylinder")
        above = np.array([[[0.0, 0.0, body.high_m[2] + 0.01]]])
        distance, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), above)
        off = abs(float(distance[0, 0]) - 0.01)
        yield "kernel", f"a distance is off by {off:.1e} m", "ok" if off < 1e-9 else "wrong"
        turn = np.random.default_rng(1).normal(size=(1, 60, 3))
        ball = 0.03 * turn / np.linalg.norm(turn, axis=2, keepdims=True)
        size = fit_superquadric(ball, np.ones((1, 60), bool)).size_m[0]
        off = float(np.abs(size - 0.03).max())
        yield "fit", f"a sphere's radius is off by {off:.1e} m", "ok" if off < 1e-3 else "wrong"
    except Exception as error:
        yield "self-test", "failed", f"{type(error).__name__}: {error}"
    yield "self-test", f"{time.monotonic() - began:.1f} s (the first time compiles)", ""
