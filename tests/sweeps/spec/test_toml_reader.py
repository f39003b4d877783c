import string
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sweeps.spec.errors import SpecError
from sweeps.spec.toml_reader import DEPTH_LIMIT, SIZE_LIMIT, read_toml


def read(folder: Path, text: str | bytes) -> tuple[dict[str, Any], dict[Any, int]]:
    file = folder / "a.toml"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_toml(file)


def test_every_key_and_entry_has_its_line(tmp_path: Path) -> None:
    _, lines = read(tmp_path, '''\
a = """
two
""""
b = [1,   # one
  'x', { "c.d" = [
    2] }]
[t.u]
"v w".x = 1
[[s]]
n = 1
[[s]]
n = 1979-05-27 07:32:00
[s.deep]
k = 'it'
''')
    assert lines["a",] == 1
    assert lines["b",] == 4
    assert lines["b", 1] == 5
    assert lines["b", 2, "c.d", 0] == 6
    assert lines["t", "u", "v w", "x"] == 8
    assert lines["s", 0, "n"] == 10
    assert lines["s", 1, "n"] == 12
    assert lines["s", 1, "deep", "k"] == 14


KEYS = st.text(string.ascii_letters + "-_.'\" #[=", min_size=1, max_size=6)
SCALARS = st.one_of(st.integers(-99, 99), st.booleans(), st.text(max_size=8))
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3), max_leaves=6)


@settings(max_examples=200,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(KEYS, st.dictionaries(KEYS, VALUES, max_size=3), max_size=4))
def test_lines_agree_with_a_writer_that_knows_them(
        tmp_path: Path, tables: dict[str, dict[str, Any]]) -> None:
    text: list[str] = []
    expected: dict[Any, int] = {}

    def put(line: str) -> int:
        text.append(line)
        return len(text)

    for name, table in tables.items():
        expected[name,] = put(f"[{quoted(name)}] # [not.a.table]")
        for key, value in table.items():
            expected[name, key] = put(f"  {quoted(key)} = {written(value)}  # k = 1")
            put("")
    values, lines = read(tmp_path, "\n".join(text))
    assert values == tables
    assert expected.items() <= lines.items()


def quoted(value: str) -> str:
    return '"' + "".join(c if c.isalnum() and c.isascii() else f"\\U{ord(c):08x}"
                         for c in value) + '"'


def written(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    return quoted(value) if isinstance(value, str) else str(value).lower()


@pytest.mark.parametrize("text", [
    "a = " + "[" * 10_000 + "]" * 10_000,
    "a = " + "{b = " * 10_000 + "1" + "}" * 10_000,
    ".".join("a" * 10_000) + " = 1",
    "[" + ".".join("a" * 10_000) + "]",
    '"a".' * 10_000 + "a = 1",
    "a = {" + "b ." * 10_000 + "b = 1}",
])
def test_deep_nesting_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(SpecError, match=f"deeper than {DEPTH_LIMIT} levels"):
        read(tmp_path, text)


@pytest.mark.parametrize("text", [
    "a = \"" + "\\\"" * 200_000,
    "\"\"\"" * 100_000,
    "'''" + "''a" * 100_000,
    "a" * 500_000,
    "a = " + "1." * 100_000,
    "[" * 20 + "\n" * 500_000,
    "." * 500_000,
    "a ." + " " * 400_000 + "=",
    "\"" * 500_000,
])
def test_hostile_texts_end_soon(tmp_path: Path, text: str) -> None:
    began = time.process_time()
    with pytest.raises(SpecError):
        read(tmp_path, text)
    assert time.process_time() - began < 5.0  # the promise; they take far less


@pytest.mark.parametrize(("text", "says"), [
    (b"a = 1\nb = \xff", ":2: is not UTF-8"),
    ("a = 1\n\nb = ", ":3: is not valid TOML"),
    ("a = 1\na = 2\n", ":2: is not valid TOML"),
    (b"a" * (SIZE_LIMIT + 1), "larger than 1 MiB"),
])
def test_what_is_not_toml_is_told_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(SpecError, match=says):
        read(tmp_path, text)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"nothing\.toml:1: cannot be read: No such file"):
        read_toml(tmp_path / "nothing.toml")
