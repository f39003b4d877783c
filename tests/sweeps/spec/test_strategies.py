"""Strategies and planners of one's own in a spec: found, named by their content, or refused."""

import json
import sys
from hashlib import sha256
from pathlib import Path

import pytest
import trimesh

from strategies.planners.planner_file import PlannerError
from strategies.planners.registry import find_planner, make_planner
from sweeps.cli.main import run
from sweeps.run.plan import _file_hash, plan_study, study_of
from sweeps.spec.errors import SpecError
from sweeps.spec.objects import object_of_argument
from sweeps.spec.reader import read_spec
from sweeps.spec.strategies import idle_grasp_notes
from warpgrasp.objects.catalogue_names import NAME_LIMIT

MINE = '[[strategy]]\nname = "mine"\n'


@pytest.mark.parametrize(("lines", "says"), [
    ('strategy = "absent.py:f"', "is not a file"),
    ('strategy = "mine.py:absent"', "has no function or class 'absent'"),
    ('strategy = "broken.py:f"', "broken.py:1: ZeroDivisionError"),
    ('strategy = "nonsense"', "no strategy 'nonsense'"),
    ('strategy = 3', "should be a planner's name"),
    ('strategy = "mine.py:f"\norder = ["containment"]', "has no meaning beside a planner"),
    ('strategy = "mine.py:f"\noptions = { size = 3 }', "takes no options"),
    ('strategy = "even"\noptions = { grasps = nan }', "is nan; should be a finite number"),
    ('strategy = "even"\noptions = { grasps = -inf }', "is -inf; should be a finite number"),
    ('strategy = "even"\noptions = { grasps = [3] }', "is [3]; should be a finite number"),
    ('options = { size = 3 }', "has no meaning without a planner"),
    ('budget = { touches = 0 }', "should be a whole number from 1 to 1000000"),
    ('budget = { touches = 1.5 }', "should be a whole number"),
    ('budget = { hours = 3 }', "unknown key"),
    ('budget = 3', "should be a table such as"),
    ('volume = 3', "unknown key"),
    ('refit_every = -1', "should be a whole number from 0 to 256"),
    ('order = ["guess"]', "'guess'"),
])
def test_what_is_wrong_with_a_strategy_is_told_with_its_line(
        tmp_path: Path, lines: str, says: str) -> None:
    (tmp_path / "mine.py").write_text("def f(belief):\n    return []\n")
    (tmp_path / "broken.py").write_text("1 / 0\n")
    file = tmp_path / "study.toml"
    file.write_text(f'schema = 1\nobjects = ["block"]\n{MINE}{lines}\n')
    with pytest.raises(SpecError) as error:
        read_spec(file)
    assert any(says in problem.what for problem in error.value.problems), error.value.problems
    assert all(f"{file}:" in problem.where for problem in error.value.problems)


@pytest.mark.parametrize("name", ["given-prior", "best"])
def test_names_that_mean_something_else_are_refused(tmp_path: Path, name: str) -> None:
    file = tmp_path / "study.toml"
    file.write_text(f'schema = 1\nobjects = ["block"]\n{MINE.replace("mine", name)}'
                    'waypoints = { kind = "ring" }\n')
    with pytest.raises(SpecError, match=rf"study\.toml:4: .*is '{name}', which"):
        read_spec(file)


@pytest.mark.parametrize("line", ['order = ["planar"]', 'waypoints = { kind = "ring" }',
                                  "refit_every = 2"])
def test_keys_that_say_nothing_of_a_ready_made_planner(tmp_path: Path, line: str) -> None:
    file = tmp_path / "study.toml"
    file.write_text('schema = 1\nobjects = ["block"]\n[[strategy]]\nname = "any-object"\n' + line)
    with pytest.raises(SpecError, match=r"study\.toml:5: .*has no meaning beside"):
        read_spec(file)


