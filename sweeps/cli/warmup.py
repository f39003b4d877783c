"""`warpgrasp warmup`: compile every kernel and the fits' programs once, into the caches."""

import importlib
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from warpgrasp.core.cores import core_count
from warpgrasp.parameters import ArmTable, FitTable, HandTable

if TYPE_CHECKING:
    from strategies.strategy import Strategy

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
    "warpgrasp.chain_closing.chain_closing_kernels",
    "warpgrasp.closing.closing_kernel",
    "warpgrasp.closing.closing_kernels",
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
TO_CLOSE = ("warpgrasp.closing.closing_kernels", "warpgrasp.mechanism.arm_motion_kernel")
"""What an episode of `explore` launches that grasps; those that compile longest come first, so that
the cores are done at about the same time."""
TO_FOLLOW = ("warpgrasp.touch.guarded_motion_kernel", "warpgrasp.mechanism.puma560_kernel")
"""Where it follows faces or contours."""
_FOLLOWING = {"planar", "contour", "decide"}
TO_RECOVER = (
    "strategies.contacts.field_placing_kernel", "sweeps.episode.scores_kernel",
    "warpgrasp.geometry.scene", "sweeps.episode.surface_elements_kernel",
    "strategies.recovery.body_distances_kernel",
)
"""Always."""
TO_PLAN = {
    **dict.fromkeys(("random", "even", "oracle"), ("warpgrasp.mechanism.puma560_kernel",)),
    **dict.fromkeys(("coverage", "most-uncertain", "information", "gaussian-process",
                     "expected-error"),
                    ("strategies.foresight.foresight_kernel",
                     "warpgrasp.mechanism.puma560_kernel")),
    "any-object": (
        "strategies.foresight.aimed_poses_kernel", "strategies.foresight.occupancy_kernel",
        "warpgrasp.mechanism.puma560_kernel", "warpgrasp.mechanism.utah_mit_hand_kernel",
        "strategies.foresight.prospect_kernel"),
}
"""By planner."""
OF_CHAINS = {
    "warpgrasp.closing.closing_kernels": ("warpgrasp.chain_closing.chain_closing_kernels",),
    "warpgrasp.touch.guarded_motion_kernel": ("warpgrasp.touch.chain_line_kernel",),
    "strategies.contacts.field_placing_kernel": (
        "strategies.contacts.chain_placing_kernel", "warpgrasp.chain.chain_clearance_kernel"),
    "warpgrasp.mechanism.utah_mit_hand_kernel": (),
}
"""What another hand launches in place of a kernel of the Utah-MIT hand."""
OF_ARMS = {"none": (), "puma560": ("warpgrasp.mechanism.puma560_kernel",)}
"""What an arm launches to be solved for its joints; any other one `OF_SERIAL_ARMS`."""
OF_SERIAL_ARMS = ("warpgrasp.arms.serial_arm_kernel",)
FITS = (("ring6", "block", FitTable()), ("contour-first", "beer_bottle", FitTable()),
        ("ring6", "block", FitTable(taper=False)), ("ring6", "block", FitTable(bend=True)))
"""Strategies, objects and what is fitted, which ask for all programs that ship."""
EPISODES = np.arange(4)


def compile_kernels(device: str) -> float:
    """Compile or load every kernel for `device`, on all cores; the time it took [s]."""
    begin = time.perf_counter()
    _load(KERNEL_MODULES, device)
    return time.perf_counter() - begin


def kernels_explored(
    strategy: "Strategy", hand: str = HandTable.kind, arm: str = ArmTable.kind
) -> list[str]:
    """Modules with the kernels that an episode of `explore` launches, with a hand and an arm."""
    paper = [*(TO_CLOSE if "containment" in strategy.order else ()),
             *(TO_FOLLOW if _FOLLOWING & set(strategy.order) else ()),
             *TO_RECOVER, *TO_PLAN.get(strategy.call, ())]
    instead = {"warpgrasp.mechanism.puma560_kernel": OF_ARMS.get(arm, OF_SERIAL_ARMS)}
    if hand != HandTable.kind:
        instead |= OF_CHAINS
    return [name for of_paper in paper for name in instead.get(of_paper, (of_paper,))]


def compile_explored(
    strategy: "Strategy", device: str, *, bends: bool, hand: str = HandTable.kind,
    arm: str = ArmTable.kind
) -> None:
    """Compile, on all cores, what `explore` asks for and the caches have no version of.

    Launches would compile one kernel after another, each when it is met, and the programs of the
    fits after them; `bends` says whether bodies that bend are fitted. Kernels in the cache are
    left to the first launch, which checks them before it loads them; on a GPU, where the cache may
    have those of the CPU alone, all are loaded.
    """
    from concurrent.futures import ThreadPoolExecutor

    import warp as wp

    from warpgrasp.core.kernel_cache import has_kernels

    names = kernels_explored(strategy, hand, arm)
    if wp.get_device(device).is_cpu:
        names = [name for name in names if not has_kernels(name)]
    with ThreadPoolExecutor(1) as beside:
        fitted = beside.submit(fit_explored, strategy, bends)
        _load(names, device)
        fitted.result()


def fit_explored(strategy: "Strategy", bends: bool) -> None:
    """Ask for the programs of the fits of an episode of `explore`, unless some are kept."""
    from fit.optimize.program_cache import has_cached_programs

    if has_cached_programs():
        return
    from fit.revolution.fit import fit_revolution
    from fit.superquadric.fit import fit_superquadric
    from fit.superquadric.record import SuperquadricOptions
    from strategies.recovery.complete_contour import OPTIONS

    points = 0.03 * np.random.default_rng(0).standard_normal((1, 32, 3)) + [0.45, 0.0, 0.06]
    for bend in (False, True)[:1 + bends]:
        fit_superquadric(
            points, table_z=0.0, free_points=np.full((1, 1, 3), 0.3),
            free_radius=np.full((1, 1), 0.01), options=SuperquadricOptions(
                taper=True, bend=bend, loss=FitTable.loss))  # pyright: ignore
    if {"contour", "decide"} & set(strategy.order):
        fit_revolution(points, options=OPTIONS)


def _load(names: Sequence[str], device: str) -> None:
    import warp as wp

    from warpgrasp.core.kernel_launch import GPU_BLOCK

    modules = [wp.get_module(importlib.import_module(name).__name__) for name in names]
    target = wp.get_device(device)
    wp.force_load(target, modules, 1 if target.is_cpu else GPU_BLOCK, max_workers=core_count())


def compile_fits(device: str) -> float:
    """Compile what the strategies that ship have fitted, on all cores; the time it took [s].

    Programs differ by the parameters of the fit, not by its residual or how many touches there are.
    So few episodes ask for all of them; as processes, for none compiles two programs at a time.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    begin = time.perf_counter()
    with ProcessPoolExecutor(core_count(), get_context("spawn")) as pool:
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
