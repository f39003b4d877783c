"""A spec's own file of known models: checked with its line, part of the hash, kept by the study."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from strategies.recognition.known_models import SHIPPED, models_from_file, models_text
from sweeps.run.inputs import keep_inputs, kept_cell
from sweeps.run.plan import cell_hash, plan_study, study_of
from sweeps.spec.errors import SpecError, StoreError
from sweeps.spec.reader import read_spec

SPEC = """schema = 1
objects = ["block"]
[[strategy]]
name = "ring6"
[recognition]
"""


def spec(folder: Path, lines: str) -> Path:
    file = folder / "study.toml"
    file.write_text(SPEC + lines)
    return file


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    file = tmp_path / "mine.json"
    file.write_text(models_text(models_from_file("")))
    return file


def test_the_file_is_found_beside_the_spec_and_hashed_by_content(
        tmp_path: Path, mine: Path) -> None:
    study = read_spec(spec(tmp_path, 'models = "mine.json"\n'))
    assert study.tables["recognition"].models == str(mine)
    plan = plan_study(study)
    body = study.objects[0]
    before = cell_hash(study.cell(0, 0, 0), body)
    assert str(tmp_path) not in json.dumps(plan.resolved)
    other = models_from_file(str(mine))
    mine.write_text(models_text(replace(other, objects=other.objects[:3])))
    again = plan_study(read_spec(spec(tmp_path, 'models = "mine.json"\n')))
    assert again.hash != plan.hash
    assert cell_hash(again.study.cell(0, 0, 0), body) != before


def test_a_study_keeps_its_models(tmp_path: Path, mine: Path) -> None:
    plan = plan_study(read_spec(spec(tmp_path, 'models = "mine.json"\n')))
    keep_inputs(tmp_path / "runs", plan.study)
    read_back = study_of(plan.resolved)
    assert plan_study(read_back).hash == plan.hash
    text = mine.read_text()
    mine.unlink()
    cell = kept_cell(read_back.cell(0, 0, 0), read_back.objects[0], (tmp_path / "runs",))
    assert Path(cell.recognition.models).read_text() == text
    with pytest.raises(StoreError, match="known models"):
        kept_cell(read_back.cell(0, 0, 0), read_back.objects[0], (tmp_path / "elsewhere",))


@pytest.mark.parametrize(("lines", "message"), [
    ('models = "absent.json"', r":6: recognition.models: 'absent.json' is not a file"),
    ('models = "study.toml"', ":6: recognition.models: .* is no file of models"),
    ('way = "guess"', ":6: recognition.way: is 'guess'; there are: as_felt, faces"),
    ("none_prior = 1.5", ":6: recognition.none_prior: is 1.5; should be a number from 0.001"),
    ('[sweep.grid]\n"recognition.models" = ["a", "b"]', "unknown key"),
])
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, lines: str, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        read_spec(spec(tmp_path, lines))


def test_a_way_that_the_models_leave_unused_is_refused(tmp_path: Path, mine: Path) -> None:
    known = models_from_file("")
    untried = replace(known.objects[0], tried={**known.objects[0].tried, "profile": 0})
    mine.write_text(models_text(replace(known, objects=(untried, *known.objects[1:]))))
    read_spec(spec(tmp_path, 'models = "mine.json"\n'))
    with pytest.raises(SpecError, match=r":7: recognition.way: profile: was not tried on every "
                                        r"object of mine.json"):
        read_spec(spec(tmp_path, 'models = "mine.json"\nway = "profile"\n'))


def test_ways_can_be_swept(tmp_path: Path) -> None:
    study = read_spec(spec(
        tmp_path, '[sweep.grid]\n"recognition.way" = ["as_felt", "catalogue_alignment"]\n'))
    assert [study.cell(0, 0, k).recognition.way for k in (0, 1)] == [
        "as_felt", "catalogue_alignment"]
    assert not study.tables["recognition"].models
    assert SHIPPED.is_file()
