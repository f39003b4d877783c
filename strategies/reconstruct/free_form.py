"""The body of an episode as a mesh, by what `[fit] reconstruct` names.

    contacts as felt → Gaussian process and contacts in turns, or plug-in → meshes
    planes of crossed faces → polyhedron → meshes

What makes a body is imported when one is made: of most episodes the recovered model stands.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fit.arrays import rows_of
from fit.implicit.record import ImplicitFit, TriangleMesh
from fit.superquadric.record import SuperquadricFit
from strategies.contacts.finger_touch import TouchedLinks
from strategies.planners.guarded_call import told_apart
from strategies.planners.planner_file import PlannerError
from strategies.poses.waypoints import BoundingCylinder
from strategies.reconstruct.plug_in import NO_MESH, Touches, run_plug_in
from strategies.reconstruct.plug_in_name import (
    BUILT_IN,
    CHOSEN,
    IMPLICIT,
    PARTS,
    POLYHEDRON,
    find_plug_in,
)
from strategies.reconstruct.prior_distance import DistanceToRecovered
from strategies.recovery.belief import Belief, read_only
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import (
    doubted,
    gaps_to_mesh,
    mean_contradiction,
    mean_gap,
    mean_gap_to_mesh,
    unexplained,
)
from strategies.recovery.evidence import PLACED, Evidence
from strategies.recovery.misfit import UNBELIEVED_M
from strategies.recovery.plausibility import FEWEST_CONTACTS, plausible_vertices
from warpgrasp.parameters import ArmTable, ErrorTable, FitTable

if TYPE_CHECKING:
    from fit.implicit.volume import VolumeEstimate
    from strategies.reconstruct.calibrated_planes import Planes
    from strategies.reconstruct.free_mean import FreeMean
CLEARLY_BETTER = 0.85
"""A free form replaces a doubted model where torques contradict it by this share as much [est]."""


@dataclass(frozen=True)
class FreeForm:
    """The free form of one world."""

    fit: ImplicitFit
    """Its process, one row."""
    about: "FreeMean"
    """The body that it stands about."""


@dataclass(frozen=True)
class Reconstruction:
    """Bodies of a batch that no single model is, in the base frame."""

    name: str
    """How rows name the shape: implicit, parts, or the plug-in's function; see `name_of`."""
    meshes: tuple[TriangleMesh, ...]
    """One a world, empty where the recovered model stands."""
    fault: np.ndarray
    """What a plug-in did wrong, str (world,)."""
    time_s: float
    """Wall time of all worlds together."""
    forms: Mapping[int, FreeForm] = field(default_factory=dict)
    """Of worlds whose body is a free form."""
    parts: Mapping[int, SuperquadricFit] = field(default_factory=dict)
    """Of worlds whose body is several superquadrics."""
    polyhedra: "Mapping[int, Planes]" = field(default_factory=dict)
    """Of worlds whose body is one of the faces crossed."""
    placed: Mapping[int, Evidence] = field(default_factory=dict)
    """Contacts as their body placed them, one row, of worlds whose free form or parts did so; a
    polyhedron and a plug-in's body take contacts as placed on the model recovered."""
    note: np.ndarray | None = None
    """What a plug-in's author may not have meant, str (world,); None of bodies of ours."""

    def name_of(self, world: int) -> str:
        """How its row names the shape of a world whose body is a mesh."""
        if world in self.polyhedra:
            return POLYHEDRON
        return self.forms[world].about.name if world in self.forms else self.name

    def volume(self, world: int) -> "VolumeEstimate | None":
        """Volume of a world's free form and its surface's uncertainty; None where there is none."""
        if world in self.forms and world not in self._volumes:
            from fit.implicit.volume import implicit_volume
            from strategies.recovery.free_contacts import LEFT_M

            form, mesh = self.forms[world], self.meshes[world]
            known = implicit_volume(form.fit, [mesh], form.about.mean,
                                    errors=form.about.errors, shared_m=LEFT_M)
            if form.about.errors is not None:
                from strategies.reconstruct.body_errors import with_unfelt

                known = with_unfelt(known, self.placed[world].felt, np.array([mesh.area_m2]))
            self._volumes[world] = known
        return self._volumes.get(world)

    def places(self, evidence: Evidence) -> Evidence:
        """Contacts of all worlds as placed on the bodies that stand, made of the `evidence` that
        has them as placed on the models."""
        found = {name: getattr(evidence, name).copy() for name in PLACED}
        for world, placed in self.placed.items():
            for name, values in found.items():
                values[world] = getattr(placed, name)[0]
        return replace(evidence, **found)

    def gaps(self, model_m: np.ndarray, points_m: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """How far points (world, point, 3) are from the bodies that stand [m], (world, point).
        `model_m` says how far they are from the models."""
        found = model_m.copy()
        for world in np.flatnonzero(self.made):
            mine = mask[world]
            found[world, mine] = gaps_to_mesh(self.meshes[world], points_m[world][mine])
        return found

    @cached_property
    def _volumes(self) -> "dict[int, VolumeEstimate]":
        return {}

    @property
    def made(self) -> np.ndarray:
        """Worlds whose body is a mesh, bool (world,)."""
        return np.array([len(mesh.faces) > 0 for mesh in self.meshes], bool)


def reconstruct(
    word: str, recovered: Recovered, evidence: Evidence, prior: BoundingCylinder, table: FitTable,
    *, felt: Evidence | None = None, links: TouchedLinks | None = None,
    belief: Belief | None = None, wanted: np.ndarray | None = None
) -> Reconstruction | None:
    """The bodies that `word` asks for; None for "superquadric", which keeps those recovered.

    `evidence` has contacts as placed on the bodies recovered, `felt` as they were felt, of `links`;
    without these a free form takes contacts as they are in `evidence`. What contacts tell of the
    errors of calibration that the `belief` reckons with is taken from them.
    "implicit" makes a free form of every world that felt enough, "chosen" only where the recovered
    body does not explain what was felt, or explains it badly and torques agree better with the
    free form, and no polyhedron of the faces crossed, as the `belief` has them, explains it;
    "parts" makes a body of two to four superquadrics where contacts ask for it. None
    of them stands where prior or table contradict it: one that ends high above the table was not
    felt to its foot. Nor does a free form that contacts lie off by `UNBELIEVED_M` in the mean, or,
    "chosen", by as much as off the body recovered. Small pieces of a free form that the prior
    contradicts are left out. A plug-in is asked about every world. Its faults are data. If
    `wanted`, bool (world,), is given, bodies are made, and a plug-in is asked, of these worlds
    alone.
    """
    if word == BUILT_IN[0]:
        return None
    begin = time.perf_counter()
    worlds = len(recovered)
    asked = np.ones(worlds, bool) if wanted is None else wanted
    if word in BUILT_IN:
        free = asked & (evidence.mask.sum(1) >= FEWEST_CONTACTS)
        most, nearest = np.full(worlds, np.inf), np.full(worlds, UNBELIEVED_M)
        polyhedra: dict[int, Planes] = {}
        if word == CHOSEN:
            polyhedra = _polyhedra(asked, recovered, belief, felt, prior, table)
            doubt = unexplained(recovered, evidence)
            if links is not None:  # without them contacts are not placed anew, and tell nothing
                most = np.where(doubt, np.inf, CLEARLY_BETTER * mean_contradiction(evidence))
                doubt |= doubted(recovered, evidence)
            free &= doubt
            free[list(polyhedra)] = False
            stands = recovered.shape != Shape.PRIOR
            nearest = np.minimum(nearest, np.where(stands, mean_gap(recovered, evidence), np.inf))
        if felt is None:
            felt, links = evidence, None
        from strategies.recovery.free_contacts import begun_freely

        felt = begun_freely(felt, evidence, links)
        calibration = None if belief is None else (belief.errors, belief.arm)
        if word == PARTS:
            return _several(np.flatnonzero(free), felt, links, prior, table, begin, calibration)
        made = _implicit(np.flatnonzero(free), felt, links, recovered, prior, table, begin, most,
                         nearest, calibration)
        return _with_polyhedra(made, polyhedra)
    name = word.rpartition(":")[2]
    try:
        function = find_plug_in(word)
    except PlannerError as error:
        fault = np.full(worlds, str(error), object)
        return Reconstruction(name, (NO_MESH,) * worlds, fault, 0.0)
    meshes, fault, note = [NO_MESH] * worlds, *(np.full(worlds, "", object) for _ in range(2))

    def ask(rows: np.ndarray) -> np.ndarray:
        answer = run_plug_in(function, _touches(
            rows_of(recovered, rows), rows_of(evidence, rows), rows_of(prior, rows)))
        fault[rows], note[rows] = answer.fault, answer.note
        for row, mesh in zip(rows, answer.meshes, strict=True):
            meshes[row] = mesh
        return rows[answer.ended]

    told_apart(ask(np.flatnonzero(asked)), ask)
    return Reconstruction(name, tuple(meshes), fault, time.perf_counter() - begin, note=note)


def _polyhedra(asked: np.ndarray, recovered: Recovered, belief: Belief | None,
               felt: Evidence | None, prior: BoundingCylinder, table: FitTable
               ) -> "dict[int, Planes]":
    """Polyhedra of the worlds `asked` that one explains better than the model recovered."""
    if belief is None or felt is None or not belief.faces:
        return {}
    from strategies.reconstruct.calibrated_planes import calibrated_planes
    from strategies.reconstruct.felt_polyhedron import (
        FEWEST_FACES,
        felt_polyhedron,
        mesh_of_planes,
    )

    found: dict[int, Planes] = {}
    crossed = sum(face.fit.n_points > 0 for face in belief.faces)
    for world in np.flatnonzero(asked & (crossed >= FEWEST_FACES)):
        own = np.array([world])
        evidence = rows_of(belief.evidence, own)
        planes = felt_polyhedron([rows_of(face, own) for face in belief.faces],
                                 rows_of(recovered, own), evidence, rows_of(felt, own),
                                 rows_of(prior, own), table)
        if planes is None:
            continue
        calibrated = calibrated_planes(planes, evidence, rows_of(belief.links, own),
                                       belief.errors, belief.arm)
        # Of planes that no longer close a body stands what was felt.
        found[int(world)] = calibrated if len(mesh_of_planes(calibrated).faces) else planes
    return found


def _with_polyhedra(free: Reconstruction, polyhedra: "Mapping[int, Planes]") -> Reconstruction:
    if not polyhedra:
        return free
    from strategies.reconstruct.felt_polyhedron import mesh_of_planes

    meshes = list(free.meshes)
    for world, planes in polyhedra.items():
        meshes[world] = mesh_of_planes(planes)
    return replace(free, meshes=tuple(meshes), polyhedra=polyhedra)


def _implicit(rows: np.ndarray, felt: Evidence, links: TouchedLinks | None, recovered: Recovered,
              prior: BoundingCylinder, table: FitTable, begin: float, most: np.ndarray,
              nearest: np.ndarray, calibration: tuple[ErrorTable, ArmTable] | None
              ) -> Reconstruction:
    """Free forms of the worlds `rows`, where torques contradict them by less than `most` (world,)
    and contacts lie less than `nearest` [m] (world,) off in the mean."""
    meshes = [NO_MESH] * len(felt.mask)
    none = np.full(len(meshes), "", object)
    if len(rows) == 0:
        return Reconstruction(IMPLICIT, tuple(meshes), none, time.perf_counter() - begin)
    from fit.implicit.mesh import implicit_meshes
    from strategies.reconstruct.believed_pieces import believed_pieces
    from strategies.reconstruct.free_mean import likeliest_mean
    from strategies.recovery.free_contacts import BODY, fit_placed, placed_freely

    forms, places = {}, {}
    for row in rows:  # one at a time: sums over rows of a longer neighbour would round otherwise
        own = np.array([row])
        placed, sigma = placed_freely(
            rows_of(felt, own), None if links is None else rows_of(links, own), table,
            calibration)
        if mean_contradiction(placed)[0] >= most[row]:
            continue
        given = rows_of(prior, own)
        about = likeliest_mean(placed, sigma, rows_of(recovered, own), given, table, BODY)
        fit = fit_placed(placed, sigma, table, about.process, about.mean)
        mesh = believed_pieces(implicit_meshes(fit, about.mean, box_m=about.box_m)[0], given)
        if (plausible_vertices([mesh.vertices_m], given, table_plane=table.table_plane)[0]
                and mean_gap_to_mesh(mesh, placed.points_m[placed.mask]) < nearest[row]):
            meshes[row], forms[int(row)] = mesh, FreeForm(fit, about)
            places[int(row)] = placed
    return Reconstruction(IMPLICIT, tuple(meshes), none, time.perf_counter() - begin, forms,
                          placed=places)


def _several(rows: np.ndarray, felt: Evidence, links: TouchedLinks | None,
             prior: BoundingCylinder, table: FitTable, begin: float,
             calibration: tuple[ErrorTable, ArmTable] | None) -> Reconstruction:
    """Bodies of several parts of the worlds `rows`."""
    from strategies.reconstruct.parts import fitted_parts, parts_mesh
    from strategies.recovery.free_contacts import placed_freely

    meshes: list[TriangleMesh] = [NO_MESH] * len(felt.mask)
    parts, places = {}, {}
    for row in rows:
        own = np.array([row])
        placed, _ = placed_freely(
            rows_of(felt, own), None if links is None else rows_of(links, own), table,
            calibration)
        found = fitted_parts(placed, rows_of(prior, own), table)
        if found is None:
            continue
        mesh = parts_mesh(found, table_plane=table.table_plane)
        if len(mesh.faces) and plausible_vertices([mesh.vertices_m], rows_of(prior, own),
                                                  table_plane=table.table_plane)[0]:
            meshes[row], parts[int(row)], places[int(row)] = mesh, found, placed
    return Reconstruction(PARTS, tuple(meshes), np.full(len(meshes), "", object),
                          time.perf_counter() - begin, parts=parts, placed=places)


def _touches(recovered: Recovered, evidence: Evidence, prior: BoundingCylinder) -> Touches:
    reach = prior.radius_m + prior.margin_m
    low = np.stack([prior.x_m - reach, prior.y_m - reach, np.zeros(len(reach))], 1)
    high = np.stack([prior.x_m + reach, prior.y_m + reach, prior.height_m + prior.margin_m], 1)
    # A contact whose link is in doubt tells no normal.
    normals = np.where(np.isfinite(evidence.contradiction)[..., None], evidence.normals, np.nan)
    return read_only(Touches(
        evidence.points_m, evidence.mask, evidence.covariance_m2, normals, evidence.free_m,
        evidence.free_radius_m, evidence.free_mask, low, high, DistanceToRecovered(recovered)))
