"""`warpgrasp warmup`: compile every kernel and the fits' programs once, into the caches."""

import importlib
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np

KERNEL_MODULES = (
    "strategies.contacts.placing_kernel",
    "strategies.foresight.foresight_kernel",
    "strategies.foresight.occupancy_kernel",
    "strategies.recovery.body_distances_kernel",
    "strategies.recognition.pose_alignment_kernel",
    "sweeps.episode.scores_kernel",
    "sweeps.episode.surface_elements_kernel",
    "warpgrasp.closing.closing_kernel",
    "warpgrasp.closing.contact_estimate_kernel", "warpgrasp.closing.meeting_kernel",
    "warpgrasp.closing.friction_kernel", "warpgrasp.closing.near_kernel",
    "warpgrasp.closing.self_contact_kernel",
    "warpgrasp.closing.readout",
    "warpgrasp.geometry.scene",
    "warpgrasp.geometry.sdf_grid",
    "warpgrasp.mechanism.arm_motion_kernel",
    "warpgrasp.mechanism.puma560_kernel",
    "warpgrasp.mechanism.utah_mit_hand_kernel",
    "warpgrasp.touch.guarded_motion_kernel",
    "warpgrasp.touch.pad_kernel",
    "warpgrasp.touch.silhouette_kernel",
)
FITS = (
    (("ring6", "ring18"), ("block",), True),
    (("ring6", "ring18"), ("block",), False),
    (("contour-first", "planar"), ("block", "beer_bottle", "wine_bottle", "wedge"), True),
    (("coarse-to-fine",), ("beer_bottle", "block", "wine_bottle", "lightbulb"), True),
)
"""Strategies, objects and whether the model tapers; those first whose programs the later share."""
EPISODES = np.arange(16)


def compile_kernels(device: str) -> float:
    """Compile or load every kernel for `device`, on all cores; the time it took [s]."""
    import warp as wp

    modules = [wp.get_module(importlib.import_module(name).__name__) for name in KERNEL_MODULES]
    begin = time.perf_counter()
    target = wp.get_device(device)
    wp.force_load(target, modules, 1 if target.is_cpu else None, max_workers=os.cpu_count())
    return time.perf_counter() - begin


def compile_fits(device: str) -> float:
    """Compile what the strategies that ship have fitted, on all cores; the time it took [s].

    Programs differ by the form of fit and by how many touches there are room for. So episodes are
    run which ask for all of them; as processes, for none compiles two programs at a time.
    """
    begin = time.perf_counter()
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        jobs = [pool.submit(_run, *episodes, device) for episodes in FITS]
        for done in [*jobs, pool.submit(_turn)]:
            done.result()
    return time.perf_counter() - begin


def _run(strategies: tuple[str, ...], objects: tuple[str, ...], taper: bool, device: str) -> None:
    from strategies.ready_made import STRATEGIES
    from sweeps.episode.episodes import run_episodes
    from sweeps.output import init_warp
    from sweeps.spec.cell import Cell

    init_warp()
    for strategy in strategies:
        for name in objects:
            cell = Cell(STRATEGIES[strategy], {"name": name}, name)
            run_episodes(replace(cell, fit=replace(cell.fit, taper=taper)), EPISODES, device)


def _turn() -> None:
    """Surfaces of revolution through as many touches as there may be, which few episodes ask for.
    """
    from fit.optimize.batch import POINT_BUCKETS
    from fit.revolution.fit import fit_revolution
    from strategies.recovery.complete_contour import OPTIONS

    rng = np.random.default_rng(0)
    for room in POINT_BUCKETS:
        fit_revolution(rng.normal(0.0, 0.03, (1, room, 3)), table_z=0.0, options=OPTIONS)


def warmup(device: str) -> int:
    """The command."""
    from sweeps.output import init_warp

    init_warp()
    print(f"kernels  {compile_kernels(device):6.1f} s", flush=True)
    print(f"fits     {compile_fits(device):6.1f} s")
    return 0
