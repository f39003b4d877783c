"""XLA is told in time how to compile; where it was not, no program is kept under a wrong name."""

import os
import subprocess
import sys

import pytest

from fit.xla_options import OPTIONS

SAY = """
import os
from fit.xla_options import in_force
print(in_force(), os.environ["XLA_FLAGS"])
"""


def said(before: str, flags: str = "") -> list[str]:
    """What a fresh process says of its options, having run `before`."""
    done = subprocess.run([sys.executable, "-c", before + SAY], check=True, text=True,
                          capture_output=True, env={**os.environ, "XLA_FLAGS": flags})
    return done.stdout.split()


@pytest.mark.parametrize("flags", ["", "--xla_cpu_multi_thread_eigen=false"])
def test_they_are_in_force_beside_the_users(flags: str) -> None:
    assert said("import jax, fit.batch", flags) == ["True", OPTIONS, *flags.split()]


def test_where_a_device_was_asked_for_before_they_are_not() -> None:
    assert said("import jax; jax.devices(); import fit.batch") == ["False", OPTIONS]


def test_the_users_own_extra_options_stay() -> None:
    own = "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling"
    assert said("import fit.batch", own) == ["True", own]
