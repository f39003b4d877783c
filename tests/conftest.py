"""Checks the array shapes in the annotations of `fit` while its own tests run."""

import functools
import inspect
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import hypothesis
import jaxtyping
import pytest

FIT_TESTS = Path(__file__).parent / "fit"
checked_function = jaxtyping.jaxtyped


def checked_when_called(*, typechecker: Any) -> Callable[[Any], Any]:
    """As `jaxtyping.jaxtyped`, but its checks of a function are compiled when it is first called
    with checks: functions inside others are made anew in each call."""
    def decorated(made: Any) -> Any:
        if inspect.isclass(made):
            return checked_function(made, typechecker=typechecker)
        checked: list[Callable[..., Any]] = []

        @functools.wraps(made)
        def function(*values: Any, **words: Any) -> Any:
            if jaxtyping.config.jaxtyping_disable:
                return made(*values, **words)
            if not checked:
                checked.append(checked_function(made, typechecker=typechecker))
            return checked[0](*values, **words)

        return function

    return decorated


jaxtyping.jaxtyped = checked_when_called
jaxtyping.install_import_hook("fit", "beartype.beartype")
# How long an example takes says how busy the machine is.
hypothesis.settings.register_profile("suite", deadline=None, suppress_health_check=[
    hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("suite")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Other tests run `fit` as its users do, without checks."""
    jaxtyping.config.update("jaxtyping_disable", FIT_TESTS not in item.path.parents)
    return (yield)


@pytest.fixture
def unchecked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Switches the checks off, for tests of the errors that `fit` itself raises."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
