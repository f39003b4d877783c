"""Checks the array shapes in the annotations of `fit` while its own tests run."""

from collections.abc import Generator
from pathlib import Path

import hypothesis
import jaxtyping
import pytest

FIT_TESTS = Path(__file__).parent / "fit"

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
