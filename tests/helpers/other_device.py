"""A second device whose memory and processor are the CPU's: what would be on a wrong device on a
machine with a GPU is refused here too.

Warp compares devices where arrays meet kernels. This one differs from the CPU in name only, so
kernels run as ever, but its arrays are not the CPU's. It reaches into Warp's registry of devices.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp
from warp._src import context

NAME = "cuda:0"


class OtherDevice(context.Device):
    """Equal to itself alone; Warp's own equality is of CUDA contexts, which CPUs have none of."""

    def __eq__(self, other: object) -> bool:
        return other is self

    def __ne__(self, other: object) -> bool:
        return other is not self

    __hash__ = object.__hash__


@lru_cache(maxsize=1)
def _device() -> OtherDevice:
    """One for all tests: arrays on it are kept, by its name, from one to the next."""
    wp.init()
    return OtherDevice(context.runtime, NAME)


@contextmanager
def other_device() -> Iterator[str]:
    """Its name, for as long as it is there."""
    there, copy = _device(), wp.copy
    known: dict[Any, Any] = context.runtime.device_map
    if NAME in known:
        pytest.skip("this machine has a GPU, which sweeps.bench.device_agreement compares with")

    def copied(dest, source, dest_offset=0, src_offset=0, count=0, stream=None):
        """Between devices Warp asks whether a stream is recorded; CPUs have no streams."""
        none = SimpleNamespace(is_capturing=False, device=None)
        return copy(dest, source, dest_offset, src_offset, count, stream or none)

    known |= {NAME: there, there: there}
    wp.copy = copied
    try:
        yield NAME
    finally:
        wp.copy = copy
        del known[NAME], known[there]
