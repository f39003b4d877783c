"""One unit of work as a Parquet file with its identity and a check against damage, and beside it
another one of its contacts, where they are kept."""

import errno
import hashlib
import io
import os
import stat
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sweeps.output import write_atomic
from sweeps.spec.cell import CONTACTS

_LARGEST_BYTES = 64 << 20
_MAGIC = b"PAR1"  # how a Parquet file begins and ends
_TAIL_BYTES = 16_384  # the footer of a usual unit
Columns = dict[str, np.ndarray]


class DamagedUnit(ValueError):
    """A unit file that is truncated, altered, or not the unit its name says."""


def encode_unit(unit_id: str, columns: Mapping[str, np.ndarray]) -> bytes:
    """The bytes of a unit file: the same rows give the same bytes."""
    plain = {name: _plain(name, values) for name, values in columns.items()}
    if len({len(values) for values in plain.values()}) != 1:
        raise ValueError("columns of a unit should be equally long: "
                         f"{ {name: len(values) for name, values in plain.items()} }")
    table = pa.table({name: _arrow(values) for name, values in plain.items()})
    table = table.replace_schema_metadata({"unit": unit_id, "content": content_hash(plain)})
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def write_unit(path: Path, unit_id: str, columns: Mapping[str, np.ndarray]) -> None:
    """Writes a unit file whole or not at all."""
    write_atomic(path, encode_unit(unit_id, columns))


def encode_files(unit_id: str, rows: Columns) -> dict[str, bytes]:
    """The files of a unit by the folder of the study that each belongs in, to be written in this
    order: its contacts, if they are kept, then its rows, so that a unit that is there is whole."""
    plain = {name: values for name, values in rows.items() if name != CONTACTS}
    files = {"units": encode_unit(unit_id, plain)}
    if CONTACTS in rows:
        contacts = encode_unit(contacts_id(unit_id), _contact_columns(rows))
        files = {"contacts": contacts, **files}
    return files


def contacts_id(unit_id: str) -> str:
    """What stands in the file of a unit's contacts for its identity."""
    return f"{unit_id}.contacts"


def _contact_columns(rows: Columns) -> Columns:
    """The contacts of all episodes of a unit, one below the other."""
    tables = rows[CONTACTS]
    counts = [len(table["status"]) for table in tables]
    named = {name: np.repeat(rows[name], counts) for name in ("episode", "strategy", "object")}
    return named | {name: np.concatenate([table[name] for table in tables])
                    for name in tables[0]}


def write_files(path: Path, unit_id: str, rows: Columns) -> None:
    """Writes the files of a unit whose rows belong at `path`, each whole or not at all."""
    for folder, content in encode_files(unit_id, rows).items():
        write_atomic(path.parent.parent / folder / path.name, content)


def read_unit(path: Path, unit_id: str, row_count: int | None = None) -> Columns:
    """The columns of a unit file; `DamagedUnit` where its content is not what was written."""
    content = _read_bytes(path)
    try:
        table = pq.ParquetFile(io.BytesIO(content)).read(use_threads=False)
        columns = {name: _column(table, name) for name in table.column_names}
        metadata = table.schema.metadata or {}
    except Exception as error:  # a decoder may raise anything for a damaged file
        raise DamagedUnit(f"cannot be decoded: {error}"[:200]) from None
    if metadata.get(b"unit", b"").decode("utf-8", "replace") != unit_id:
        raise DamagedUnit("is another unit than its name says")
    if metadata.get(b"content", b"").decode("utf-8", "replace") != content_hash(columns):
        raise DamagedUnit("holds other rows than were written")
    if row_count is not None and any(len(v) != row_count for v in columns.values()):
        raise DamagedUnit(f"does not hold {row_count} rows")
    return columns


def _read_bytes(path: Path) -> bytes:
    """The bytes of a file no larger than a unit can be; another error than that is the disk's."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # a pipe would be waited for
            raise DamagedUnit("is no plain file")
        with path.open("rb") as stream:
            content = stream.read(_LARGEST_BYTES + 1)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise DamagedUnit("is a link to itself") from None
        raise
    if len(content) > _LARGEST_BYTES:
        raise DamagedUnit(f"is larger than {_LARGEST_BYTES >> 20} MiB")
    return content


def looks_whole(path: Path, unit_id: str) -> bool:
    """Whether a file ends as the unit's file does, without reading its rows.

    Sees a file that was cut, emptied or is another unit's, not a bit that flipped among the rows:
    that is seen by `read_unit`, which every leaderboard uses.
    """
    with path.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - _TAIL_BYTES))
        tail = stream.read()
        footer = int.from_bytes(tail[-8:-4], "little")
        if len(tail) < 12 or tail[-4:] != _MAGIC or footer + 12 > size:
            return False
        if footer + 8 > len(tail):
            stream.seek(size - 8 - footer)
            tail = stream.read()
    return unit_id.encode() in tail[-8 - footer:]


def column_types(path: Path) -> dict[str, pa.DataType]:
    """The names and types of a unit file's columns, by its end; none where there is no whole file.
    """
    try:
        schema = pq.read_schema(path)
    except (OSError, pa.ArrowException):
        return {}
    return dict(zip(schema.names, schema.types, strict=True))


def _arrow(values: np.ndarray) -> pa.Array:
    if holds_lists(values):
        return pa.array([v.tolist() for v in values], type=pa.list_(pa.float64()))
    if values.dtype == object:
        return pa.array(values.tolist(), type=None if len(values) else pa.string())
    return pa.array(values)


def holds_lists(values: np.ndarray) -> bool:
    """Whether a column holds an array of numbers in each row, as the curves do."""
    return values.dtype == object and len(values) > 0 and isinstance(values[0], np.ndarray)


def _plain(name: str, values: np.ndarray) -> np.ndarray:
    values = np.asarray(values)
    if values.ndim != 1:
        raise ValueError(f"column {name} of a unit should be one-dimensional")
    if values.dtype.kind in "UO":
        values = values.astype(object)
        if holds_lists(values) and any(v.dtype != float or v.ndim != 1 for v in values):
            raise ValueError(f"column {name} of a unit should hold 1-D arrays of float64")
        return values
    if values.dtype.kind not in "bif":
        raise ValueError(f"column {name} of a unit should hold numbers or strings")
    return values


def _column(table: pa.Table, name: str) -> np.ndarray:
    column = table.column(name)
    if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        return np.array(column.to_pylist(), dtype=object)
    if pa.types.is_list(column.type):
        rows = np.empty(len(column), object)
        rows[:] = [np.asarray(row, float) for row in column.to_pylist()]
        return rows
    return column.to_numpy()


def content_hash(columns: Mapping[str, np.ndarray]) -> str:
    """The hash of a unit's rows, names and types included."""
    found = hashlib.sha256()
    for name, values in columns.items():
        found.update(f"{name}:{values.dtype.str}:{len(values)};".encode())
        if holds_lists(values):
            for row in values:
                found.update(f"{len(row)};".encode() + np.ascontiguousarray(row).tobytes())
        elif values.dtype == object:
            found.update("\0".join(map(str, values)).encode("utf-8", "surrogatepass"))
        else:
            found.update(np.ascontiguousarray(values).tobytes())
    return found.hexdigest()
