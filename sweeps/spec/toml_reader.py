"""Reading TOML together with the line of every key, in bounded time and memory.

The values come from the standard library's parser; a second, lenient walk over a text that is
already known to be valid notes where each key and each array entry stands.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

from sweeps.spec.errors import KeyPath, Problem, SpecError

SIZE_LIMIT = 1 << 20  # bytes
DEPTH_LIMIT = 32  # nested brackets, or parts of one dotted key
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
# Closing quotes are optional, so that a hostile text cannot make the search start over and over.
_STRING = re.compile(r'"""(?:[^"\\]|\\.|"{1,2}(?!"))*(?:"{3,5})?'
                     r"|'''(?:[^']|'{1,2}(?!'))*(?:'{3,5})?"
                     r'|"(?:[^"\\\n]|\\.)*"?' r"|'[^'\n]*'?", re.DOTALL)
_STRING_OR_COMMENT = re.compile(_STRING.pattern + r"|#[^\n]*", re.DOTALL)
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEPTH_LIMIT},}}")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^\[\]{},#\n]+")


def read_toml(file: Path) -> tuple[dict[str, Any], dict[KeyPath, int]]:
    """The values of a TOML file and the line of every key; `SpecError` where it is not TOML."""
    return parse_toml(file, read_content(file))


def read_content(file: Path) -> bytes:
    """The bytes of a spec, one more than SIZE_LIMIT at most; `SpecError` where it cannot be read.
    """
    try:
        with file.open("rb") as stream:
            return stream.read(SIZE_LIMIT + 1)
    except OSError as error:
        raise SpecError([Problem(
            f"{file}:1", "", f"cannot be read: {error.strerror}; a spec is a TOML file, "
            "`warpgrasp init SPEC.toml` writes one")]) from None


def parse_toml(file: Path, raw: bytes) -> tuple[dict[str, Any], dict[KeyPath, int]]:
    """As `read_toml`, of what was read of the file."""
    def fail(what: str, line: int = 1) -> SpecError:
        return SpecError([Problem(f"{file}:{line}", "", what)])

    if len(raw) > SIZE_LIMIT:
        raise fail(f"is larger than {SIZE_LIMIT >> 20} MiB, the limit for a spec")
    try:
        text = raw.decode().removeprefix("\ufeff").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise fail("is not UTF-8 text", raw[:error.start].count(b"\n") + 1) from None
    if line := _too_deep(text):
        raise fail(f"nests deeper than {DEPTH_LIMIT} levels, the limit for a spec", line)
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        at = re.search(r"\(at line (\d+)", str(error))
        raise fail(f"is not valid TOML: {error}"[:300],
                   int(at[1]) if at else text.count("\n") + 1) from None
    return values, _Walk(text).lines()


def _too_deep(text: str) -> int | None:
    """The line where nesting passes the limit, before any recursive parser sees the text."""
    bare = _STRING_OR_COMMENT.sub(lambda found: "\n" * found[0].count("\n") or "_", text)
    depth = 0
    for number, line in enumerate(bare.split("\n"), 1):
        if _LONG_KEY.search(line):
            return number
        for char in line:
            if char in "[{":
                depth += 1
            elif char in "]}":
                depth = max(0, depth - 1)
            if depth > DEPTH_LIMIT:
                return number
    return None


class _Walk:
    """One pass over valid TOML; `found` maps the path of each key or entry to its line."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line = 1
        self.counted = 0
        self.found: dict[KeyPath, int] = {(): 1}
        self.counts: dict[KeyPath, int] = {}  # entries so far of each [[array of tables]]

    def lines(self) -> dict[KeyPath, int]:
        table: KeyPath = ()
        while self._blank() < len(self.text):
            if self.text[self.at] == "[":
                array = self.text.startswith("[[", self.at)
                self.at += 1 + array
                table = self._table(self._key(), array)
                self.at += 1 + array
            else:
                self._pair(table)
        return self.found

    def _note(self, path: KeyPath) -> None:
        self.line += self.text.count("\n", self.counted, self.at)
        self.counted = self.at
        for n in range(1, len(path) + 1):
            self.found.setdefault(path[:n], self.line)

    def _table(self, keys: list[str], array: bool) -> KeyPath:
        path: KeyPath = ()
        for n, key in enumerate(keys):
            path += (key,)
            if array and n == len(keys) - 1:
                self.counts[path] = self.counts.get(path, 0) + 1
            if path in self.counts:
                path += (self.counts[path] - 1,)
        self._note(path)
        return path

    def _pair(self, table: KeyPath) -> None:
        start = self.at
        path = (*table, *self._key())
        end, self.at = self.at, start
        self._note(path)
        self.at = end + 1  # past "="
        self._value(path)

    def _value(self, path: KeyPath) -> None:
        self._blank()
        opening = self.text[self.at]
        if opening in "\"'":
            self.at = _end(_STRING, self.text, self.at)
        elif opening in "[{":
            self.at += 1
            count = 0
            while self.text[self._blank()] not in "]}":
                if self.text[self.at] == ",":
                    self.at += 1
                elif opening == "[":
                    self._note((*path, count))
                    self._value((*path, count))
                    count += 1
                else:
                    self._pair(path)
            self.at += 1
        else:
            self.at = _end(_SCALAR, self.text, self.at)

    def _key(self) -> list[str]:
        parts: list[str] = []
        while True:
            self._blank()
            quoted = self.text[self.at] in "\"'"
            end = _end(_STRING if quoted else _BARE_KEY, self.text, self.at)
            part = self.text[self.at:end]
            parts.append(tomllib.loads(f"x={part}")["x"] if quoted else part)
            self.at = end
            if self.text[self._blank()] != ".":
                return parts
            self.at += 1

    def _blank(self) -> int:
        self.at = _end(_BLANK, self.text, self.at)
        return self.at


def _end(pattern: re.Pattern[str], text: str, at: int) -> int:
    found = pattern.match(text, at)
    return found.end() if found else at
