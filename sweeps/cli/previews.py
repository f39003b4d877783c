"""The commands that run nothing: check, objects, strategies, init. They import as little."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from sweeps.analysis.text_table import print_table


def check(spec: Path, *, settings: Sequence[str], as_json: bool) -> int:
    """Prints what a spec amounts to, without running it."""
    from sweeps.run.estimate import estimate_cost
    from sweeps.run.plan import plan_study
    from sweeps.spec.reader import read_spec

    plan = plan_study(read_spec(spec, settings))
    head = plan.study.head
    rows = [
        ("study", head.name), ("hash", plan.hash),
        ("strategies", f"{len(plan.study.strategies)}"), ("objects", f"{len(plan.study.objects)}"),
        ("settings", f"{plan.study.setting_count}"), ("cells", f"{plan.study.cell_count}"),
        ("episodes", f"{plan.study.cell_count * head.episodes_per_cell}"),
        ("units", f"{plan.unit_count}"), *estimate_cost(plan),
    ]
    if as_json:
        print(json.dumps(dict(rows), indent=1))
    else:
        width = max(len(name) for name, _ in rows)
        for name, value in rows:
            print(f"{name.ljust(width)}  {value}")
    return 0


def objects(*, as_json: bool) -> int:
    """Prints the catalogue of objects."""
    from warpgrasp.objects.catalogue_names import BODY_NAMES

    print_table(("object", "what"), list(BODY_NAMES.items()), as_json)
    return 0


def strategies(*, as_json: bool) -> int:
    """Prints the ready-made strategies."""
    from strategies.ready_made import STRATEGIES

    print_table(("strategy", "what"), [(s.name, s.doc) for s in STRATEGIES.values()], as_json)
    return 0


def init(spec: Path, *, force: bool) -> int:
    """Writes a commented template."""
    from sweeps.output import write_atomic
    from sweeps.spec.errors import StoreError
    from sweeps.spec.template import spec_template

    if spec.exists() and not force:
        raise StoreError(f"{spec}: is there already; choose another name, or say --force")
    try:
        write_atomic(spec, spec_template().encode())
    except OSError as error:
        raise StoreError(f"{spec}: cannot be written: {error.strerror}") from None
    print(f"{spec}: written; `warpgrasp check {spec}` says what it amounts to", file=sys.stderr)
    return 0
