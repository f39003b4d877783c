"""The one way kernels are launched: named arguments, checked shapes, slices over the cores.

Warp runs a CPU launch on one thread and does not check array shapes; a wrong one corrupts memory.
Here every array argument states its shape in words ("world probe 4"), the words are bound to the
launch's extents, and on a CPU the first axis is cut into slices that threads run side by side (a
launch releases the interpreter lock). Results do not depend on the slicing: no kernel writes
outside its own row, and rows are numbered from `first`, which every kernel takes as its first
argument because `wp.tid()` restarts at zero in each slice.
"""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from math import prod
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.core.array_checks import check_poses
from warpgrasp.core.cores import thread_count
from warpgrasp.core.dtypes import transform
from warpgrasp.core.kernel_cache import check_kernels, place_kernels, seal_kernels

wp.config.log_level = wp.LOG_ERROR  # banners are not results
place_kernels()
_SMALLEST_SLICE = 512  # rows; below, starting a Python thread costs more than it saves
_SMALLEST_HEAVY = 16  # of rows that take some 10 microseconds each, as a closing
_SLICES = 16  # for each thread
GPU_BLOCK = 64
"""Threads of a block on a GPU. Rows differ in cost, and a block holds its place until its last row
is done."""
_pool: ThreadPoolExecutor | None = None
_thread_count = thread_count()
_launched: set[str] = set()
"""Modules whose compiled kernels have been checked and loaded in this process."""


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


def check_device(device: str) -> None:
    """Raise ValueError for what is no device of this machine."""
    try:
        wp.get_device(device)
    except (ValueError, RuntimeError):
        here = ", ".join(str(each) for each in wp.get_devices())
        raise ValueError(f"device: there is no {device!r} here; there are: {here}") from None


def array_of(values: np.ndarray, dtype: Any, device: str) -> wp.array:
    """An array for kernels to read. On a CPU it is NumPy's own memory where types agree: a copy
    takes Warp four times as long. Raises ShapeError for rows that are none of `dtype`."""
    values = np.ascontiguousarray(values)
    inner = getattr(dtype, "_shape_", ())  # Warp would cut numbers in a row into vectors anyhow
    if inner and values.shape[-len(inner):] != inner:
        raise ShapeError(f"an array of shape {values.shape}; should end with {inner}, as "
                         f"{dtype.__name__} does")
    return wp.array(values, dtype=dtype, device=device, copy=False)


def poses_of(
    name: str, poses: np.ndarray, device: str, counts: np.ndarray | None = None
) -> wp.array:
    """`array_of` poses (world, ..., 7), which `check_poses` checks where `counts` (world, ...), if
    given, has their shape: of another one `launch` tells. Raises ShapeError and ValueError."""
    there = array_of(poses, transform, device)
    if counts is None or counts.shape == there.shape:
        check_poses(name, np.asarray(poses), counts)
    return there


def launch(
    kernel: Any,
    extents: Mapping[str, int],
    shapes: Mapping[str, str],
    arguments: Mapping[str, Any],
    *,
    device: str,
    heavy: bool = False,
) -> None:
    """Run `kernel` over the product of `extents` (first axis sliced over the cores on a CPU).

    `shapes` gives each array argument's shape in words: a name of `extents` or any other name
    (bound at first sight, then held), a number, or `name?` for an axis that may also be 1 (shared
    by all). Of a `heavy` kernel, whose rows take microseconds, few are worth a thread. Raises
    ShapeError naming the argument, what it is and what it should be.
    """
    launch_in_turn(extents, [(kernel, shapes, arguments)], device=device, heavy=heavy)


def launch_in_turn(
    extents: Mapping[str, int],
    steps: Sequence[tuple[Any, Mapping[str, str], Mapping[str, Any]]],
    *,
    device: str,
    heavy: bool = False,
) -> None:
    """`launch` several kernels, each step (kernel, shapes, arguments) after the one before it.

    Only rows wait for themselves: threads that share a CPU take a slice through all steps.
    """
    checked = [(kernel, _checked(kernel, extents, shapes, arguments, device))
               for kernel, shapes, arguments in steps]
    if prod(extents.values()) == 0:
        return
    new = {kernel.module.name for kernel, _ in checked} - _launched
    for module in sorted(new):
        check_kernels(module)
    _run(checked, tuple(extents.values()), device, heavy)
    for module in sorted(new):
        seal_kernels(module)
    _launched.update(new)


def _checked(
    kernel: Any, extents: Mapping[str, int], shapes: Mapping[str, str],
    arguments: Mapping[str, Any], device: str,
) -> list[Any]:
    """The arguments in the kernel's order."""
    bound = dict(extents)
    there = wp.get_device(device)
    ordered: list[Any] = []
    for argument in kernel.adj.args[1:]:
        if argument.label not in arguments:
            raise ShapeError(f"{kernel.key}: argument {argument.label!r} is missing")
        value = arguments[argument.label]
        if isinstance(value, wp.array):
            _check_shape(kernel.key, argument.label, value, shapes.get(argument.label), bound)
            if value.device != there:
                raise _elsewhere(kernel.key, argument.label, value.device, device)
        elif argument.label in shapes:  # Warp takes None for an array at no address
            raise ShapeError(f"{kernel.key}: {argument.label!r} is {type(value).__name__}, "
                             "wants an array")
        elif "device" in getattr(value, "__dict__", ()) and value.device != there:
            # A struct of addresses, as a scene. Numbers of NumPy have a device too: not in a dict.
            raise _elsewhere(kernel.key, argument.label, value.device, device)
        ordered.append(value)
    unknown = set(arguments) - {argument.label for argument in kernel.adj.args}
    if unknown:
        raise ShapeError(f"{kernel.key}: no argument {sorted(unknown)}")
    return ordered


def _elsewhere(kernel: str, label: str, found: Any, device: str) -> ShapeError:
    return ShapeError(f"{kernel}: {label!r} is on {found}, the launch on {device}")


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


def _run(
    steps: Sequence[tuple[Any, list[Any]]], dim: tuple[int, ...], device: str, heavy: bool
) -> None:
    global _pool
    rows, total = dim[0], prod(dim)
    # More slices than threads: rows differ in cost, and a thread that is done takes the next.
    slices = min(_SLICES * _thread_count, rows,
                 total // (_SMALLEST_HEAVY if heavy else _SMALLEST_SLICE))
    on_cpu = wp.get_device(device).is_cpu
    if _thread_count == 1 or slices < 2 or not on_cpu:
        for kernel, ordered in steps:
            wp.launch(kernel, dim=dim, inputs=[0, *ordered], device=device,
                      block_dim=None if on_cpu else GPU_BLOCK)
        return
    if _pool is None:
        _pool = ThreadPoolExecutor(_thread_count, thread_name_prefix="warpgrasp")
    cuts = iter(list(pairwise(rows * k // slices for k in range(slices + 1))))
    # Arguments are packed once a thread, here, since packing holds the interpreter's lock.
    jobs = [_pool.submit(_take_slices, [
        wp.launch(kernel, dim=dim, inputs=[0, *ordered], device=device, record_cmd=True)
        for kernel, ordered in steps], cuts, dim) for _ in range(min(_thread_count, slices))]
    for job in jobs:
        job.result()


def _take_slices(
    commands: Sequence[Any], cuts: Iterator[tuple[int, int]], dim: tuple[int, ...]
) -> None:
    """A thread's work: the next slice that no thread has taken, until there is none."""
    for start, stop in cuts:
        for command in commands:
            command.set_dim((stop - start, *dim[1:]))
            command.set_param_at_index(0, start)
            command.launch()
