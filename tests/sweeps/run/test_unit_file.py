import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sweeps.run.unit_file import DamagedUnit, encode_unit, read_unit, write_unit

ROWS = {
    "episode": np.arange(5),
    "status": np.array(["ok", "", "ok", "fit_failed", "ö"]),
    "iou": np.array([0.5, np.nan, np.inf, -0.0, 1e-300]),
    "good": np.array([True, False, True, True, False]),
    "small": np.arange(5, dtype=np.float32),
}


def test_rows_come_back_to_the_bit(tmp_path: Path) -> None:
    file = tmp_path / "a.parquet"
    write_unit(file, "a", ROWS)
    found = read_unit(file, "a", 5)
    assert list(found) == list(ROWS)
    for name, values in ROWS.items():
        if values.dtype.kind == "U":
            assert found[name].tolist() == values.tolist()
        else:
            assert found[name].dtype == values.dtype
            assert found[name].tobytes() == values.tobytes()
    assert [p.name for p in tmp_path.iterdir()] == ["a.parquet"]


def test_the_same_rows_give_the_same_bytes() -> None:
    assert encode_unit("a", ROWS) == encode_unit("a", dict(ROWS))


WHOLE = encode_unit("a", ROWS)


@settings(max_examples=300,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, len(WHOLE) - 1), bit=st.integers(0, 7), cut=st.booleans())
def test_no_damage_goes_unseen(tmp_path: Path, at: int, bit: int, cut: bool) -> None:
    """A flipped bit or a lost tail: refused, or without any effect on the rows."""
    file = tmp_path / "a.parquet"
    damaged = bytearray(WHOLE)
    if cut:
        del damaged[at:]
    else:
        damaged[at] ^= 1 << bit
    file.write_bytes(damaged)
    try:
        found = read_unit(file, "a", 5)
    except DamagedUnit:
        return
    for name, values in ROWS.items():
        assert found[name].tolist().__repr__() == values.tolist().__repr__()


def test_another_unit_under_this_name_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.parquet"
    write_unit(file, "b", ROWS)
    with pytest.raises(DamagedUnit, match="another unit"):
        read_unit(file, "a")
    with pytest.raises(DamagedUnit, match="does not hold 6 rows"):
        read_unit(file, "b", 6)


def test_what_is_no_plain_file_is_damaged(tmp_path: Path) -> None:
    """A pipe was waited for."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "loop", "folder"):
        with pytest.raises(DamagedUnit):
            read_unit(tmp_path / name, "one", 6)


@pytest.mark.parametrize("rows", [
    {"a": np.arange(3), "b": np.arange(4)}, {"a": np.zeros((2, 2))}, {"a": np.array([1j])}])
def test_rows_that_are_no_table_are_refused(rows: dict[str, np.ndarray]) -> None:
    with pytest.raises(ValueError, match="of a unit should"):
        encode_unit("a", rows)


def test_curves_come_back_to_the_bit_and_a_changed_one_is_noticed(tmp_path: Path) -> None:
    curves = np.empty(3, object)
    curves[:] = [np.array([1.0, np.nan, 0.1]), np.zeros(0), np.array([1e-300])]
    file = tmp_path / "a.parquet"
    write_unit(file, "a", {"episode": np.arange(3), "curve": curves})
    found = read_unit(file, "a", 3)["curve"]
    assert [row.tobytes() for row in found] == [row.tobytes() for row in curves]
    other = curves.copy()
    other[2] = np.array([2e-300])
    assert encode_unit("a", {"curve": curves}) != encode_unit("a", {"curve": other})
    bad = curves.copy()
    bad[1] = np.zeros((2, 2))
    with pytest.raises(ValueError, match="1-D arrays of float64"):
        encode_unit("a", {"curve": bad})
