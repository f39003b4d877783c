"""The paper's third experiment: contour following of four bottles, recognized by their size."""

from dataclasses import dataclass

import numpy as np

from strategies.procedures.contour_follower import explore_contour
from strategies.procedures.contour_record import Axis, ContourExploration
from strategies.procedures.contour_sections import SectionProfile, profile_by_sections
from strategies.procedures.contour_shape import Profile, match_profiles, profile_of
from strategies.procedures.touches import EndReason
from sweeps.text_table import number_text
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, HandTable, SensorTable
from warpgrasp.robot import Robot, Truth

WAYS = ("circles and linear segments about the axis given", "surface of revolution, axis refined")
"""The paper's contour (`contour_sections`), and ours (`contour_shape`)."""
BOTTLES = ("wine_bottle", "coke_bottle", "beer_bottle", "orangina_bottle")
_PRIOR_SIGMA_M = 0.008  # of each number of the axis given as prior; estimated


@dataclass(frozen=True)
class Contour:
    """What one way makes of the touches along one bottle. Shapes (world,)."""

    profile: Profile | SectionProfile
    matched: np.ndarray
    """Name of the bottle whose profile is nearest."""
    by_volume: np.ndarray
    """Name of the bottle nearest in largest radius, length and volume alone; "" where none was
    recovered, as in `matched`."""


@dataclass(frozen=True)
class Followed:
    """One bottle followed in many worlds."""

    name: str
    exploration: ContourExploration
    ended: np.ndarray
    """Whether the end of the bottle was reached, bool (world,)."""
    contours: dict[str, Contour]
    """By way, `WAYS`."""

    def volume_errors(self, way: str) -> np.ndarray:
        """Relative errors of the volume, without sign, of the worlds that reached the end."""
        true = volume_of(contour_of(self.name))
        return np.abs(self.contours[way].profile.volume_m3[self.ended] / true - 1.0)


def contour_of(name: str) -> np.ndarray:
    """True profile of a bottle (node, 2): height and radius [m]."""
    return body_from_name(name).parts[0].profile_m


def volume_of(contour: np.ndarray) -> float:
    """Volume of a profile (node, 2) of linear segments [m3]: a sum of cones' frustums."""
    z, r = contour.T
    return float(np.pi / 3 * (np.diff(z) * (r[:-1]**2 + r[:-1] * r[1:] + r[1:]**2)).sum())


def follow_bottles(worlds: int) -> list[Followed]:
    """Every bottle in `worlds` worlds, from an axis given with an error."""
    contours = {name: contour_of(name) for name in BOTTLES}
    return [_follow(name, contours, worlds) for name in BOTTLES]


def _follow(name: str, contours: dict[str, np.ndarray], worlds: int) -> Followed:
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (worlds, 1))
    key = np.arange(worlds).astype(np.uint64) + np.uint64(1990)
    robot = Robot([body_from_name(name)], np.zeros(1, int), Truth(pose), key, ArmTable(),
                  HandTable(), SensorTable())
    error = np.random.default_rng(6).normal(0.0, _PRIOR_SIGMA_M, (worlds, 4))
    contour = contours[name]
    axis = Axis.upright(0.45 + error[:, 0], error[:, 1], contour[-1, 0] + error[:, 2],
                        contour[:, 1].max() + error[:, 3])
    exploration = explore_contour(robot, axis)
    profiles = dict(zip(WAYS, (profile_by_sections(exploration), profile_of(exploration)),
                        strict=True))
    return Followed(name, exploration, exploration.reason == EndReason.END_OF_OBJECT,
                    {way: _matched(profile, contours) for way, profile in profiles.items()})


def _matched(profile: Profile | SectionProfile, contours: dict[str, np.ndarray]) -> Contour:
    features = {n: np.log([c[:, 1].max(), c[-1, 0], volume_of(c)]) for n, c in contours.items()}
    mine = np.log(np.stack([profile.largest_radius_m, profile.length_m,
                            np.maximum(profile.volume_m3, 1e-9)], 1))
    away = np.stack([np.abs(mine - f).sum(1) for f in features.values()], 1)
    known = np.isfinite(away).all(axis=1)
    nearest = np.array(list(features))[np.nan_to_num(away, nan=np.inf).argmin(1)]
    return Contour(profile, np.asarray(match_profiles(profile, contours)),
                   np.where(known, nearest, ""))


BOTTLES_HEADER = (
    "bottle", "contour", "worlds", "to_the_end", "radius_mm_true", "radius_mm_median",
    "length_mm_true", "length_mm_median", "volume_ml_true", "volume_ml_median", "volume_ml_p5",
    "volume_ml_p95", "volume_off_pct_median", "right_by_size_and_volume", "right_by_profile")


def bottle_rows(found: list[Followed]) -> list[tuple[str, ...]]:
    """The table, a row for each bottle and way, over the worlds in which its end was reached.

    `to_the_end` and the columns `right_by_...` count those worlds.
    """
    rows = []
    for f in found:
        true, end = contour_of(f.name), f.ended
        for way, c in f.contours.items():
            p = c.profile
            volume = 1e6 * p.volume_m3[end]
            low, high = np.quantile(volume, [0.05, 0.95]) if end.any() else (np.nan, np.nan)
            rows.append((
                f.name, way, str(len(end)), str(end.sum()),
                *_texts(1, 1e3 * true[:, 1].max(), median_or_nan(1e3 * p.largest_radius_m[end])),
                *_texts(0, 1e3 * true[-1, 0], median_or_nan(1e3 * p.length_m[end]),
                        1e6 * volume_of(true), median_or_nan(volume), low, high),
                *_texts(1, 100 * median_or_nan(f.volume_errors(way))),
                str((c.by_volume[end] == f.name).sum()), str((c.matched[end] == f.name).sum())))
    return rows


def median_or_nan(values: np.ndarray) -> float:
    """The median of numbers; NaN of none."""
    return float(np.median(values)) if len(values) else float("nan")


def _texts(digits: int, *values: float) -> list[str]:
    return [number_text(float(value), digits) for value in values]
