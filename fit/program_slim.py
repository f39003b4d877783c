"""Kept programs without what runs never look at: loading one is mostly XLA reading that back.

A serialized program holds its machine code and, beside it, all instructions it was compiled from,
and each of some thousands takes XLA 30 µs to read. Most stand inside loop fusions: kernels by now,
known by name. So such a fusion becomes a nameless call of the same shape, and where instructions
came from in Python is left out. What buffers are assigned to, all other instructions (calls of
libraries are made from theirs at run time) and the code stay. XLA's messages (openxla/xla:
hlo.proto, executable.proto) are read as protobuf writes them.
"""

from __future__ import annotations

import pickletools
from collections.abc import Callable, Iterator
from importlib.metadata import version

CHECKED = ("0.10.2",)
"""Versions of jaxlib whose programs were slimmed and seen to run; others' are kept whole."""

# Numbers of fields.
_EXECUTABLE, _MODULE_CONFIGURED, _MODULE = 1, 1, 1  # each within the one before
_COMPUTATIONS, _STACK_FRAMES = 3, 17  # HloModuleProto
_INSTRUCTIONS, _COMPUTATION_ID = 2, 5  # HloComputationProto
_OPCODE, _METADATA, _FUSION_KIND, _TARGET, _CALLED = 2, 7, 11, 28, 38  # HloInstructionProto
_FRAMELESS = 1 << 16  # pickled bytes so long stand by themselves, so their length may change


def slim_program(payload: bytes) -> bytes:
    """What `jax.experimental.serialize_executable.serialize` gave, in the same form but shorter.

    Raises ValueError for what is not written as expected. It is as it was where jaxlib is another.
    """
    if version("jaxlib") not in CHECKED:
        return payload
    program, begin = max(
        ((argument, place or 0) for opcode, argument, place in pickletools.genops(payload)
         if opcode.name == "BINBYTES" and argument), key=lambda found: len(found[0]))
    slimmed = _slim_executable(program)
    if len(slimmed) < _FRAMELESS:
        return payload  # small programs load fast enough
    written = b"B" + len(slimmed).to_bytes(4, "little") + slimmed
    end = begin + len(written) - len(slimmed) + len(program)
    return payload[:begin] + written + payload[end:]


def _slim_executable(program: bytes) -> bytes:
    """The module lies in the executable, that in what holds its options too, behind a header."""
    length, begin = _varint(program, 0)
    path = (_EXECUTABLE, _MODULE_CONFIGURED, _MODULE)
    return program[: begin + length] + _within(program[begin + length :], path, _slim_module)


def _slim_module(module: bytes) -> bytes:
    loops = {called for computation in _messages(module, _COMPUTATIONS)
             for instruction in _messages(computation, _INSTRUCTIONS) if _is_loop(instruction)
             for called in _numbers(instruction, _CALLED)}
    out = []
    for field, value, raw in _fields(module):
        if field == _COMPUTATIONS and isinstance(value, bytes):
            (own,) = _numbers(value, _COMPUTATION_ID)
            raw = b"" if own in loops else _message(
                field, _within(value, (_INSTRUCTIONS,), _slim_instruction))
        if field != _STACK_FRAMES:
            out.append(raw)
    return b"".join(out)


def _is_loop(instruction: bytes) -> bool:
    return _messages(instruction, _FUSION_KIND) == [b"kLoop"]


def _slim_instruction(instruction: bytes) -> bytes:
    """One that does not say what line of Python it came from; a loop becomes a nameless call."""
    called = _is_loop(instruction)
    left_out = (_METADATA, *((_OPCODE, _FUSION_KIND, _CALLED) if called else ()))
    kept = [raw for field, _, raw in _fields(instruction) if field not in left_out]
    if called:
        kept += [_message(_OPCODE, b"custom-call"), _message(_TARGET, b"none")]
    return b"".join(kept)


def _within(message: bytes, path: tuple[int, ...], change: Callable[[bytes], bytes]) -> bytes:
    """`message` with the messages at `path` changed."""
    if not path:
        return change(message)
    return b"".join(
        _message(field, _within(value, path[1:], change))
        if field == path[0] and isinstance(value, bytes) else raw
        for field, value, raw in _fields(message))


def _messages(message: bytes, field: int) -> list[bytes]:
    """The messages, or texts, of one field."""
    return [value for number, value, _ in _fields(message)
            if number == field and isinstance(value, bytes)]


def _numbers(message: bytes, field: int) -> list[int]:
    """The numbers of one field, each by itself or packed as bytes."""
    found: list[int] = []
    for number, value, _ in _fields(message):
        if number != field:
            continue
        if isinstance(value, int):
            found.append(value)
            continue
        at = 0
        while at < len(value):
            one, at = _varint(value, at)
            found.append(one)
    return found


def _fields(message: bytes) -> Iterator[tuple[int, int | bytes, bytes]]:
    """Number, value and bytes of each field."""
    at = 0
    while at < len(message):
        begin = at
        tag, at = _varint(message, at)
        field, kind = tag >> 3, tag & 7
        if kind == 0:
            value, at = _varint(message, at)
        elif kind in (1, 2, 5):
            length, at = _varint(message, at) if kind == 2 else ((8, 4)[kind == 5], at)
            value, at = message[at : at + length], at + length
        else:
            raise ValueError(f"no protobuf: field {field} of kind {kind} at byte {begin}")
        if at > len(message):
            raise ValueError(f"no protobuf: field {field} ends behind the last byte")
        yield field, value, message[begin:at]


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """A number written in sevens of bits, at most 64 of them, and where it ends."""
    number = 0
    for shift, byte in zip(range(0, 64, 7), message[at : at + 10], strict=False):
        number |= (byte & 127) << shift
        if byte < 128:
            return number, at + shift // 7 + 1
    raise ValueError(f"no protobuf: no number at byte {at}")


def _message(field: int, content: bytes) -> bytes:
    """A field that holds bytes."""
    return _number(field << 3 | 2) + _number(len(content)) + content


def _number(number: int) -> bytes:
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])
