"""Prints the lowest versions that pyproject.toml allows, as constraints for pip.

    python tests/scripts/lowest_versions.py > lowest.txt

Whoever has them already keeps them when they install this package, so all of it has to work with
them: `make test-lowest`.
"""

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).parents[2] / "pyproject.toml"


def lowest_versions(requirements: list[str]) -> list[str]:
    """Of each of some requirements the lowest version, as `name==version`. Raises ValueError for
    one that names none."""
    found = []
    for line in requirements:
        named = re.fullmatch(r"([\w.-]+)(?:\[[\w,]+\])?(?:>=|==)([\d.]+)(?:,.*)?", line)
        if named is None:
            raise ValueError(f"{line}: names no lowest version; should be name>=version")
        found.append(f"{named[1]}=={named[2]}")
    return found


def main() -> None:
    """Print a line for each dependency of the package itself."""
    project = tomllib.loads(PROJECT.read_text())["project"]
    print("\n".join(lowest_versions(project["dependencies"])))


if __name__ == "__main__":
    main()
