"""The directory of a study: a unit is done if its file exists; there is no other record."""

import errno
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from shlex import join
from typing import Any

from sweeps.file_lock import held_locks, same_file, sign, signature, try_lock, turn
from sweeps.output import write_atomic
from sweeps.result_file import OWN_FILES, other_files
from sweeps.run.environment import describe_environment
from sweeps.run.inputs import keep_inputs
from sweeps.run.plan import Plan, Unit, differences, digest, extends, plan_study, study_of
from sweeps.run.unit_file import (
    Columns,
    DamagedUnit,
    column_types,
    contacts_id,
    looks_whole,
    read_unit,
)
from sweeps.spec.errors import Held, OtherStudy, StoreError, short
from warpgrasp.core.plain_text import counted


def _unreadable(file: Path, error: OSError) -> StoreError:
    return StoreError(f"{file}: cannot be read: {error.strerror}")


PROBE_BYTES = 1 << 16
"""About what a unit's file takes."""


class Store:
    """The files of one study below one directory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.units = folder / "units"
        self.contacts = folder / "contacts"
        self.logs = folder / "logs"
        self.damaged = 0  # units set aside so far
        self.stuck: set[Path] = set()  # damaged files that cannot be moved
        self.growing = False  # blocks were read as they were before the study grew
        self.held: tuple[int, str] | None = None  # the shard's lock, and what it is held for

    def refuse_other_files(self) -> None:
        """Refuses a directory that holds other things than a study, or what one begins with.

        Raises StoreError with exit code 3: nothing of a folder of the user's is written over.
        """
        try:
            others = other_files(self.folder)
        except OSError as error:
            raise self._unwritable(error) from None
        if others:
            more = f" and {len(others) - 3} more" if len(others) > 3 else ""
            raise StoreError(f"{self.folder}: holds {', '.join(map(short, others[:3]))}{more}, "
                             "and no study; choose a new or an empty directory", 3)

    def open_for(self, plan: Plan, spec_text: bytes | None, device: str) -> list[str]:
        """Makes the directory the study's own; returns notes for the user.

        `OtherStudy` if it belongs to another spec. A study that only grew (more episodes,
        strategies or objects) is taken up: every unit that is still the same is kept. Who runs it
        holds a shard's lock first: a run that is refused must not change what another works on.
        """
        notes: list[str] = []
        try:
            self.units.mkdir(parents=True, exist_ok=True)
            self.logs.mkdir(exist_ok=True)
            if plan.study.head.keep == "contacts":
                self.contacts.mkdir(exist_ok=True)
            with turn(self.folder):  # of two specs that begin at once, the second is refused
                if self.held is not None:
                    sign(*self.held, plan.hash)
                notes += self._claim(plan)
            keep_inputs(self.folder, plan.study)
            if spec_text is not None:
                write_atomic(self.folder / "spec.toml", spec_text)
            notes += self._note_environment(device)
        except OSError as error:
            raise self._unwritable(error) from None
        return notes

    def _unwritable(self, error: OSError) -> StoreError:
        return StoreError(f"{error.filename or self.folder}: cannot be written: {error.strerror}")

    def refuse_other_study(self, plan: Plan) -> None:
        """Raises OtherStudy where the directory has a study that `plan` does not extend."""
        old = self.resolved() if (self.folder / "resolved.json").exists() else None
        if old and old["hash"] != plan.hash and not extends(old["study"], plan.resolved):
            raise OtherStudy(self.folder, differences(old["study"], dict(plan.resolved)))

    def _claim(self, plan: Plan) -> list[str]:
        self.refuse_other_study(plan)
        file = self.folder / "resolved.json"
        notes = []
        earlier: set[int] = set()  # episodes of a cell before the study grew
        content = {"hash": plan.hash, "name": plan.study.head.name, "keep": plan.study.head.keep,
                   "study": plan.resolved}
        if file.exists():
            old = self.resolved()
            if content["keep"] == "contacts" and old.get("keep") != "contacts":
                notes = ["contacts are kept from now on: units without them are run again"]
            if old["hash"] == plan.hash:
                if content["keep"] == old.get("keep", "nothing"):
                    return []
                content = {**old, "keep": content["keep"]}  # in the order of its first spec
            else:
                self._refuse_beside_others(plan)
                notes += ["the study has grown; what is there of it is kept"]
            earlier = {*old.get("earlier", ()), old["study"]["episodes_per_cell"]}
        if grown := sorted(earlier - {plan.study.head.episodes_per_cell}):
            content["earlier"] = grown
        write_atomic(file, (json.dumps(content, indent=1) + "\n").encode())
        return notes

    def _refuse_beside_others(self, plan: Plan) -> None:
        """Refuses a grown study while shards run as it was: it joins units that they count."""
        for shard, text in held_locks(self.folder).items():
            holder, study, _ = signature(text)
            if study not in ("", plan.hash):  # nothing: it is about to begin
                raise StoreError(f"{self.folder}: {holder} works on shard {shard}, of the study "
                                 "before it grew; wait for it, or give all the same spec", 3)

    def _note_environment(self, device: str) -> list[str]:
        file = self.folder / "environment.json"
        if file.exists():
            return self.environment_notes(device)
        now = describe_environment(device)
        write_atomic(file, (json.dumps(now, indent=1, sort_keys=True) + "\n").encode())
        return []

    def environment_notes(self, device: str) -> list[str]:
        """What has changed since the study's units were made, as a note for the user."""
        now = describe_environment(device)
        try:
            before = json.loads((self.folder / "environment.json").read_bytes())
        except (ValueError, RecursionError, FileNotFoundError):
            before = None
        except OSError as error:
            raise _unreadable(self.folder / "environment.json", error) from None
        if not isinstance(before, dict):  # damaged: nothing is known of it
            before = {}
        changed = [f"{key}: {before.get(key)} -> {now.get(key)}"
                   for key in sorted({*before, *now}) if before.get(key) != now.get(key)]
        return ["finished units were made in another environment, bits may differ: "
                + "; ".join(changed)] if changed else []

    def resolved(self) -> dict[str, Any]:
        """The study this directory belongs to, as `resolved.json` has it."""
        file = self.folder / "resolved.json"
        try:
            found = json.loads(file.read_bytes())
            if not isinstance(found, dict) or digest(found.get("study")) != found.get("hash"):
                raise ValueError
            if not (isinstance(found.get("earlier", []), list)
                    and isinstance(found.get("name", ""), str)):
                raise ValueError
        except FileNotFoundError:
            raise StoreError(f"{self.folder}: holds no study; `warpgrasp sweep SPEC.toml -o "
                             f"{self.folder}` makes one") from None
        except OSError as error:
            raise _unreadable(file, error) from None
        except (ValueError, RecursionError):
            raise StoreError(f"{file}: is damaged; remove it and run the sweep again, "
                             "finished units are kept") from None
        return found

    def earlier(self) -> tuple[int, ...]:
        """Numbers of episodes a cell that the study had before it grew."""
        found = self.resolved().get("earlier", ())
        return tuple(count for count in found if isinstance(count, int))

    def path(self, unit: Unit) -> Path:
        """Where a unit's rows are, or will be."""
        return self.units / f"{unit.id}.parquet"

    def unit_ids(self) -> set[str]:
        """Ids of the units that have a file; lists the folder once."""
        return {name.removesuffix(".parquet") for name in
                (os.listdir(self.units) if self.units.is_dir() else ())}

    def files(self, unit: Unit) -> dict[Path, str]:
        """A unit's files, the rows first, and the identity that stands in each."""
        kept = {self.contacts / f"{unit.id}.parquet": contacts_id(unit.id)}
        return {self.path(unit): unit.id} | (kept if unit.cell.keep == "contacts" else {})

    def log(self, unit: Unit) -> Path:
        """Where it is said why a unit was set aside as failed."""
        return self.logs / f"{unit.id}.failed.log"

    def read(self, unit: Unit) -> Columns | None:
        """A unit's rows; None if it is not there; a damaged file is set aside first."""
        return self._read(self.path(unit), unit.id, unit.stop - unit.start)

    def read_contacts(self, unit: Unit) -> Columns | None:
        """A unit's contacts, whether or not the study still keeps any; as `read`."""
        return self._read(self.contacts / f"{unit.id}.parquet", contacts_id(unit.id), None)

    def _read(self, path: Path, identity: str, count: int | None) -> Columns | None:
        try:
            return read_unit(path, identity, count)
        except FileNotFoundError:
            return None
        except DamagedUnit as error:
            self.set_aside(path, str(error))
            return None
        except OSError as error:
            raise _unreadable(path, error) from None

    def contact_types(self, unit: Unit) -> dict[str, Any]:
        """Names and types of the columns of a unit's contacts; none where they are not there."""
        return column_types(self.contacts / f"{unit.id}.parquet")

    def has(self, unit: Unit, verify: bool = False) -> bool:
        """Whether a unit is there, with its contacts if they are kept: by a look at its files'
        ends, or (`verify`) by every row. A damaged file is set aside."""
        if verify:
            return self.read(unit) is not None and (
                unit.cell.keep != "contacts" or self.read_contacts(unit) is not None)
        return all(self._is_whole(*file) for file in self.files(unit).items())

    def _is_whole(self, path: Path, identity: str) -> bool:
        try:
            if looks_whole(path, identity):
                return True
        except FileNotFoundError:
            return False
        except IsADirectoryError:
            pass
        except OSError as error:
            if error.errno != errno.ELOOP:
                raise _unreadable(path, error) from None
        self.set_aside(path, "does not end as a unit file does")
        return False

    def set_aside(self, path: Path, reason: str) -> None:
        """Moves a damaged unit file to the logs, under the name UNIT.damaged; of contacts,
        UNIT.contacts.damaged. Where it cannot be moved, the unit still counts as missing."""
        name = path.stem if path.parent == self.units else contacts_id(path.stem)
        try:
            os.replace(path, self.logs / f"{name}.damaged")
        except OSError:
            self.stuck.add(path)
            return
        self.damaged += 1
        with suppress(OSError):
            write_atomic(self.logs / f"{name}.damaged.log", f"{reason}\n".encode())

    @contextmanager
    def lock(self, shard: tuple[int, int], command: str = "sweep") -> Iterator[None]:
        """Holds a shard for this process and command; makes the directory if need be. `Held` names
        who holds it already."""
        self.refuse_other_files()
        lock = self.folder / f".lock-{shard[0]}-of-{shard[1]}"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise self._unwritable(error) from None
        try:
            try:
                with turn(self.folder):
                    self._hold(descriptor, shard, command)
                    try:
                        sign(descriptor, command)
                    except OSError as error:
                        raise self._unwritable(error) from None
            except OSError as error:
                raise StoreError(f"{lock}: cannot be locked: {error.strerror}; choose a directory "
                                 "on a file system that has flock") from None
            # listed before it is known that nobody else writes: who begins later has none of these
            left = self._all_temporaries()
            if len(self.holders(unknown=True)) == 1:
                for file in left:  # of killed runs
                    file.unlink(missing_ok=True)
            self.held = descriptor, command
            try:
                yield
            except (OSError, StoreError):
                if same_file(descriptor, lock):
                    raise
                raise StoreError(f"{self.folder}: was moved or removed while it was worked on; "
                                 "if it was moved, finished units are there: name its new place "
                                 "with -o to go on", 1) from None
        finally:
            self.held = None
            os.close(descriptor)

    def _hold(self, descriptor: int, shard: tuple[int, int], command: str) -> None:
        """Takes a shard's lock, unless it, or one that has units of it or is of another command,
        is held: a race leaves a note by which its units are read, and a sweep removes it."""
        if not try_lock(descriptor):
            holder, _, _ = signature(os.read(descriptor, 200).decode(errors="replace"))
            raise Held(f"{self.folder}: is being worked on by {holder or 'another run'}; "
                       "wait for it, or give each run its own --shard I/N")
        for name, text in held_locks(self.folder).items():
            holder, _, theirs = signature(text)
            other, _, count = name.partition("-of-")
            if count != str(shard[1]):
                raise Held(f"{self.folder}: shard {other}/{count} is being worked on by "
                           f"{holder or 'another run'}, and has units of shard {shard[0]}/"
                           f"{shard[1]}; wait for it, or give all runs the same N in --shard I/N")
            if other != str(shard[0]) and theirs not in ("", command):
                raise Held(f"{self.folder}: shard {other}/{count} is being worked on by {holder} "
                           f"for a {theirs}; wait for it, or choose another directory")

    def holders(self, unknown: bool = False) -> dict[str, str]:
        """Who works on this directory right now, by shard (`1-of-3`); see `held_locks`."""
        return {shard: signature(text)[0]
                for shard, text in held_locks(self.folder, unknown).items()}

    def note(self, shard: str) -> Path:
        """Where a run of a shard (`1-of-3`) notes how far it is."""
        return self.logs / f"progress-{shard}.json"

    def _all_temporaries(self) -> list[Path]:
        """Those of `write_atomic`; in the study's own folder by the names of its own files."""
        own = [self.folder.glob(f".{name}.{'[0-9a-f]' * 12}.tmp") for name in OWN_FILES]
        return [*chain(self._temporaries(), self.logs.glob(".*.tmp"), *own)]

    def _temporaries(self, of: str = "*") -> Iterator[Path]:
        """Temporary files of units, or of one by its id."""
        return chain(*(folder.glob(f".{of}.parquet.*.tmp")
                       for folder in (self.units, self.contacts)))

    def takes_files(self) -> bool:
        """Whether this process can write what a unit takes, where units are written."""
        probe = self.units / f".probe.parquet.{os.urandom(6).hex()}.tmp"
        try:
            with probe.open("xb") as stream:
                stream.write(bytes(PROBE_BYTES))
                stream.flush()
                os.fsync(stream.fileno())
        except OSError:
            return False
        finally:
            with suppress(OSError):
                probe.unlink(missing_ok=True)
        return True

    def left_behind(self) -> set[str]:
        """Ids of units of which a killed run left temporary files; lists the folder once."""
        return {file.name[1:].partition(".parquet.")[0] for file in self._temporaries()}

    def sweep_out(self, unit: Unit) -> None:
        """Removes temporary files that a killed run left of a unit."""
        for left in self._temporaries(unit.id):
            left.unlink(missing_ok=True)


