"""What could change the bits of a result: versions, processor, device, commit, variables."""

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from fit.optimize.xla_flags import ONE_THREAD, OPTIONS
from strategies.planners.planner_file import environment_without_planners

PACKAGES = ("warpgrasp", "warp-lang", "jax", "jaxlib", "jaxopt", "numpy", "scipy", "trimesh",
            "pyarrow")


def describe_environment(device: str) -> dict[str, Any]:
    """A record of this machine and installation."""
    return {
        "device": device,
        **({} if device == "cpu" else {"accelerator": _accelerator(device)}),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "commit": _commit(),
        **{f"version.{name}": _version(name) for name in PACKAGES},
        **_variables(),
    }


def _variables() -> dict[str, str]:
    """Environment variables of the user's that change how workers compute, where they are set."""
    given = environment_without_planners()
    found = {name: given.get(name, "") for name in ("XLA_FLAGS", "OPENBLAS_CORETYPE")}
    if flags := found["XLA_FLAGS"].split():
        found["XLA_FLAGS"] = " ".join(
            flag for flag in flags if flag not in (OPTIONS, ONE_THREAD))
    return {name: text for name, text in found.items() if text}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _accelerator(device: str) -> str | None:
    """What a GPU is called; None where it is on another machine, of a cluster."""
    from sweeps.output import init_warp

    init_warp()
    import warp as wp

    try:
        return wp.get_device(device).name
    except ValueError:
        return None


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor()


def _commit() -> str | None:
    """The commit of a source checkout; None for an installed package."""
    here = Path(__file__).parents[2]
    if not (here / ".git").exists():
        return None
    try:
        found = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True,
                               text=True, timeout=10, check=True,
                               env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"})
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip()
