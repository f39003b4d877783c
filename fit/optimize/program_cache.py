"""Compiled programs kept across processes: a warm start neither traces nor compiles.

JAX's own cache spares compiling, but a program must be traced and lowered to be looked up, which
takes seconds here. So the executables themselves are kept, a file each, in a folder named after
everything they depend on: this package's source, the versions, the processor, XLA's flags. A file
that cannot be read is made anew. They are pickles, trusted as far as the folder is: it is the
user's own cache (XDG_CACHE_HOME or ~/.cache).
"""

from __future__ import annotations

import os
import pickle
import platform
import tempfile
from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from jax.experimental import serialize_executable

from fit.optimize.xla_flags import in_force


def load_or_compile(name: str, function: Any, arguments: tuple) -> Callable:
    """The jitted `function` compiled for arguments of these shapes, from the cache if it is there.

    `name` and the shapes name the program: it must say all that `function` closes over.
    """
    if jax.default_backend() != "cpu":
        return function  # an accelerator's executables are bound to the device
    shapes = jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype.str), arguments)
    file = _folder() / (sha256(f"{name}\n{shapes}".encode()).hexdigest()[:32] + ".xla")
    try:
        payload, skeleton = pickle.loads(file.read_bytes())
        _load_linear_algebra()
        return serialize_executable.deserialize_and_load(
            payload, jax.tree.structure((arguments, {})), jax.tree.structure(skeleton))
    except Exception:  # absent, cut short, or of another world: whatever it was, compile
        compiled = function.lower(*arguments).compile()
    if not in_force():
        return compiled  # by other options than the folder is named after
    try:
        payload, given, result = serialize_executable.serialize(compiled)
        # One that came out of JAX's own cache cannot be kept whole: this raises.
        serialize_executable.deserialize_and_load(payload, given, result)
        _write(file, pickle.dumps((payload, jax.tree.unflatten(result, range(result.num_leaves)))))
    except Exception:  # nor to a full disk or a closed folder: only time is lost
        pass
    return compiled


def any_kept() -> bool:
    """Whether a program of this version was compiled here before."""
    return any(_folder().glob("*.xla"))


@lru_cache(maxsize=1)
def _folder() -> Path:
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = sha256()
    for file in sorted(Path(__file__).parent.parent.rglob("*.py")):
        digest.update(file.read_bytes())
    for fact in (*(version(package) for package in ("jax", "jaxlib", "jaxopt", "numpy")),
                 platform.platform(), platform.python_version(), _processor(),
                 os.environ.get("XLA_FLAGS", ""), str(jax.devices())):
        digest.update(f"\n{fact}".encode())
    return root / "warpgrasp" / "programs" / digest.hexdigest()[:16]


def _processor() -> str:
    """What XLA compiles for: the processor's model and abilities."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    wanted = ("vendor_id", "cpu family", "model", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))


@lru_cache(maxsize=1)
def _load_linear_algebra() -> None:
    """Programs call LAPACK by addresses that JAX fills in when it first lowers such a call."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((2, 2), "float64"))


def _write(file: Path, content: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=file.parent)
    with os.fdopen(handle, "wb") as out:
        out.write(content)
    os.replace(name, file)
