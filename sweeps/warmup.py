"""`warpgrasp warmup`: compile every kernel and the fits' programs once, into the caches."""

import importlib
import os
import time

import numpy as np

KERNEL_MODULES = (
    "warpgrasp.arm_hand", "warpgrasp.body", "warpgrasp.closing_kernel",
    "warpgrasp.closing_reading", "warpgrasp.contact_estimate", "warpgrasp.guarded_line_kernel",
    "warpgrasp.mesh_distance", "warpgrasp.puma560", "warpgrasp.silhouette",
    "warpgrasp.tactile_pad", "warpgrasp.utah_mit_hand", "strategies.body_query",
    "strategies.placement", "sweeps.metrics", "sweeps.surface_elements",
)


def compile_kernels(device: str) -> float:
    """Compile or load every kernel for `device`, on all cores; the time it took [s]."""
    import warp as wp

    modules = [wp.get_module(importlib.import_module(name).__name__) for name in KERNEL_MODULES]
    begin = time.perf_counter()
    target = wp.get_device(device)
    wp.force_load(target, modules, 1 if target.is_cpu else None, max_workers=os.cpu_count())
    return time.perf_counter() - begin


def compile_fits(device: str) -> float:
    """Run one episode with each form of fit, for the programs it compiles; time [s]."""
    from dataclasses import replace

    from strategies.catalogue import STRATEGIES
    from sweeps.cell import Cell
    from sweeps.episodes import run_episodes

    begin = time.perf_counter()
    cell = Cell(STRATEGIES["ring6"], {"name": "block"}, "block")
    for form in (cell, replace(cell, fit=replace(cell.fit, taper=False))):
        run_episodes(form, np.arange(1), device)
    return time.perf_counter() - begin


def warmup(device: str) -> int:
    """The command."""
    from sweeps.quiet import start_warp

    start_warp()
    print(f"kernels  {compile_kernels(device):6.1f} s")
    print(f"fits     {compile_fits(device):6.1f} s")
    return 0
