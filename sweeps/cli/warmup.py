"""`warpgrasp warmup`: compile every kernel and the fits' programs once, into the caches."""

import importlib
import os
import time
from collections.abc import Sequence

import numpy as np

from warpgrasp.parameters import FitTable

KERNEL_MODULES = (
    "strategies.foresight.aimed_poses_kernel",
    "strategies.foresight.foresight_kernel",
    "strategies.foresight.occupancy_kernel",
    "strategies.foresight.prospect_kernel",
    "strategies.recovery.body_distances_kernel",
    "strategies.recognition.pose_alignment_kernel",
    "sweeps.episode.scores_kernel",
    "sweeps.episode.surface_elements_kernel",
    "strategies.contacts.chain_placing_kernel",
    "strategies.contacts.field_placing_kernel",
    "warpgrasp.arms.serial_arm_kernel",
    "warpgrasp.chain.chain_clearance_kernel",
    "warpgrasp.chain_closing.chain_closing_kernel",
    "warpgrasp.chain_closing.chain_estimate_kernel",
    "warpgrasp.chain_closing.chain_meeting_kernel",
    "warpgrasp.chain_closing.chain_near_kernel",
    "warpgrasp.chain_closing.chain_readout",
    "warpgrasp.chain_closing.chain_self_kernel",
    "warpgrasp.closing.closing_kernel",
    "warpgrasp.closing.contact_estimate_kernel", "warpgrasp.closing.meeting_kernel",
    "warpgrasp.closing.friction_kernel", "warpgrasp.closing.near_kernel",
    "warpgrasp.closing.self_contact_kernel",
    "warpgrasp.closing.readout",
    "warpgrasp.geometry.scene",
    "warpgrasp.geometry.sdf_grid",
    "warpgrasp.hands.link_frames_kernel",
    "warpgrasp.mechanism.arm_motion_kernel",
    "warpgrasp.mechanism.puma560_kernel",
    "warpgrasp.mechanism.utah_mit_hand_kernel",
    "warpgrasp.touch.chain_line_kernel",
    "warpgrasp.touch.guarded_motion_kernel",
    "warpgrasp.touch.pad_kernel",
    "warpgrasp.sight.silhouette_kernel",
)
EXPLORED = (
    "warpgrasp.closing.meeting_kernel", "warpgrasp.closing.friction_kernel",
    "warpgrasp.mechanism.arm_motion_kernel",
    "warpgrasp.closing.readout",
    "strategies.contacts.field_placing_kernel", "warpgrasp.geometry.scene",
    "warpgrasp.closing.near_kernel", "warpgrasp.closing.contact_estimate_kernel",
    "sweeps.episode.scores_kernel", "warpgrasp.closing.self_contact_kernel",
    "strategies.foresight.occupancy_kernel", "strategies.foresight.prospect_kernel",
    "warpgrasp.mechanism.puma560_kernel", "strategies.recovery.body_distances_kernel",
    "sweeps.episode.surface_elements_kernel", "warpgrasp.mechanism.utah_mit_hand_kernel",
    "strategies.foresight.aimed_poses_kernel",
)
"""What an episode of `explore` with the default strategy launches; those that compile longest come
first, so that the cores are done at about the same time."""
FITS = (("ring6", "block", FitTable()), ("contour-first", "beer_bottle", FitTable()),
        ("ring6", "block", FitTable(taper=False)), ("ring6", "block", FitTable(bend=True)))
"""Strategies, objects and what is fitted, which ask for all programs that ship."""
EPISODES = np.arange(4)


def compile_kernels(device: str) -> float:
    """Compile or load every kernel for `device`, on all cores; the time it took [s]."""
    begin = time.perf_counter()
    _load(KERNEL_MODULES, device)
    return time.perf_counter() - begin


def compile_explored(device: str) -> None:
    """Compile, on all cores, what `explore` launches and the cache has no version of.

    Launches would compile one kernel after another, each when it is met. Kernels in the cache are
    left to the first launch, which checks them before it loads them; on a GPU, where the cache may
    have those of the CPU alone, all are loaded.
    """
    import warp as wp

    from warpgrasp.core.kernel_cache import has_kernels

    missing = [name for name in EXPLORED if not has_kernels(name)]
    _load(missing if wp.get_device(device).is_cpu else EXPLORED, device)


def _load(names: Sequence[str], device: str) -> None:
    import warp as wp

    from warpgrasp.core.kernel_launch import GPU_BLOCK

    modules = [wp.get_module(importlib.import_module(name).__name__) for name in names]
    target = wp.get_device(device)
    wp.force_load(target, modules, 1 if target.is_cpu else GPU_BLOCK, max_workers=os.cpu_count())


def compile_fits(device: str) -> float:
    """Compile what the strategies that ship have fitted, on all cores; the time it took [s].

    Programs differ by the parameters of the fit, not by its residual or how many touches there are.
    So few episodes ask for all of them; as processes, for none compiles two programs at a time.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    begin = time.perf_counter()
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        jobs = [pool.submit(_turn), *(pool.submit(_run, *episodes, device) for episodes in FITS)]
        for done in jobs:
            done.result()
    return time.perf_counter() - begin


def _run(strategy: str, name: str, fit: FitTable, device: str) -> None:
    from strategies.ready_made import STRATEGIES
    from sweeps.episode.episodes import run_episodes
    from sweeps.output import init_warp
    from sweeps.spec.cell import Cell

    init_warp()
    run_episodes(Cell(STRATEGIES[strategy], {"name": name}, name, fit=fit), EPISODES, device)


def _turn() -> None:
    """Surfaces of revolution, which few episodes ask for."""
    from fit.revolution.fit import fit_revolution
    from strategies.recovery.complete_contour import OPTIONS

    rng = np.random.default_rng(0)
    fit_revolution(rng.normal(0.0, 0.03, (1, 32, 3)), table_z=0.0, options=OPTIONS)


def warmup(device: str) -> int:
    """The command."""
    from sweeps.output import init_warp

    init_warp()
    print(f"kernels  {compile_kernels(device):6.1f} s", flush=True)
    print(f"fits     {compile_fits(device):6.1f} s")
    return 0
