"""From what was felt to a body: fits and contacts, in turns.

Joint torques show which link touched and where along it, but hardly on which side of a round tip.
The fitted body supplies the rest: a link touches where its axis is nearest, along the body's normal
there. So a body is fitted, every contact is placed where torques and body agree best, and the body
is fitted again. Of the space that links swept without touching,
the next fit is given the balls nearest to the body last fitted; only those can matter.
"""

from dataclasses import replace

import numpy as np

from fit.arrays import rows_of, with_rows
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import SuperquadricLike
from fit.superquadric.record import SuperquadricFit, SuperquadricOptions
from strategies.contacts.field_placing import places_on_field, superquadric_field
from strategies.contacts.finger_touch import TouchedLinks
from strategies.recovery.body_distances import bodies_on, radial_distances
from strategies.recovery.evidence import SURE_LINK, Evidence
from strategies.recovery.misfit import CLEARLY, RIVAL, RIVALS_FROM_M, doubt
from warpgrasp.parameters import FitTable

FREE_BALLS = 24
"""Free balls given to a fit, the nearest to the body last fitted."""
REFINE_ITERATIONS = 4
"""Iterations of the finish of a body that is known already and felt a little more: the next step
goes on from there."""
PLACE_SIGMA_M = 0.003
"""How well a body still being fitted predicts where a link's axis must pass [est]."""
TURN_SIGMA_RAD = 0.15
"""How well it predicts the direction of its surface there [est]."""
NORMAL_SIGMA_M = 0.0008
"""Spread of a placed contact along the normal: joint angles, mount, repeatability [est]."""
SCREEN_ITERATIONS = 3
"""Iterations by which starts are compared: few, for any body shrinks to its contacts after more."""
LAST_ITERATIONS = 24
"""Iterations of the last fit's finish; those whose contacts are still to move have none."""
LEAST_FALL = 1e-5
"""A fit is left where four iterations lower its cost by less than this share. To the end of all
descents scores move by less than 1 um in the median, in nine of ten by less than 5."""
FARTHEST_LINK_M = 0.02
"""A link farther than this from the body is no less likely than one this far."""

Bodies = tuple[SuperquadricFit, Evidence]
"""Fits, and their contacts as placed for them, a row a world."""


def recover_bodies(
    evidence: Evidence, links: TouchedLinks | None, table: FitTable, *,
    doubted_m: float = RIVALS_FROM_M
) -> Bodies:
    """Superquadrics of all worlds, and the contacts as placed for the last fit.

    Without `links` (the paper's fingertip estimate) the points stay where they are felt, and one
    more fit brings in free space. Bodies whose contacts lie `doubted_m` off, and
    sheets, have rivals (`misfit`).
    """
    return beside_rivals(*_recover(evidence, links, table), evidence, links, table,
                         doubted_m=doubted_m)


def _recover(
    evidence: Evidence, links: TouchedLinks | None, table: FitTable
) -> Bodies:
    # No body yet, so no free balls yet; masked ones in their place, for one compiled program.
    first = slice(0, FREE_BALLS)
    placed = replace(evidence, free_m=evidence.free_m[:, first],
                     free_mask=np.zeros_like(evidence.free_mask[:, first]))
    rounds = table.rounds if links is not None else int(table.free_space)
    fits = fit_evidence(placed, table, iterations=0 if rounds else LAST_ITERATIONS)
    for number in range(rounds):
        if links is not None:
            placed = contacts_placed(evidence, links, fits)
        placed = nearest_free(placed, evidence, fits)
        # Early bodies may be wrong as a whole: from scratch where they are doubted.
        from_scratch = (doubt(fits, placed) > RIVALS_FROM_M) & (2 * number < rounds)
        iterations = LAST_ITERATIONS if number == rounds - 1 else 0
        for rows, start in ((np.flatnonzero(from_scratch), False),
                            (np.flatnonzero(~from_scratch), True)):
            if len(rows):
                found = fit_evidence(rows_of(placed, rows), table,
                                     start=fits[rows] if start else None, iterations=iterations)
                fits = with_rows(fits, rows, found)
    return fits, placed


def refine_bodies(
    evidence: Evidence, links: TouchedLinks | None, table: FitTable, start: SuperquadricFit, *,
    rounds: int = 1, iterations: int = REFINE_ITERATIONS
) -> Bodies:
    """Bodies of worlds that felt a little more, going on from the bodies last fitted.

    Contacts are placed `rounds` times. No rivals: see `beside_rivals`.
    """
    placed, fits = evidence, start
    rounds = min(rounds, max(table.rounds, 1)) if links is not None else 1
    for number in range(rounds):
        if links is not None:
            placed = contacts_placed(evidence, links, fits)
        placed = nearest_free(placed, evidence, fits)
        fits = fit_evidence(placed, table, start=fits,
                            iterations=iterations if number == rounds - 1 else 0)
    return fits, placed


