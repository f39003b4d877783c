"""The body that a free form stands about: none, a contour that was recovered, or a superquadric.

A free form about no body knows what was felt alone. About one that leaves hardly anything of it to
explain, the process explains that, and the body says what was not felt; where a body leaves more,
it has the wrong shape elsewhere too. Which body it is the likelihood of the contacts decides, and
parameters of bodies count (Schwarz 1978).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fit.fit_status import is_fitted
from fit.implicit.known import KnownProcess, log_evidence, of_fit
from fit.implicit.mean_errors import MeanErrors
from fit.implicit.record import Mean
from fit.revolution.geometry import revolution_surface
from fit.superquadric.geometry import Superquadric, superquadric_points
from strategies.poses.waypoints import BoundingCylinder
from strategies.reconstruct.body_errors import ErrorsOfContours, ErrorsOfSuperquadrics
from strategies.reconstruct.plug_in_name import IMPLICIT
from strategies.reconstruct.prior_distance import DistanceToRecovered
from strategies.recovery.choose_model import Recovered, Shape, parameter_count, superquadric_of
from strategies.recovery.contact_verdict import mean_gap
from strategies.recovery.evidence import Evidence
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.plausibility import plausible, swept
from warpgrasp.parameters import FitTable

HALVINGS = 8
"""Amplitudes of what a body leaves to explain: that of a process about no body, its half, ..."""
EXPLAINED_M = 0.0015
"""A body explains contacts where what it leaves has at most this amplitude: a contact's own
deviation [est]."""
CONTACTS_OF_A_PARAMETER = 2
"""That there are at least, for a body to be tried [est]."""
FAR_M = 0.004
"""Where contacts lie farther than this from a model that was recovered, in the mean, no
superquadric explains them, and none is tried [est]."""
_SURFACE_POINTS = 216


@dataclass(frozen=True)
class FreeMean:
    """What the free form of one world stands about."""

    shape: str
    """How rows name the body; empty where there is none."""
    mean: Mean
    process: KnownProcess
    """Of what the body leaves to explain."""
    box_m: tuple[np.ndarray, np.ndarray] | None = None
    """Corners of a box about the body, (1, 3) each."""
    superquadric: Superquadric | None = None
    """The body, if it is one."""
    errors: MeanErrors | None = None
    """Of the body before any touch; None where there is none."""

    @property
    def name(self) -> str:
        """How rows name the free form."""
        return f"{IMPLICIT}_about_{self.shape}" if self.shape else IMPLICIT


def likeliest_mean(
    placed: Evidence, sigma_m: np.ndarray, recovered: Recovered, prior: BoundingCylinder,
    table: FitTable, process: KnownProcess
) -> FreeMean:
    """The mean about which the contacts `placed` of one world, of deviations `sigma_m` (1, point),
    are likeliest: of those about which hardly anything is left to explain, or none.

    Bodies are a contour that was `recovered` and superquadrics, straight and bent, fitted to these
    contacts. One that `prior`, table or free space contradict is none. All arguments have one row.
    """
    none = FreeMean("", process.mean, process)
    known = recovered.shape[0] != Shape.PRIOR
    if known and mean_gap(recovered, placed)[0] > FAR_M:
        return none
    mask = placed.mask[0]
    felt = placed.points_m[0][mask], placed.normals[0][mask], sigma_m[0][mask]
    amplitudes = [process.amplitude_m / 2.0**k for k in range(HALVINGS)]

    def likelihood(mean: Mean) -> np.ndarray:
        return log_evidence(*felt, process, [of_fit(mean, 0)], amplitudes)[0]

    best, most = none, float(likelihood(process.mean).max())
    for body, parameters in _bodies(placed, recovered, prior, table):
        likely = likelihood(body.mean)
        value = float(likely.max()) - parameters * np.log(mask.sum()) / 2.0
        left = amplitudes[likely.argmax()]
        if (left <= EXPLAINED_M and value > most
                and mask.sum() >= CONTACTS_OF_A_PARAMETER * parameters):
            best, most = replace(body, process=replace(process, amplitude_m=left)), value
    return best


def _bodies(placed: Evidence, recovered: Recovered, prior: BoundingCylinder, table: FitTable
            ) -> Iterator[tuple[FreeMean, int]]:
    """Bodies that may explain the contacts, and how many parameters each has."""
    process = KnownProcess()  # of what it leaves to explain, the likelihood tells
    if recovered.shape[0] == Shape.REVOLUTION and recovered.revolution is not None:
        points, _, _ = revolution_surface(recovered.revolution)
        yield (FreeMean("revolution", DistanceToRecovered(recovered), process, _box(points),
                        errors=ErrorsOfContours(recovered.revolution)),
               parameter_count(recovered, table))
    for kind in (table,) if table.bend else (table, replace(table, bend=True)):
        fit, _ = recover_bodies(placed, None, kind)
        allowed = is_fitted(fit.status) & plausible(fit, prior, table_plane=table.table_plane)
        if table.free_space:
            allowed &= ~swept(fit, placed)
        if allowed[0]:
            model = Recovered(np.array([Shape.SUPERQUADRIC]), superquadric_of(fit))
            yield (FreeMean(kind.superquadric_name, DistanceToRecovered(model), process,
                            _box(superquadric_points(fit, _SURFACE_POINTS)), model.superquadric,
                            ErrorsOfSuperquadrics(model.superquadric, table.table_plane)),
                   parameter_count(model, kind))


def _box(points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points_m.min(1), points_m.max(1)