def test_what_counts_for_grasps_alone_is_told_where_there_are_none(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    text = ('schema = 1\nobjects = ["block"]\n[[strategy]]\nname = "contour-only"\n'
            'closings = ["curl55"]\nrefit_every = 2\n')
    file.write_text(text)
    assert [*idle_grasp_notes(read_spec(file))] == [
        "strategy contour-only: closings, refit_every count for grasps alone, and its order has no "
        '"containment"']
    for more in ('order = ["contour", "containment"]\n',
                 '[sweep.grid]\n"strategy.order" = [["contour"], ["containment"]]\n'):
        file.write_text(text + more)
        assert not [*idle_grasp_notes(read_spec(file))]
    file.write_text(text[:text.index("closings")])
    assert not [*idle_grasp_notes(read_spec(file))]


RING, DECIDE = '[[strategy]]\nname = "ring6"\n', '[[strategy]]\nname = "coarse-to-fine"\n'
RANDOM = '[[strategy]]\nname = "random"\n'
OWN = '[[strategy]]\nname = "own"\nstrategy = "own.py:f"\n'
STEREO = '[contour]\naxis = "stereo"\n'
ORDERS = '"strategy.order" = [["containment"], ["containment", "planar"]]\n'


@pytest.mark.parametrize(("lines", "swept", "said"), [
    (RING, '"planar.step_mm" = [4, 6]', "changes nothing in this study: faces are crossed where"),
    (DECIDE, '"planar.step_mm" = [4, 6]', ""),
    (RING, ORDERS + '"planar.step_mm" = [4, 6]', ""),
    (RING, ORDERS + '"contour.step_mm" = [4, 6]', "contours are followed where an order has"),
    (RANDOM, '"decide.flat_below" = [0.1, 0.2]', "it is for an order with decide"),
    (RING, '"pads.gain_spread" = [0.1, 0.2]', "pads feel where an order has"),
    (RANDOM, '"pads.gain_spread" = [0.1, 0.2]', "or your planner moves them"),
    (RANDOM, '"errors.pad_mm" = [0.1, 0.2]', "or your planner moves them"),
    (OWN, '"pads.gain_spread" = [0.1, 0.2]', ""),
    (DECIDE, '"stereo.pixels" = [128, 256]', "cameras look where object.prior is"),
    (DECIDE + STEREO, '"stereo.pixels" = [128, 256]', ""),
    (RING + STEREO, '"stereo.pixels" = [128, 256]', "cameras look where object.prior is"),
    (RING, '"object.prior" = ["box", "depth"]\n"stereo.pixels" = [128, 256]', ""),
    (RING + "[errors]\nscale = 0\n", '"errors.mount_mm" = [0.1, 0.2]', "errors.scale is 0, and is"),
    (RING, '"errors.scale" = [0, 1]\n"errors.mount_mm" = [0.1, 0.2]', ""),
    (RING + "[errors]\nscale = 0\n", '"errors.scale" = [0]', ""),
    (RING + "[errors]\nscale = 0\n", '"errors.pad_mm" = [0.1, 0.2]', "errors.scale is 0, and is"),
    (RING, '"errors.pad_gain_pct" = [5, 10]', "pads feel where an order has"),
    (RING, '"fit.normals" = [true, false]', "pads feel where an order has"),
    (OWN, '"fit.free_tips" = [true, false]', ""),
    (OWN, '"pads.power" = [1, 2]', "it is read where pads.law is inverse_power"),
    (OWN, '"pads.law" = ["inverse_power"]\n"pads.power" = [1, 2]', ""),
    (RING + "[contact]\nweight = false\n", '"hand.link_density_kg_m3" = [500, 1000]',
     "it is read where contact.weight is true"),
    (RING, '"stereo.missing_depth" = [0.1, 0.2]\n"object.prior" = ["silhouettes"]',
     "it is read where object.prior is depth"),
    (RING, '"stereo.clutter" = [0, 4]\n"object.prior" = ["depth"]',
     "it is read where object.prior is silhouettes, or contour.axis is stereo"),
    (DECIDE + STEREO, '"stereo.clutter" = [0, 4]\n"object.prior" = ["depth"]', ""),
    (RING + '[recognition]\nway = "catalogue_alignment"\n', '"recognition.none_prior" = [0.1, 0.3]',
     "it is read where recognition.way is as_felt or faces"),
    (RING, '"robot.swept" = ["truth", "both"]', "no key of hand, sensors or errors is swept"),
    (RING, '"robot.swept" = ["truth", "both"]\n"errors.scale" = [1, 2]', ""),
    (RANDOM, '"strategy.tilt_deg" = [35, 55]', "no strategy of this study has it"),
    (RANDOM, '"strategy.order" = [["planar"]]', "no strategy of this study has it"),
    (RING + RANDOM, '"strategy.tilt_deg" = [35, 55]', ""),
])
def test_a_swept_key_changes_something(
        tmp_path: Path, lines: str, swept: str, said: str) -> None:
    file = tmp_path / "study.toml"
    file.with_name("own.py").write_text("def f(belief):\n    return []\n")
    file.write_text(f'schema = 1\nobjects = ["block"]\n{lines}[sweep.grid]\n{swept}\n')
    if not said:
        assert read_spec(file).setting_count > 0
        return
    with pytest.raises(SpecError) as error:
        read_spec(file)
    assert len(error.value.problems) == 1
    assert said in error.value.problems[0].what


def test_a_planner_that_ships_is_run_once_beside_swept_pads(tmp_path: Path) -> None:
    """It was run under each setting, with the same rows."""
    file = tmp_path / "study.toml"
    file.write_text(f'schema = 1\nobjects = ["block"]\n{DECIDE}{RANDOM}[sweep.grid]\n'
                    '"pads.gain_spread" = [0.1, 0.2, 0.3]\n')
    study = read_spec(file)
    assert [study.settings_of(number) for number in range(2)] == [3, 1]


def test_a_users_planner_is_named_by_its_content(tmp_path: Path) -> None:
    file, code = tmp_path / "study.toml", tmp_path / "mine.py"
    file.write_text(f'schema = 1\nobjects = ["block"]\n{MINE}strategy = "mine.py:f"\n'
                    'budget = { touches = 40, volume_ratio = 1.5 }\nrefit_every = 2\n')
    code.write_text("def f(belief):\n    return []\n")
    first = plan_study(read_spec(file))
    strategy = first.study.strategies[0]
    assert strategy.call == f"{code}:f"
    assert (strategy.touches, strategy.volume_ratio, strategy.refit_every) == (40, 1.5, 2)
    assert plan_study(study_of(first.resolved)).hash == first.hash
    assert [u.id for u in plan_study(study_of(first.resolved)).units()] == [
        u.id for u in first.units()]
    _file_hash.cache_clear()
    code.write_text("def f(belief):\n    return [] \n")
    assert plan_study(read_spec(file)).hash != first.hash


def test_a_file_of_a_long_name_can_be_explored(tmp_path: Path) -> None:
    file = tmp_path / f"{'x' * 100}.stl"
    trimesh.creation.box((0.06, 0.08, 0.12)).export(file)
    assert object_of_argument(str(file), "m")["name"] == "x" * NAME_LIMIT


def test_files_beside_a_planner_belong_to_it(tmp_path: Path) -> None:
    calls = []
    for name, steps in (("one", "1"), ("two", "22")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "helper.py").write_text("from deeper import STEPS\n")
        (folder / "deeper.py").write_text(f"STEPS = {steps}\n")
        (folder / "mine.py").write_text("from helper import STEPS\n"
                                        "def f(belief):\n    return STEPS\n")
        calls.append(f"{folder}/mine.py:f")
    assert [find_planner(call)(None) for call in calls] == [1, 22]
    assert not {"helper", "deeper"} & set(sys.modules)
    assert not [entry for entry in sys.path if entry.startswith(str(tmp_path))]

    file = tmp_path / "one" / "study.toml"
    file.write_text(f'schema = 1\nobjects = ["block"]\n{MINE}strategy = "mine.py:f"\n')
    first = plan_study(read_spec(file))
    assert plan_study(study_of(first.resolved)).hash == first.hash
    (tmp_path / "one" / "deeper.py").write_text("STEPS = 333\n")
    assert plan_study(read_spec(file)).hash != first.hash
    assert find_planner(calls[0])(None) == 333
    (tmp_path / "one" / "deeper.py").write_text("STEPS = 1\n")
    assert plan_study(read_spec(file)).hash == first.hash


def test_a_planner_alone_is_known_by_its_own_content(tmp_path: Path) -> None:
    (tmp_path / "other.py").write_text("X = 3\n")
    file, code = tmp_path / "study.toml", tmp_path / "mine.py"
    code.write_text("def f(belief):\n    return []\n")
    file.write_text(f'schema = 1\nobjects = ["block"]\n{MINE}strategy = "mine.py:f"\n')
    plan = plan_study(read_spec(file))
    assert plan.resolved["strategies"]["mine"]["call_sha256"] == sha256(
        code.read_bytes()).hexdigest()


@pytest.mark.parametrize(("code", "says"), [
    ("x = 1\n\nraise ValueError('no')\n", "mine.py:3: ValueError: no"),
    ("import json\n\njson.loads('{')\n", "mine.py:3: JSONDecodeError"),
    ("x = 1\nx = = 2\n", "mine.py:2: SyntaxError"),
    ("x = 1\n\n\nimport helper\n", "mine.py:4: SyntaxError"),
])
def test_an_error_in_a_planners_file_is_told_with_its_line(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, says: str) -> None:
    (tmp_path / "mine.py").write_text(code)
    (tmp_path / "helper.py").write_text("x = = 2\n")
    monkeypatch.chdir(tmp_path)
    for call in ("mine.py:f", f"{tmp_path}/mine.py:f"):
        with pytest.raises(PlannerError, match=says):
            make_planner(call, {})


def test_what_a_planner_prints_is_no_result(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text(
        "print('import')\nclass F:\n    def __init__(self, size=1):\n        print('init')\n"
        "    def __call__(self, belief):\n        return []\n")
    file = tmp_path / "study.toml"
    file.write_text(f'schema = 1\nobjects = ["block"]\n{MINE}strategy = "mine.py:F"\n'
                    'options = { size = 1 }\n[sweep.grid]\n"strategy.options.size" = [1, 2]\n')
    assert run(["check", str(file), "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["settings"] == 2
    assert {"import", "init"} <= set(printed.err.split())


@pytest.mark.parametrize(("lines", "budget"), [
    ('strategy = "any-object"\noptions = { poses = 2 }', (96, None)),
    ('strategy = "coverage"', (96, None)),
    ('strategy = "any-object"\nbudget = {}', (None, None)),
    ('strategy = "any-object"\nbudget = { robot_time_s = 60 }', (None, 60.0)),
    ('strategy = "mine.py:f"', (None, None)),
])
def test_a_planner_that_ships_brings_its_budget_where_an_entry_has_none(
        tmp_path: Path, lines: str, budget: tuple[int | None, float | None]) -> None:
    """Or an entry that only sets an option would go on until its steps are used up."""
    (tmp_path / "mine.py").write_text("def f(belief):\n    return []\n")
    file = tmp_path / "study.toml"
    file.write_text(f'schema = 1\nobjects = ["block"]\n{MINE}{lines}\n')
    strategy = read_spec(file).strategies[0]
    assert (strategy.touches, strategy.robot_time_s) == budget


@pytest.mark.parametrize(("given", "budget"), [
    ("{}", (None, None)), ("{ robot_time_s = 60 }", (None, 60.0)), ("{ touches = 8 }", (8, None))])
def test_a_budget_stands_in_place_of_that_of_the_ready_made_strategy(
        tmp_path: Path, given: str, budget: tuple[int | None, float | None]) -> None:
    """Its 96 touches counted, too."""
    file = tmp_path / "study.toml"
    file.write_text('schema = 1\nobjects = ["block"]\n[[strategy]]\nname = "coverage"\n'
                    f"budget = {given}\n")
    strategy = read_spec(file).strategies[0]
    assert (strategy.touches, strategy.robot_time_s) == budget
