"""The two lock files, of which the second keeps what the first pinned, and the lowest versions."""

import re
import tomllib
from pathlib import Path

import pytest
from lowest_versions import PROJECT, lowest_versions

ROOT = Path(__file__).parent.parent
LOCKS = ("requirements.lock", "requirements-validate.lock")
PINNED = re.compile(r"^([a-z0-9._-]+)==(\S+)(?: ; (.+?))? \\$", re.MULTILINE)


def pins(lock: str) -> set[tuple[str, str, str]]:
    """Name, version and the Pythons it is for."""
    return set(PINNED.findall((ROOT / lock).read_text()))


def test_validate_keeps_every_pin_of_the_main_lock() -> None:
    """An older one put a docutils beside Sphinx that Sphinx refuses, and it went unseen."""
    assert len(pins("requirements.lock")) > 100
    assert pins("requirements.lock") <= pins("requirements-validate.lock")


@pytest.mark.parametrize("lock", LOCKS)
def test_every_pin_has_a_hash_and_no_address(lock: str) -> None:
    text = (ROOT / lock).read_text()
    parts = re.split(r"^(?=[a-z0-9._-]+==)", text, flags=re.MULTILINE)
    assert all("--hash=sha256:" in part for part in parts[1:])
    assert "://" not in text


def test_what_the_project_asks_for_is_locked() -> None:
    whole = tomllib.loads((ROOT / "pyproject.toml").read_text())
    asked = list(whole["project"]["dependencies"])
    asked += whole["project"]["optional-dependencies"]["validate"]
    for group in whole["dependency-groups"].values():
        asked += [v for v in group if isinstance(v, str)]
    names = {re.split(r"[\[<>=]", v)[0].lower() for v in asked}
    assert names <= {name for name, _, _ in pins("requirements-validate.lock")}


def test_every_dependency_names_its_lowest_version() -> None:
    """`make test-lowest` tries them; some that were allowed had failed."""
    project = tomllib.loads(PROJECT.read_text())["project"]
    found = lowest_versions(project["dependencies"])
    assert len(found) == len(project["dependencies"])
    assert all(re.fullmatch(r"[\w-]+==\d+(\.\d+)*", line) for line in found)
    assert lowest_versions(["a-b>=1.2,<2", "c[d]==0.8.5"]) == ["a-b==1.2", "c==0.8.5"]
    with pytest.raises(ValueError, match="numpy: names no lowest version"):
        lowest_versions(["numpy"])
