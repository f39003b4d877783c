"""Arguments that more than their type must be right: a usable value comes back, or UsageError."""

import re
from collections.abc import Iterable
from pathlib import Path

from sweeps.cli_app import UsageError


def folders_and_kind(words: list[str], kinds: Iterable[str]) -> tuple[list[Path], str]:
    """The words DIR... KIND as directories and a kind."""
    from sweeps.problems import choose

    if words[-1] not in kinds:
        raise UsageError(f"KIND: is {words[-1]!r}; {choose(words[-1], kinds)}")
    if len(words) < 2:
        raise UsageError("DIR: is missing; name the directory of a study before the kind")
    return [Path(word) for word in words[:-1]], words[-1]


def count_of(value: int, name: str) -> int:
    """A number of things, such as workers: 1 to 4096."""
    if not 1 <= value <= 4096:
        raise UsageError(f"{name}: is {value}; should be a whole number from 1 to 4096")
    return value


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


def device_of(text: str) -> str:
    """A device's name as Warp knows it."""
    if not re.fullmatch(r"cpu|cuda(:\d{1,2})?", text):
        raise UsageError(f"--device: is {text!r}; should be cpu or cuda:0")
    return "cuda:0" if text == "cuda" else text
