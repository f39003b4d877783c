"""The body of an episode as a free-form surface, by what `[fit] reconstruct` names.

    touches + recovered superquadric or contour → Gaussian process or plug-in → meshes
"""

import time
from dataclasses import dataclass

import numpy as np

from fit.arrays import rows_of
from fit.fit_status import is_fitted
from fit.implicit.fit import fit_implicit
from fit.implicit.mesh import implicit_meshes
from fit.implicit.query import of_rows
from fit.implicit.record import ImplicitFit, ImplicitOptions, TriangleMesh
from fit.implicit.volume import VolumeEstimate, implicit_volume
from strategies.planners.planner_file import PlannerError
from strategies.poses.waypoints import PRIOR_MARGIN_M, BoundingCylinder
from strategies.reconstruct.plug_in import NO_MESH, Touches, run_plug_in
from strategies.reconstruct.plug_in_name import BUILT_IN, find_plug_in
from strategies.reconstruct.prior_distance import box_of_recovered, distance_to_recovered
from strategies.recovery.belief import read_only
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.evidence import Evidence
from warpgrasp.parameters import FitTable


@dataclass(frozen=True)
class Reconstruction:
    """Free-form bodies of a batch, in the base frame."""

    name: str
    """How rows name the shape: implicit, or the plug-in's function."""
    meshes: tuple[TriangleMesh, ...]
    """One a world, empty where the recovered model stands."""
    fault: np.ndarray
    """What a plug-in did wrong, str (world,)."""
    time_s: float
    """Wall time of all worlds together."""
    fits: ImplicitFit | None = None
    """Of the Gaussian process, of the worlds `fitted`, in order."""
    fitted: np.ndarray | None = None
    volume: VolumeEstimate | None = None
    """Volume and the surface's uncertainty, likewise."""

    @property
    def made(self) -> np.ndarray:
        """Worlds whose body is a mesh, bool (world,)."""
        return np.array([len(mesh.faces) > 0 for mesh in self.meshes], bool)


def reconstruct(
    word: str, recovered: Recovered, evidence: Evidence, prior: BoundingCylinder, table: FitTable
) -> Reconstruction | None:
    """The bodies that `word` asks for; None for "superquadric", which keeps those recovered.

    A Gaussian process explains what the recovered model leaves over, so it is made only where there
    is one. A plug-in is asked about every world. Its faults are data.
    """
    if word == BUILT_IN[0]:
        return None
    begin = time.perf_counter()
    if word == BUILT_IN[1]:
        return _implicit(recovered, evidence, table, begin)
    name = word.rpartition(":")[2]
    worlds = len(recovered)
    try:
        function = find_plug_in(word)
    except PlannerError as error:
        fault = np.full(worlds, str(error), object)
        return Reconstruction(name, (NO_MESH,) * worlds, fault, 0.0)
    meshes, fault = run_plug_in(function, _touches(recovered, evidence, prior))
    return Reconstruction(name, tuple(meshes), fault, time.perf_counter() - begin)


def _implicit(recovered: Recovered, evidence: Evidence, table: FitTable,
              begin: float) -> Reconstruction:
    worlds = len(recovered)
    rows = np.flatnonzero(recovered.shape != Shape.PRIOR_CYLINDER)
    meshes = [NO_MESH] * worlds
    fits, volume = None, None
    if len(rows):
        mean = distance_to_recovered(rows_of(recovered, rows))
        felt = rows_of(evidence, rows)
        free = {"free_points": felt.free_m, "free_radius": felt.free_radius_m,
                "free_mask": felt.free_mask} if table.free_space else {}
        options = ImplicitOptions() if table.loss != "none" else ImplicitOptions(outlier_share=0.0)
        found = fit_implicit(
            felt.points_m, felt.mask, covariance=felt.covariance_m2 if table.weights else None,
            mean=mean, table_z=0.0 if table.table_plane else None, options=options, **free)
        good = np.flatnonzero(is_fitted(found.status))
        rows, fits = rows[good], rows_of(found, good)
        mean = of_rows(mean, good)
        made = implicit_meshes(fits, mean, box_m=box_of_recovered(rows_of(recovered, rows)))
        volume = implicit_volume(fits, made, mean)
        for row, mesh in zip(rows, made, strict=True):
            meshes[row] = mesh
    return Reconstruction(BUILT_IN[1], tuple(meshes), np.full(worlds, "", object),
                          time.perf_counter() - begin, fits, rows, volume)


def _touches(recovered: Recovered, evidence: Evidence, prior: BoundingCylinder) -> Touches:
    reach = prior.radius_m + PRIOR_MARGIN_M
    low = np.stack([prior.x_m - reach, prior.y_m - reach, np.zeros(len(reach))], 1)
    high = np.stack([prior.x_m + reach, prior.y_m + reach, prior.height_m + PRIOR_MARGIN_M], 1)
    seen = read_only(evidence)
    # A contact whose link is in doubt tells no normal.
    normals = np.where(np.isfinite(seen.contradiction)[..., None], seen.normals, np.nan)
    return Touches(seen.points_m, seen.mask, seen.covariance_m2, normals, seen.free_m,
                   seen.free_radius_m, seen.free_mask, low, high,
                   distance_to_recovered(recovered))
