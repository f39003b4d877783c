"""Programs of tests, kept between runs as those of fits are: tracing one takes seconds."""

import inspect
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax

from fit.optimize.program_cache import load_or_compile


def call_kept(function: Callable, *arguments: Any, form: Any) -> Any:
    """`function(*arguments, form=form)`, jitted, in float64, on the host.

    Programs lie where the sources of `fit` say. What else makes this one is in its name: the file
    of `function`, which may close over nothing, and the form.
    """
    name = f"{Path(inspect.getfile(function)).read_text()}\n{function.__name__}\n{form}"
    with jax.enable_x64(True):
        program = load_or_compile(name, jax.jit(partial(function, form=form)), arguments)
        return jax.device_get(program(*arguments))
