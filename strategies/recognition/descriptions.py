"""What of a recovered body is compared with known models: numbers that depend on the body alone.

Neither the place on the table, nor the turn about the vertical, nor the names of a superquadric's
axes change them. Three ways, by what was felt: parameters of the superquadric with their
covariance, the radius profile with size and volume, and the planes of faces.
"""

from dataclasses import dataclass, replace

import numpy as np

from fit.fit_status import FitStatus
from fit.superquadric.moments import (
    DESCRIPTION,
    description_covariance,
    superquadric_description,
)
from strategies.procedures.contour_shape import Profile
from strategies.procedures.planar_faces import Face
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered, Shape

FACES, PROFILE, PARAMETERS = WAYS = ("faces", "profile", "parameters")
"""Ways to recognize, in the order in which they are tried."""
SHARES = np.linspace(0.05, 0.95, 10)
"""Heights at which a profile is compared, as shares of its length."""
NUMBERS = {PROFILE: ("log_size", "log_length", *(f"radius_{100 * s:.0f}" for s in SHARES)),
           PARAMETERS: DESCRIPTION}
"""Names of the numbers; radii are relative to the cube root of the volume."""
APART_RAD = np.radians(20)
"""Faces whose normals differ by less do not fix how a body is turned."""
SAME_M = 0.005
"""Two crossings of planes so near to one another are of one face [est]."""


@dataclass(frozen=True)
class FeltFaces:
    """Flat faces of one world's body."""

    points_m: np.ndarray
    """Middles of the touches on each, (face, 3)."""
    normals: np.ndarray
    """Outward, (face, 3)."""


@dataclass(frozen=True)
class Described:
    """Bodies of some worlds, by one way: numbers with their covariance, or faces."""

    tried: np.ndarray
    """Worlds in which a body was recovered and this way was looked for, bool (world,)."""
    rows: np.ndarray
    """Worlds that it tells of, (row,)."""
    numbers: np.ndarray
    """(row, number)."""
    covariance: np.ndarray
    """(row, number, number)."""
    faces: tuple[FeltFaces, ...] = ()
    """Of each row, where the way is that of faces."""

    def part(self, kept: np.ndarray) -> "Described":
        """What it tells of the worlds `kept`, bool (world,)."""
        own = kept[self.rows]
        faces = tuple(faces for faces, keep in zip(self.faces, own, strict=True) if keep
                      ) if self.faces else ()
        return Described(self.tried & kept, self.rows[own], self.numbers[own],
                         self.covariance[own], faces)


def described(belief: Belief, recovered: Recovered, way: str) -> Described:
    """The recovered bodies of a batch by one of `WAYS`."""
    of_way = {FACES: _faces, PROFILE: _profiles, PARAMETERS: _parameters}
    return of_way[way](belief, recovered, recovered.shape != Shape.PRIOR)


def _parameters(belief: Belief, recovered: Recovered, known: np.ndarray) -> Described:
    """Superquadrics that are believed."""
    tried = known & belief.fitted
    width = len(DESCRIPTION)
    if not tried.any():
        return _nothing(tried, width)
    with np.errstate(all="ignore"):  # bodies that are left out may have no volume
        numbers = superquadric_description(belief.body)
        covariance = description_covariance(belief.body, belief.uncertainty.covariance)
    rows = np.flatnonzero(tried & np.isfinite(numbers).all(1) & np.isfinite(covariance).all((1, 2)))
    return Described(tried, rows, numbers[rows], covariance[rows])


def _profiles(belief: Belief, recovered: Recovered, known: np.ndarray) -> Described:
    """Bodies for which the contour that was followed stands."""
    width = len(NUMBERS[PROFILE])
    profile = belief.profile
    if profile is None:
        return _nothing(np.zeros_like(known), width)
    tried = known & (np.nan_to_num(profile.volume_m3) > 0)
    rows = np.flatnonzero(tried & (recovered.shape == Shape.REVOLUTION))
    numbers = np.array([_profile_numbers(profile, int(world)) for world in rows]).reshape(-1, width)
    return Described(tried, rows, numbers, np.zeros((len(rows), width, width)))


def _profile_numbers(profile: Profile, world: int) -> np.ndarray:
    nodes = np.isfinite(profile.height_m[world]) & np.isfinite(profile.radius_m[world])
    height, radius = profile.height_m[world][nodes], profile.radius_m[world][nodes]
    length = height[-1] - height[0]
    size = np.cbrt(profile.volume_m3[world])
    radii = np.interp(height[0] + SHARES * length, height, radius)
    return np.concatenate([[np.log(size), np.log(max(length, 1e-6))], radii / size])


def _faces(belief: Belief, recovered: Recovered, known: np.ndarray) -> Described:
    """The flat faces of worlds in which two or more that are not parallel were crossed."""
    tried, found = np.zeros_like(known), {}
    if belief.faces:
        crossed = np.stack([face.fit.n_points > 0 for face in belief.faces], 1)
        flat = np.stack([face.flat & (face.fit.status == FitStatus.converged)
                         for face in belief.faces], 1)
        tried = known & crossed.any(1)
        for world in np.flatnonzero(tried & (flat.sum(1) >= 2)):
            faces = different_faces(belief.faces, np.flatnonzero(flat[world]), int(world))
            if (np.abs(faces.normals @ faces.normals[0]) < np.cos(APART_RAD)).any():
                found[world] = faces
    return replace(_nothing(tried, 0), rows=np.array(list(found), int),
                   numbers=np.zeros((len(found), 0)), covariance=np.zeros((len(found), 0, 0)),
                   faces=tuple(found.values()))


def different_faces(faces: tuple[Face, ...], flat: np.ndarray, world: int) -> FeltFaces:
    """Each face once, as it was crossed last."""
    kept: list[int] = []
    for k in flat:
        kept = [j for j in kept if not _same(faces[j], faces[k], world)] + [k]
    return FeltFaces(np.array([faces[k].fit.centre_m[world] for k in kept]),
                     np.array([faces[k].normal[world] for k in kept]))


def _same(one: Face, other: Face, world: int) -> bool:
    """Whether two crossings were of one face: planes alike in direction and place."""
    away = abs(one.normal[world] @ (other.fit.centre_m[world] - one.fit.centre_m[world]))
    return bool(one.normal[world] @ other.normal[world] > np.cos(APART_RAD) and away < SAME_M)


def _nothing(tried: np.ndarray, width: int) -> Described:
    return Described(tried, np.zeros(0, int), np.zeros((0, width)), np.zeros((0, width, width)))
