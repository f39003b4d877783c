"""Slimmed programs: shorter, the same answers, and kept whole wherever something is in doubt."""

import pickle
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental import serialize_executable

from fit import batch, program_cache, program_slim
from fit.batch import Program, map_lanes
from fit.program_slim import slim_program

LANES = np.random.default_rng(5).normal(size=(3, 40, 8))


def many_kernels(a):
    """Loops, a product of matrices and a factor, as programs of fits have them."""
    for k in range(1, 40):
        a = jnp.sin(a * k) + jnp.exp(-jnp.cumsum(a, axis=0) ** 2 / k)
    square = a.T @ a + jnp.eye(8)
    factor = jnp.linalg.cholesky(square)
    return jax.lax.fori_loop(0, 5, lambda k, x: jnp.tanh(x @ square) + jnp.log1p(k * x**2), factor)


@pytest.fixture(scope="module")
def compiled():
    with jax.enable_x64(True):
        return jax.jit(jax.vmap(many_kernels)).lower(LANES).compile()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(program_cache, "_folder", lambda: tmp_path)
    return tmp_path


def kept(folder: Path) -> int:
    """Bytes of the one program kept."""
    file, = folder.iterdir()
    return file.stat().st_size


def test_a_slimmed_program_is_shorter_and_says_the_same(compiled) -> None:
    payload, given, result = serialize_executable.serialize(compiled)
    slimmed = slim_program(payload)
    assert len(slimmed) < 0.85 * len(payload)
    with jax.enable_x64(True):
        loaded = serialize_executable.deserialize_and_load(slimmed, given, result)
        left, whole = (str(program.as_text()).count("\n") for program in (loaded, compiled))
        assert left < 0.6 * whole
        assert np.array_equal(loaded(LANES), compiled(LANES))
    assert slim_program(slimmed) == slimmed


def test_programs_of_another_jaxlib_are_left_as_they_are(
    compiled, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_slim, "CHECKED", ("0.0.1",))
    payload = serialize_executable.serialize(compiled)[0]
    assert slim_program(payload) == payload


@pytest.mark.parametrize("wrong", [
    pytest.param(b"\x0f", id="no such kind of field"),
    pytest.param(b"\x1a\x7f", id="longer than all there is"),
    pytest.param(b"\x08\x80\x80", id="a number without an end"),
    pytest.param(b"\xff" * 12, id="a number of more than 64 bits"),
])
def test_what_is_no_program_is_an_error(wrong: bytes) -> None:
    header, field = b"\x00", b"\x1a\xac\x02" + bytes(300)
    assert slim_program(pickle.dumps(header + field))
    with pytest.raises(ValueError, match="no protobuf"):
        slim_program(pickle.dumps(header + field + wrong))


def other_answer(payload: bytes) -> bytes:
    with jax.enable_x64(True):
        other = jax.jit(lambda groups, lanes: jax.tree.map(lambda x: 2.0 * x, lanes))
        return serialize_executable.serialize(
            other.lower(np.int64(1), np.zeros((batch.LANES, 3))).compile())[0]


def refused(payload: bytes) -> bytes:
    raise ValueError("no protobuf")


@pytest.mark.parametrize("slim", [other_answer, refused, lambda payload: payload[:-100]])
def test_where_slimming_fails_the_whole_is_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch, slim
) -> None:
    twice = Program(f"twice {slim}", jax.vmap(lambda x: x + x * x))
    lanes = np.arange(6.0).reshape(2, 3)
    monkeypatch.setattr(program_cache, "slim_program", slim)
    made = map_lanes(twice, lanes)
    monkeypatch.setattr(program_cache, "slim_program", bytes)
    whole = kept(folder)
    batch._programs.clear()
    folder_file, = folder.iterdir()
    assert np.array_equal(map_lanes(Program(twice.name, refused), lanes), made)
    folder_file.unlink()
    batch._programs.clear()
    map_lanes(twice, lanes)
    assert kept(folder) == whole
