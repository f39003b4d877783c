"""A study's episodes as one Arrow table, for analyses of your own."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from sweeps.run.store import open_study


def read_rows(*folders: str | Path) -> pa.Table:
    """Every finished episode of a study, a row each; `.to_pandas()` where pandas is installed.

    Beside the columns of the units, `setting` numbers the point of the swept axes, and each swept
    key is a column of its own, as text. `folders` hold one study, or its shards. Raises StoreError
    for a directory that cannot be read, OtherStudy where they are not of one study.
    """
    plan, stores = open_study([Path(folder) for folder in folders])
    parts: list[pa.Table] = []
    units = plan.units()
    for _, _, setting in plan.study.cells():
        given, _ = plan.study.setting(setting)
        for _ in range(plan.block_count):
            unit = next(units)
            rows = next((rows for store in stores if (rows := store.read(unit)) is not None), None)
            if rows is not None:
                count = len(rows["status"])
                rows = rows | {"setting": np.full(count, setting, np.int64)} | {
                    key: np.full(count, str(value), object) for key, value in given.items()}
                parts.append(_table(rows))
    return pa.concat_tables(parts, promote_options="default") if parts else pa.table({})


def _table(columns: dict[str, np.ndarray]) -> pa.Table:
    return pa.table({name: pa.array(_plain(values)) for name, values in columns.items()})


def _plain(values: np.ndarray) -> Sequence | np.ndarray:
    return values.tolist() if values.dtype == object else values