def open_study(folders: Sequence[Path]) -> tuple[Plan, list[Store]]:
    """The study of one directory, or of several that hold parts of it.

    Raises OtherStudy where they are not of one study, StoreError where one cannot be read.
    """
    stores = [Store(folder) for folder in folders]
    found = [store.resolved() for store in stores]
    for store, resolved in zip(stores, found, strict=True):
        if resolved["hash"] != found[0]["hash"]:
            raise OtherStudy(
                store.folder, differences(found[0]["study"], resolved["study"]),
                "directories named together should hold parts of one study; `warpgrasp compare "
                f"{join((str(folders[0]), str(store.folder)))}` compares two. They differ in:")
    return replace(plan_of(stores[0]), folders=tuple(folders)), stores


def damaged_notes(stores: Sequence[Store]) -> list[str]:
    """What a reader should know of files that turned out to be damaged while they were read, and
    of a study whose growth is not finished."""
    growing = [f"{store.folder}: the study has grown, and not every entry has more episodes yet: "
               "where one has not, those from before count; run the sweep again to go on"
               for store in stores if store.growing]
    stuck = [f"{counted(len(store.stuck), 'damaged file')} cannot be moved to {store.logs}, and "
             "left out" for store in stores if store.stuck]
    return growing + stuck + [
        f"{counted(store.damaged, 'damaged unit')} set aside; see {store.logs}; run the sweep "
        "again to repeat what is missing" for store in stores if store.damaged]


def plan_of(store: Store) -> Plan:
    """The plan that a directory's `resolved.json` holds."""
    resolved = store.resolved()
    try:
        plan = plan_study(study_of(resolved["study"], resolved.get("name", ""),
                                   resolved.get("keep", "nothing")))
    except (AttributeError, LookupError, TypeError, ValueError, ZeroDivisionError):
        plan = None
    if plan is None or plan.hash != resolved["hash"]:
        raise StoreError(f"{store.folder}/resolved.json: was written by another version, or "
                         "altered; run the sweep again in a new directory")
    return plan
