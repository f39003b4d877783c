"""The command line's app, the checks of its arguments, and the exit codes."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter


def _version() -> str:
    from importlib.metadata import version  # heavy, and only --version needs it

    return version("warpgrasp")


app = App(name="warpgrasp", help="Batched simulation of robots that learn shape by touch. "
          "Every command takes --quiet: no progress and no notes, only errors.",
          version=_version, version_flags=["--version"], help_format="plaintext",
          suppress_keyboard_interrupt=False)
Folders = Annotated[list[Path], Parameter(name="DIR...")]
Json = Annotated[bool, Parameter(negative="")]
Force = Annotated[bool, Parameter(negative="")]
Settings = Annotated[list[str] | None, Parameter(name="--set", negative="")]


class UsageError(ValueError):
    """An argument that cannot be used."""


def folders_and_kind(words: Sequence[str | Path], kinds: Iterable[str]) -> tuple[list[Path], str]:
    """The words DIR... KIND as directories and a kind."""
    from sweeps.spec.errors import choose

    kind = str(words[-1])
    if kind not in kinds:
        early = next((str(word) for word in words if str(word) in kinds), None)
        raise UsageError(f"KIND: is {kind!r}; " + (
            f"{early} should stand last, after the directories" if early
            else choose(kind, kinds)))
    if len(words) < 2:
        raise UsageError("DIR: is missing; name the directory of a study before the kind")
    return [Path(word) for word in words[:-1]], kind


def refuse_idle(kind: str, options: Mapping[str, tuple[object, Sequence[str]]]) -> None:
    """Refuses an option that was given and says nothing of a kind: each has its value, None where
    it was not given, and the kinds that it is for."""
    for name, (value, kinds) in options.items():
        if value is not None and kind not in kinds:
            raise UsageError(f"{name}: says nothing of {kind}; is for {', '.join(kinds)}")


def refuse_existing(file: Path, force: bool) -> None:
    """Refuses to write over a file of the user's, unless that is asked for."""
    if file.exists() and not force:
        from sweeps.spec.errors import StoreError

        raise StoreError(f"{file}: exists already; choose another name, or use --force")


def named_numbers(option: str, words: Iterable[str], example: str) -> dict[str, float]:
    """NAME=NUMBER as numbers by name."""
    found = {}
    for word in words:
        name, _, number = word.rpartition("=")
        if name in found:
            raise UsageError(f"{option}: {name} twice; should be held at one place")
        try:
            found[name] = float(number)
        except ValueError:
            found[name] = math.nan
        if not name or not math.isfinite(found[name]):
            raise UsageError(f"{option}: is {word!r}; should be NAME=NUMBER, as {example}")
    return found


def count_of(value: int, name: str) -> int:
    """A number of things, such as workers: 1 to 4096."""
    if not 1 <= value <= 4096:
        raise UsageError(f"{name}: is {value}; should be a whole number from 1 to 4096")
    return value


def port_of(value: int) -> int:
    """The port of a page: 0, one that is free, to 65535."""
    if not 0 <= value <= 65535:
        raise UsageError(f"--port: is {value}; should be a whole number from 0 to 65535")
    return value


def cores_of(workers: int | None, engine: str, address: str | None) -> int:
    """Worker processes: 1 if not given; a cluster that is named has cores of its own."""
    if address is not None and engine != "ray":
        raise UsageError("--address: is for --engine ray")
    if workers is not None and address is not None:
        raise UsageError("--workers: is of this machine; leave it or --address, of a cluster, out")
    return count_of(1 if workers is None else workers, "--workers")


def timeout_of(value: float) -> float:
    """Seconds that a unit may take."""
    if not 1 <= value <= 1e9:
        raise UsageError(f"--unit-timeout-s: is {value:g}; should be a number from 1 to 1e9")
    return value


def shard_of(text: str) -> tuple[int, int]:
    """I/N as two numbers."""
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise UsageError(f"--shard: is {text!r}; should be I/N with I from 1 to N, such as 2/8")
    return int(match[1]), int(match[2])


def device_of(text: str, *, here: bool = True) -> str:
    """A device's name as Warp knows it; one of this machine, where it is used `here`."""
    if not re.fullmatch(r"cpu|cuda(:\d{1,2})?", text):
        raise UsageError(f"--device: is {text!r}; should be cpu or cuda:0")
    device = "cuda:0" if text == "cuda" else text
    if here and device != "cpu":
        from sweeps.output import devices

        if device not in (found := devices()):
            raise UsageError(f"--device: there is no {device} here; there are: {', '.join(found)}")
    return device


DONE = 0
SOME_FAILED = 1
"""Something that was asked for could not be done; the rest was."""
BAD_USAGE = 2
OTHER_SPEC = 3
"""The folder holds another study."""
INTERRUPTED = 130
