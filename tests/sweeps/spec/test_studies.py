"""The studies that ship are specs without a fault, and each has its paragraph."""

from pathlib import Path

import pytest
from places import ROOT

from sweeps.run.plan import plan_study, study_of
from sweeps.spec.reader import read_spec

STUDIES = sorted((ROOT / "sweeps" / "studies").glob("*.toml"))


MANY_BODIES = ("everyday", "held_out")


@pytest.mark.parametrize("file", [
    pytest.param(file, id=file.stem, marks=pytest.mark.slow if file.stem in MANY_BODIES else ())
    for file in STUDIES])
def test_a_study_is_a_plan_and_is_explained(file: Path) -> None:
    plan = plan_study(read_spec(file))
    assert plan.unit_count > 0
    again = plan_study(study_of(plan.resolved, plan.study.head.name))
    assert again.hash == plan.hash
    assert f"## {file.stem}" in (ROOT / "docs" / "studies.md").read_text()


def test_the_example_in_the_docs_is_the_file() -> None:
    code = (ROOT / "examples" / "mine" / "mine.py").read_text().split("\n\n", 1)[1].strip()
    assert code in (ROOT / "docs" / "strategies.md").read_text()
