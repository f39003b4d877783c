import json
from pathlib import Path

import trimesh
from studies import SMALL, plan_of, write_spec

from sweeps.run.plan import (
    BLOCK,
    canonical_study,
    cell_hash,
    differences,
    extends,
    plan_study,
    same_bodies,
    study_of,
)
from sweeps.spec.reader import read_spec

SWEPT = SMALL + """
[sweep.grid]
"strategy.closings" = [["curl25"], ["curl40", "curl55"]]
"hand.link_length_mm" = [[43, 33, 28], [40, 30, 25]]
[sweep.lhs]
n = 3
"object.yaw_deg" = { low = -180, high = 180 }
"""


def ids(plan: object) -> list[str]:
    return [unit.id for unit in plan.units()]  # type: ignore[attr-defined]


def test_units_cover_each_cells_episodes_once(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, SWEPT)
    units = list(plan.units())
    assert len({unit.id for unit in units}) == len(units) == plan.unit_count == 2 * 2 * 12 * 2
    for name in {unit.cell_hash for unit in units}:
        spans = sorted((u.start, u.stop) for u in units if u.cell_hash == name)
        assert spans == [(0, BLOCK), (BLOCK, 70)]


def test_shards_part_the_units(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, SWEPT)
    for shards in (1, 2, 5, 7, 50, 200):
        parts = [[unit.id for unit in plan.units((n, shards))] for n in range(1, shards + 1)]
        sizes = [len(part) for part in parts]
        assert sorted(name for part in parts for name in part) == sorted(ids(plan))
        assert sizes == [plan.shard_size((n, shards)) for n in range(1, shards + 1)]
        assert max(sizes) - min(sizes) <= max(1, plan.unit_count / shards / 8)


def test_a_shard_has_what_can_be_run_together(tmp_path: Path) -> None:
    names = ", ".join(f'"{name}"' for name in ("block", "wedge", "funnel", "wine_bottle"))
    plan = plan_of(tmp_path, SWEPT.replace('"block", "wedge"', names).replace("= 70", "= 20"))
    units = list(plan.units((2, 3)))
    assert [u.cell.object_name for u in units[:4]] == ["block", "wedge", "funnel", "wine_bottle"]
    assert len({(u.cell.strategy.name, str(u.cell.setting)) for u in units[:4]}) == 1


