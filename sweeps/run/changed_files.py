"""Whether the files that a study was read from are what they were while its units are run."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from strategies.reconstruct.plug_in_name import plug_in_file
from sweeps.run.plan import Unit, cell_hash, forget_files
from sweeps.spec.cell import Cell
from sweeps.spec.study import FILE_KEYS, Body


class ChangedFilesError(RuntimeError):
    """Rows would not be those that their unit's name promises."""


def check_files(units: Sequence[Unit]) -> None:
    """Raises ChangedFilesError where a file that the rows of a unit depend on has not the content
    that it had when the units were planned."""
    forget_files()
    digests: dict[tuple[str, ...], str] = {}  # of the objects' files, which may be large
    for name, cell in {unit.cell_hash: unit.cell for unit in units}.items():
        files = list(_files_of(cell))
        if not files:
            continue
        cause = ""
        try:
            if cell_hash(cell, _body(cell, digests)) == name:
                continue
        except (OSError, ValueError) as error:  # gone, or no planner any longer
            cause = f" ({error})"
        raise ChangedFilesError(
            f"{', '.join(files)}: changed since the study was read (or a file that is imported "
            f"there){cause}; run the sweep again when it is as it was, or with the changed file "
            "into another directory")


def named_files(table: Any) -> Iterator[str]:
    """The files that an object's table names, in its order."""
    if isinstance(table, Mapping):
        for key, entry in table.items():
            if key in FILE_KEYS and isinstance(entry, str):
                yield entry
            else:
                yield from named_files(entry)
    elif isinstance(table, list | tuple):
        for entry in table:
            yield from named_files(entry)


def _body(cell: Cell, digests: dict[tuple[str, ...], str]) -> Body:
    """The object of a cell, with the hash of its files as they are now, from `digests` if there."""
    from sweeps.spec.objects import files_digest  # imports what reads a spec

    files = tuple(named_files(cell.body_table))
    if files and files not in digests:
        digests[files] = files_digest([Path(file) for file in files])
    return Body(cell.object_name, cell.body_table, digests[files] if files else "")


def _files_of(cell: Cell) -> Iterator[str]:
    """The files that a cell names."""
    yield from named_files(cell.body_table)
    named = [getattr(family, "file", "") for family in cell.strategy.waypoints]
    named += [plug_in_file(cell.strategy.call), plug_in_file(cell.fit.reconstruct),
              cell.recognition.models]
    named += [kind for kind in (cell.hand.kind, cell.arm.kind) if kind.endswith(".toml")]
    yield from filter(None, named)