def beside_rivals(
    fits: SuperquadricFit, placed: Evidence, evidence: Evidence, links: TouchedLinks | None,
    table: FitTable, *, doubted_m: float = RIVALS_FROM_M
) -> Bodies:
    """The fits, or in doubted worlds those of the rival residual where they are nearer."""
    far = doubt(fits, placed) > doubted_m
    rows = np.flatnonzero(far & placed.mask.any(1) & table.rivals)
    if len(rows) == 0:
        return fits, placed
    rival, where = _recover(rows_of(evidence, rows), rows_of(links, rows),
                            replace(table, residual=RIVAL))
    best, there = nearer((fits[rows], rows_of(placed, rows)), (rival, where), CLEARLY)
    return with_rows(fits, rows, best), with_rows(placed, rows, there)


def nearer(one: Bodies, other: Bodies, share: float = 1.0) -> Bodies:
    """Of each world the `other` body where its `doubt` is below `share` of the first's."""
    won = np.flatnonzero(doubt(*other) < share * doubt(*one))
    return (with_rows(one[0], won, other[0][won]), with_rows(one[1], won, rows_of(other[1], won)))


def fit_evidence(
    evidence: Evidence, table: FitTable, *, start: SuperquadricFit | None = None,
    iterations: int = LAST_ITERATIONS,
) -> SuperquadricFit:
    """One fit a world, to the evidence that the table switches on, going on from `start`."""
    residual = table.residual
    if residual == "solina_first":
        # Distances are truer for deformed bodies, but from afar a body shrunk to nothing fits too.
        deformed = table.taper or table.bend
        first = "solina_box" if deformed else "solina"
        residual = "volume_distance" if deformed and start is not None else first
    options = SuperquadricOptions(
        taper=table.taper, bend=table.bend, residual=residual,  # pyright: ignore
        loss=table.loss,  # pyright: ignore
        iterations=iterations, screen_iterations=SCREEN_ITERATIONS, least_fall=LEAST_FALL,
        upright_std_rad=table.upright_rad if table.table_plane else None,
        mean_exponent=SuperquadricOptions.mean_exponent if table.flat_ends else None,
        prior=SuperquadricOptions.prior if table.shape_prior else 0.0)
    return fit_superquadric(
        evidence.points_m, evidence.mask,
        covariance=evidence.covariance_m2 if table.weights else None,
        normals=_felt_normals(evidence) if table.normals else None,
        table_z=0.0 if table.table_plane else None,
        free_points=evidence.free_m if table.free_space else None,
        free_radius=evidence.free_radius_m if table.free_space else None,
        free_mask=evidence.free_mask if table.free_space else None,
        options=options, start=start)


def _felt_normals(evidence: Evidence) -> np.ndarray:
    """Normals that were measured; those of placed contacts are the body's own."""
    return np.where(evidence.by_pad[..., None], evidence.normals, np.nan)


def contacts_placed(
    evidence: Evidence, links: TouchedLinks, body: SuperquadricLike, *, device: str = "cpu"
) -> Evidence:
    """Contacts where links touch `body`: on their likeliest link, where torques and body agree best
    (`strategies.contacts.placing_posterior`).

    Where a body is none, its contacts stay where they are felt. Raises ShapeError where shapes
    disagree.
    """
    asked = evidence.mask & links.linked
    field = superquadric_field(links, asked, *bodies_on(body, device), device=device)
    found = places_on_field(
        links, asked, field, place_sigma_m=PLACE_SIGMA_M,
        turn_sigma_rad=TURN_SIGMA_RAD, farthest_m=FARTHEST_LINK_M, normal_sigma_m=NORMAL_SIGMA_M,
        device=device)
    moved = asked & (found.chance > 0.0) & np.isfinite(found.point_m).all(-1)
    sure = np.where(found.chance >= SURE_LINK, found.misfit, np.inf)
    return replace(
        evidence, points_m=np.where(moved[..., None], found.point_m, evidence.points_m),
        covariance_m2=np.where(moved[..., None, None], found.covariance_m2, evidence.covariance_m2),
        normals=np.where(moved[..., None], found.normal, evidence.normals),
        contradiction=np.where(moved, sure, evidence.contradiction))


def nearest_free(placed: Evidence, evidence: Evidence, body: SuperquadricLike) -> Evidence:
    """`placed` with the free balls of `evidence` that are nearest to `body`."""
    clearance = radial_distances(body, evidence.free_m, evidence.free_mask)
    # Stable sort: otherwise the order of ties depends on the length of the rows.
    chosen = np.argsort(clearance, axis=1, kind="stable")[:, :FREE_BALLS]
    return replace(
        placed, free_m=np.take_along_axis(evidence.free_m, chosen[..., None], 1),
        free_mask=np.isfinite(np.take_along_axis(clearance, chosen, 1)))