def test_a_part_of_the_units_can_be_compared(tmp_path: Path) -> None:
    """The first blocks of all entries come before the next ones, case by case of sampled axes."""
    plan = plan_of(tmp_path, SWEPT.replace("= 70\n", "= 1000\n"))
    units = list(plan.units())
    entries = 4 * 2  # of the grid and zip axes, and strategies
    first = units[:8 * entries]
    assert {(u.start, u.stop) for u in units[:len(units) // 2]} == {
        (64 * n, 64 * n + 64) for n in range(8)}
    assert {u.cell.object_name for u in first} == {"block"}
    assert len({u.cell.setting["object.yaw_deg"] for u in first}) == 1
    assert len({u.cell_hash for u in first}) == entries


def test_planners_that_run_alone_take_objects_one_by_one(tmp_path: Path) -> None:
    text = SMALL.partition("[[strategy]]")[0].replace("= 70", "= 4") + (
        '[[strategy]]\nname = "any-object"\n[[strategy]]\nname = "ring6"\n'
        '[sweep.grid]\n"sensors.tendon_threshold_N" = [3.0, 6.0]\n')
    told = [(u.cell.strategy.name, u.cell.object_name) for u in plan_of(tmp_path, text).units()]
    assert told == [*[("ring6", "block"), ("ring6", "wedge")] * 2,
                    *[("any-object", "block")] * 2, *[("any-object", "wedge")] * 2]


def test_the_resolved_file_names_the_same_units(tmp_path: Path) -> None:
    trimesh.creation.box((80, 80, 80)).export(tmp_path / "mug.stl")
    text = SWEPT.replace('"block"', '{ mesh = "mug.stl", units = "mm" }, { name = "egg", '
                         'superquadric = { size_mm = [30, 30, 45], exponents = [1, 1.0] } }')
    plan = plan_of(tmp_path, text)
    again = plan_study(study_of(json.loads(json.dumps(canonical_study(plan.study)))))
    assert again.hash == plan.hash
    assert ids(again) == ids(plan)


def test_ids_depend_on_what_rows_depend_on(tmp_path: Path) -> None:
    base = ids(plan_of(tmp_path, SMALL))
    for key in ("seed=8", "sensors.tendon_threshold_N=7", "fit.loss=none", "strategy.count=5"):
        changed = ids(plan_study(read_spec(write_spec(tmp_path), [key])))
        assert not set(base) & set(changed), key
    for key in ("name=other", "sensors.tendon_threshold_N=6", "fit.taper=true"):
        assert ids(plan_study(read_spec(write_spec(tmp_path), [key]))) == base, key


def test_robots_that_truly_differ_have_units_of_their_own(tmp_path: Path) -> None:
    """What is believed of them is the same."""
    found = ids(plan_of(tmp_path, SMALL + '[robot]\nswept = "truth"\n[sweep.grid]\n'
                        '"sensors.tendon_threshold_N" = [3.0, 9.0]\n'))
    assert len(set(found)) == len(found)


def test_a_planner_edited_between_two_plans_makes_other_units(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    text = SMALL + '[[strategy]]\nname = "own"\nstrategy = "mine.py:go"\n'
    file.write_text("def go(belief):\n    return [1]\n")
    before = plan_of(tmp_path, text)
    first = ids(before)
    file.write_text("def go(belief):\n    return [2]\n")  # of the same size
    after = plan_of(tmp_path, text)
    assert after.hash != before.hash
    kept = set(first) & set(ids(after))
    assert len(kept) == before.unit_count * 2 // 3  # those of the two other strategies


def test_a_grown_study_keeps_its_units(tmp_path: Path) -> None:
    before = plan_of(tmp_path, SMALL.replace("= 70\no", "= 64\no"))
    after = plan_of(tmp_path, SMALL.replace("= 70\no", "= 200\no").replace(
        '"block", "wedge"', '"funnel", "wedge", "block"') + '[[strategy]]\nname = "random6"\n')
    assert set(ids(before)) < set(ids(after))
    assert extends(before.resolved, after.resolved)
    assert not extends(after.resolved, before.resolved)
    more = plan_of(tmp_path, SMALL)
    assert extends(before.resolved, more.resolved)
    assert not extends(more.resolved, before.resolved)  # of fewer episodes


def test_a_changed_sweep_is_told_by_its_keys(tmp_path: Path) -> None:
    """Not by `sweep[0].si` and `sweep[0].values`, which no spec has."""
    def swept(text: str) -> dict[str, object]:
        return dict(plan_of(tmp_path, SMALL + text).resolved)

    key = '"sensors.tendon_threshold_N"'
    before, after = (swept(f"[sweep.grid]\n{key} = {values}\n") for values in (
        "[3, 6]", "[3, 6, 9]"))
    assert differences(before, after) == [
        "sweep.sensors.tendon_threshold_N: [3, 6] -> [3, 6, 9]"]
    zipped = swept(f"[sweep.zip]\n{key} = [3, 6]\n\"object.y_mm\" = [0, 1]\n")
    apart = swept(f"[sweep.zip]\n{key} = [3, 6]\n[sweep.grid]\n\"object.y_mm\" = [0, 1]\n")
    assert differences(zipped, apart)  # the same values, in other settings


def test_long_values_are_cut_where_they_differ(tmp_path: Path) -> None:
    """Their beginnings alone are alike."""
    def swept(last: int) -> dict[str, object]:
        values = [*range(1, 60), last]
        return dict(plan_of(tmp_path, SMALL + (
            f'[sweep.grid]\n"sensors.tendon_threshold_N" = {values}\n')).resolved)

    line, = differences(swept(70), swept(80))
    before, after = line.partition(": ")[2].split(" -> ")
    assert before.startswith("...")
    assert before.endswith(" 59, 70]")
    assert after == before.replace("70]", "80]")


def test_other_studies_do_not_extend_and_differences_are_told(tmp_path: Path) -> None:
    before = plan_of(tmp_path, SMALL)
    for old, new, line in [
            ("seed = 7", "seed = 8", "seed: 7 -> 8"),
            ("count = 3", "count = 4", 'strategies.mine.waypoints[0].count: 3 -> 4'),
            ('"block", ', "", 'objects.block.sha256: "" -> absent')]:
        after = plan_of(tmp_path, SMALL.replace(old, new))
        assert not extends(before.resolved, after.resolved)
        assert any(text.startswith(line) for text in differences(before.resolved, after.resolved))


def test_a_setting_that_changes_nothing_names_the_same_cell(tmp_path: Path) -> None:
    study = plan_of(tmp_path, SMALL + '[sweep.grid]\n"sensors.tendon_threshold_N" = [3, 6]\n').study
    plain = plan_of(tmp_path, SMALL).study
    body = study.objects[0]
    assert cell_hash(study.cell(0, 0, 1), body) == cell_hash(plain.cell(0, 0, 0), body)


def test_one_body_under_two_names_is_told(tmp_path: Path) -> None:
    for name, size in (("a", 40.0), ("copy", 40.0), ("b", 50.0)):
        trimesh.creation.box((size, 40.0, 60.0)).export(tmp_path / f"{name}.stl")
    meshes = ", ".join(f'{{ mesh = "{file}.stl", units = "{units}", name = "{name}" }}'
                       for file, units, name in (
                           ("a", "mm", "one"), ("copy", "mm", "two"), ("b", "mm", "other"),
                           ("a", "mm", "three")))
    plan = plan_of(tmp_path, SMALL.replace(
        '"wedge"', f'"wedge", {{ object = "block", name = "again" }}, {meshes}'))
    told = [line.partition(" are the same body")[0] for line in same_bodies(plan.study)]
    assert told == ["block and again", "one and two", "one and three"]
    assert list(same_bodies(study_of(plan.resolved))) == list(same_bodies(plan.study))
    assert not list(same_bodies(plan_of(tmp_path / "small").study))
