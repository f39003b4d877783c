"""XLA is told in time how to compile; where it was not, no program is kept under a wrong name."""

import os
import subprocess
import sys

import pytest

from fit.optimize.xla_flags import ONE_THREAD, OPTIONS

SAY = """
import os
from fit.optimize.xla_flags import xla_flags_active
print(xla_flags_active(), os.environ["XLA_FLAGS"])
"""


def said(before: str, flags: str = "") -> list[str]:
    """What a fresh process says of its options, having run `before`."""
    done = subprocess.run([sys.executable, "-c", before + SAY], check=True, text=True,
                          capture_output=True, env={**os.environ, "XLA_FLAGS": flags})
    return done.stdout.split()


@pytest.mark.parametrize(("flags", "found"), [
    pytest.param("", [ONE_THREAD], marks=pytest.mark.slow),
    ("--xla_cpu_enable_fast_math=false", ["--xla_cpu_enable_fast_math=false", ONE_THREAD]),
    ("--xla_cpu_multi_thread_eigen=true", ["--xla_cpu_multi_thread_eigen=true"]),
])
def test_they_are_in_force_beside_the_users(flags: str, found: list[str]) -> None:
    assert said("import jax, fit.optimize.batch", flags) == ["True", OPTIONS, *found]


def test_where_a_device_was_asked_for_before_they_are_not() -> None:
    said_late = said("import jax; jax.devices(); import fit.optimize.batch")
    assert said_late == ["False", OPTIONS, ONE_THREAD]


def test_the_users_own_extra_options_stay() -> None:
    own = "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling"
    assert said("import fit.optimize.batch", own) == ["True", own, ONE_THREAD]


@pytest.mark.parametrize("own", [
    pytest.param("", marks=pytest.mark.slow), "--xla_cpu_enable_fast_math=false"])
def test_workers_and_commands_share_what_is_compiled(own: str) -> None:
    """Else `warmup` warms no study."""
    say = ("import fit.optimize.batch; from fit.optimize import program_cache; "
           "print(program_cache._folder())")
    both = (f"import subprocess, sys\n{say}; sys.stdout.flush()\n"
            "from sweeps.run.local_engine import as_a_worker\n"
            f"with as_a_worker(): subprocess.run([sys.executable, '-c', {say!r}], check=True)")
    command, worker = subprocess.check_output(
        [sys.executable, "-c", both], env={**os.environ, "XLA_FLAGS": own}).splitlines()
    assert command == worker
