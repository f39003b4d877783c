"""The one way kernels are launched: named arguments, checked shapes, slices over the cores.

Warp runs a CPU launch on one thread and does not check array shapes; a wrong one corrupts memory.
Here every array argument states its shape in words ("world probe 4"), the words are bound to the
launch's extents, and on a CPU the first axis is cut into slices that threads run side by side (a
launch releases the interpreter lock). Results do not depend on the slicing: no kernel writes
outside its own row, and rows are numbered from `first`, which every kernel takes as its first
argument because `wp.tid()` restarts at zero in each slice.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import warp as wp

wp.config.log_level = wp.LOG_ERROR  # banners are not results

_SMALLEST_SLICE = 512  # threads; below, starting a Python thread costs more than it saves
_pool: ThreadPoolExecutor | None = None
_thread_count = max(1, int(os.environ.get("WARPGRASP_THREADS", os.cpu_count() or 1)))


class ShapeError(ValueError):
    """An array of the wrong shape, type or device was handed to a kernel."""


def set_thread_count(count: int) -> None:
    """How many threads a CPU launch may use; sweeps' workers use one each."""
    global _pool, _thread_count
    if count < 1:
        raise ValueError(f"thread count {count}: at least 1")
    _thread_count = count
    if _pool is not None:
        _pool.shutdown()
        _pool = None


def launch(
    kernel: wp.Kernel,
    extents: Mapping[str, int],
    shapes: Mapping[str, str],
    arguments: Mapping[str, Any],
    *,
    device: str,
) -> None:
    """Run `kernel` over the product of `extents` (first axis sliced over the cores on a CPU).

    `shapes` gives each array argument's shape in words: a name of `extents` or any other name
    (bound at first sight, then held), a number, or `name?` for an axis that may also be 1 (shared
    by all). Raises ShapeError naming the argument, what it is and what it should be.
    """
    bound = dict(extents)
    ordered: list[Any] = []
    for argument in kernel.adj.args[1:]:
        if argument.label not in arguments:
            raise ShapeError(f"{kernel.key}: argument {argument.label!r} is missing")
        value = arguments[argument.label]
        if isinstance(value, wp.array):
            _check_shape(kernel.key, argument.label, value, shapes.get(argument.label), bound)
            if str(value.device) != str(wp.get_device(device)):
                raise ShapeError(f"{kernel.key}: {argument.label!r} is on {value.device}, "
                                 f"the launch on {device}")
        ordered.append(value)
    unknown = set(arguments) - {argument.label for argument in kernel.adj.args}
    if unknown:
        raise ShapeError(f"{kernel.key}: no argument {sorted(unknown)}")
    _run(kernel, tuple(extents.values()), ordered, device)


def _check_shape(
    kernel: str, label: str, array: wp.array, words: str | None, bound: dict[str, int]
) -> None:
    if words is None:
        raise ShapeError(f"{kernel}: no shape stated for array {label!r}")
    axes = words.split()
    right = len(axes) == len(array.shape)
    for axis, size in zip(axes, array.shape, strict=False):
        if axis.isdigit():
            right &= size == int(axis)
        elif axis.endswith("?"):
            right &= size in (1, bound.setdefault(axis[:-1], size))
        else:
            right &= size == bound.setdefault(axis, size)
    if not right:
        wanted = ", ".join(f"{a}={bound[a.rstrip('?')]}" if a.rstrip("?") in bound else a
                           for a in axes)
        raise ShapeError(f"{kernel}: {label!r} has shape {tuple(array.shape)}, wants ({wanted})")


def _run(kernel: wp.Kernel, dim: tuple[int, ...], ordered: list[Any], device: str) -> None:
    global _pool
    rows = dim[0]
    total = 1
    for extent in dim:
        total *= extent
    if total == 0:
        return
    # More slices than threads: rows differ in cost, and a thread that is done takes the next.
    slices = min(4 * _thread_count, rows, total // _SMALLEST_SLICE)
    if _thread_count == 1 or slices < 2 or not wp.get_device(device).is_cpu:
        wp.launch(kernel, dim=dim, inputs=[0, *ordered], device=device)
        return
    kernel.module.load(wp.get_device(device), 1)  # once, before the threads race for it
    if _pool is None:
        _pool = ThreadPoolExecutor(_thread_count, thread_name_prefix="warpgrasp")
    cuts = [rows * k // slices for k in range(slices + 1)]
    jobs = [
        _pool.submit(wp.launch, kernel, dim=(stop - start, *dim[1:]), inputs=[start, *ordered],
                     device=device)
        for start, stop in pairwise(cuts)
    ]
    for job in jobs:
        job.result()
